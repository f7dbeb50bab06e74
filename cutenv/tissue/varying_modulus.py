"""2-D models of a slab whose modulus varies along the cut: by zone; or condensed statically, with Galerkin projection.

A row of elements has one modulus, so its stiffness is that modulus times one matrix, the same for every row.  By
symmetry half of it is enough; its inner nodes are eliminated, which leaves the 17 unknowns of the nodes on either
border (8-node elements, 8 across): exactly the full model.  On every border the displacements that blades cause, in
fields of moduli of all kinds, are close to a space of few dimensions, spanned by the leading singular vectors of such
displacements.  Projecting the model there (Galerkin) changes K by less than 0.15 % in fields of a coefficient of
variation up to 0.5 (``scripts/derivations/slab.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import array_in_range
from cutenv.tissue.grid import field_modes, lognormal_sigma

if TYPE_CHECKING:
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


UNKNOWNS = 8
"""Number of unknowns kept on each border between rows."""
_FIELDS, _FIELD_CV, _FIELD_POINTS, _FIELD_LENGTH = 60, 0.5, 20, 0.020  # sample fields for the basis; points per row


class Condensed(NamedTuple):
    """Condensed stiffness of each row in the unknowns of its borders, for modulus and thickness 1.

    The last unknown of a border is the displacement of the tip there; the others do not move the tip.

    Attributes
    ----------
    lower, across, upper : ndarray of shape (n_rows, 8, 8)
        Blocks of a row's stiffness: border nearer to the clamp with itself, with the farther one, farther with itself.
    kappa : ndarray of shape (n_rows,)
        Unit stiffness of the full model at modulus 1, with the tip on each farther border [1].
    """

    lower: Array
    across: Array
    upper: Array
    kappa: Array


def condensed(model: CutModel) -> Condensed:
    """Condense a plane model of uniform modulus."""
    row, n = _row_stiffness(model)
    n_rows = len(model.tips)
    shapes: list[list[Array]] = [[] for _ in range(n_rows)]
    for rows in _fields(n_rows):
        compliance = np.linalg.inv(_assembled(row, n, rows))
        at_tips = compliance[:, ::n] / np.diag(compliance)[::n]  # for a unit displacement of each tip
        for border in range(n_rows):
            shapes[border].append(at_tips[border * n : (border + 1) * n])
    bases = [_basis(np.concatenate(each, axis=1)) for each in shapes]
    below = [np.zeros((n, UNKNOWNS)), *bases[:-1]]  # the clamp does not move
    lower, across, upper = row[:n, :n], row[:n, n:], row[n:, n:]
    return Condensed(
        lower=np.array([b.T @ lower @ b for b in below]),
        across=np.array([b.T @ across @ a for b, a in zip(below, bases, strict=True)]),
        upper=np.array([a.T @ upper @ a for a in bases]),
        kappa=np.asarray(model.stiffness(model.tips)),
    )


def _row_stiffness(model: CutModel) -> tuple[Array, int]:
    """Return the stiffness of one row in the unknowns of its borders, lower one first, and their number per border.

    The first unknown of a border is the displacement along the cut of its node on the line.
    """
    from cutenv.tissue.mesh import ACROSS, ALONG, ELEMENT_KINDS, CutMesh
    from cutenv.tissue.tip_response import stiffness_matrix

    assert model.divisions is not None
    across, along = model.divisions[:2]
    strip = CutMesh(kind=ELEMENT_KINDS[model.element], divisions=(across, 1), size=(model.width, model.length / along))
    whole = stiffness_matrix(strip, model.formulation, model.poisson).toarray()
    right = strip.half_steps[:, ACROSS] > 0
    right[strip.pairs[:, 1]] = True

    def unknowns(half_step: int) -> Indices:
        nodes = np.flatnonzero(right & (strip.half_steps[:, ALONG] == half_step))
        nodes = nodes[np.argsort(strip.half_steps[nodes, ACROSS])]
        return np.stack([2 * nodes, 2 * nodes + 1], axis=1).ravel()[1:]  # on the line nothing moves across

    border = unknowns(0)
    kept = np.concatenate([border, unknowns(2)])
    inner = unknowns(1) if strip.kind.has_midside_nodes else np.array([], dtype=np.int64)
    coupled = whole[np.ix_(inner, kept)]
    stiffness = whole[np.ix_(kept, kept)] - coupled.T @ np.linalg.solve(whole[np.ix_(inner, inner)], coupled)
    return 2.0 * stiffness, len(border)  # both halves


def _assembled(row: Array, n: int, rows: Array) -> Array:
    """Assemble the stiffness of the half slab with moduli ``rows``, clamped at the lowest border."""
    whole = np.zeros(((len(rows) + 1) * n, (len(rows) + 1) * n))
    for j, modulus in enumerate(rows):
        both = slice(j * n, (j + 2) * n)
        whole[both, both] += modulus * row
    return whole[n:, n:]


def _fields(n_rows: int) -> list[Array]:
    """Return moduli of rows for the basis: uniform, and from fields with more variation than tissue has."""
    modes = field_modes(_FIELD_POINTS * n_rows + 1, 0.01 / _FIELD_POINTS, _FIELD_LENGTH)
    rng = np.random.default_rng(0)
    unit = rng.standard_normal((_FIELDS, len(modes))) @ modes
    field = np.exp(lognormal_sigma(_FIELD_CV) * unit)
    rows = field[:, :-1].reshape(_FIELDS, n_rows, _FIELD_POINTS).mean(axis=2)
    return [np.ones(n_rows), *rows]


def _basis(shapes: Array) -> Array:
    """Return a basis of a border's unknowns, shape (n, 8): the last moves the tip by one, the others do not move it."""
    leading = np.linalg.svd(shapes, full_matrices=False)[0][:, :UNKNOWNS]
    tip = leading[0]  # how each moves the tip
    rest = np.linalg.svd(tip[np.newaxis])[2][1:].T  # combinations that do not
    return np.column_stack([leading @ rest, leading @ tip / (tip @ tip)])
