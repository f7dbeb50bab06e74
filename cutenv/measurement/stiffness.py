"""Stiffness at the tip of a cut: kappa, and the effective depth of a cut that does not go through the slab."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array
from cutenv.measurement.depth import DepthProfile
from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.slab import effective_depth


def unit_stiffness(tip: float | Array, depth: DepthProfile, model: CutModel) -> Array:
    """Return K over the modulus of the material [m], for tip positions [m]; of their shape."""
    a = np.clip(tip, 0.0, model.length)
    return np.asarray(model.stiffness(a) * effective_depth(a, depth.at(tip)))


def stiffness_ratio(
    known: float | Array, wanted: float | Array, depth: DepthProfile, model: CutModel | None = None
) -> Array:
    """Return K at the tip ``wanted`` over K at the tip ``known`` [1], of their shape.

    Parameters
    ----------
    known, wanted : float or ndarray
        Tips [m], a few millimetres apart.
    depth : DepthProfile
        Depth of the cut; in a slab of 2.5 cm K rises more slowly than in proportion to it.
    model : CutModel, optional
        Model whose unit stiffness is a factor; without it only depth counts, as within a unit of cutting.
    """
    if model is not None:
        return np.asarray(unit_stiffness(wanted, depth, model) / unit_stiffness(known, depth, model))
    return np.asarray(effective_depth(wanted, depth.at(wanted)) / effective_depth(known, depth.at(known)))
