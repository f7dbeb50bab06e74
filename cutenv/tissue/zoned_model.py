"""Model whose modulus, and in 2-D its thickness, differ by zone along the cut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range
from cutenv.tissue.cut_model import CutModel

_PARTS = 50  # parts of a row over which its thickness is averaged


def zoned_model(
    model: CutModel, borders: ArrayLike, moduli: ArrayLike, *, depth: Callable[[Array], ArrayLike] | None = None
) -> CutModel:
    """Return a model with zones along the cut.

    Each row of elements across the specimen gets the mean of modulus times thickness over its length.

    Parameters
    ----------
    model : CutModel
        Model of a uniform modulus.
    borders : array_like of shape (k - 1,)
        Borders between the zones [m], increasing, between 0 and the length.
    moduli : array_like of shape (k,)
        Modulus of each zone, from the clamp on, over a common one [1]; or in pascals, and then the methods take
        ``modulus=1``.
    depth : callable, optional
        Thickness [m] of a plane model at distances from the clamp [m], as `cutenv.measurement.DepthProfile.at`; the
        methods then take ``thickness=model.thickness``. By default uniform.

    Raises
    ------
    ValueError
        If borders do not increase or leave the specimen, there are not as many moduli as zones, a value is out of
        range, the model's modulus is not uniform, or ``depth`` is given for bricks.

    Examples
    --------
    >>> soft, stiff = 20e3, 60e3  # Pa
    >>> model = zoned_model(CutModel(), [0.05], [soft, stiff])
    >>> round(model.stiffness(0.04) / (CutModel().stiffness(0.04) * soft), 2)
    1.07
    """
    if depth is not None and model.dim == 3:
        raise ValueError("depth goes with plane models: bricks have one thickness. Ask for element='quad8'.")
    if model.relative_modulus is not None:
        raise ValueError("the model has a relative_modulus already: give one of a uniform modulus.")
    assert model.divisions is not None  # the model has settled them
    rows = _row_moduli(model, borders, moduli, depth).reshape(-1, *[1] * (model.dim - 2))
    return replace(model, relative_modulus=(np.ones(model.divisions) * rows).ravel())


def _row_moduli(
    model: CutModel, borders: ArrayLike, moduli: ArrayLike, depth: Callable[[Array], ArrayLike] | None
) -> Array:
    """Return the modulus of each row of elements, shape (n_rows,); with a ``depth`` times depth over thickness."""
    inner = np.atleast_1d(np.asarray(borders, dtype=np.float64))
    values = np.atleast_1d(array_in_range("moduli", moduli, 1e-6, 1e6, "1", "They are moduli of zones, or in pascals."))
    edges = np.concatenate(([0.0], inner, [model.length]))
    if inner.ndim != 1 or not (np.diff(edges) > 0.0).all():
        raise ValueError(f"borders = {inner.tolist()} m must increase between 0 and the length, {model.length:g} m.")
    if values.shape != (len(inner) + 1,):
        raise ValueError(f"{len(inner)} borders make {len(inner) + 1} zones; {values.size} moduli were given.")
    tips = model.tips
    rows = np.concatenate(([0.0], tips))
    # Every part of a row lies in one zone: the parts end at the borders too.
    cuts = np.unique(np.concatenate((np.linspace(0.0, model.length, _PARTS * len(tips) + 1), rows, edges)))
    middle, part = 0.5 * (cuts[:-1] + cuts[1:]), np.diff(cuts)
    product = values[np.searchsorted(inner, middle)]
    if depth is not None:
        cure = "The depth along the cut is a thickness in metres, and positive."
        product = product * array_in_range("depth", depth(middle), 1e-5, 1.0, "m", cure) / model.thickness
    row = np.searchsorted(tips, middle)
    return np.asarray(np.bincount(row, product * part) / np.bincount(row, part))
