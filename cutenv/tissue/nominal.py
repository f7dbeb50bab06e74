"""The mean tissue, which a rig assumes before it cuts: stiffness at every position and depth."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_inline
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.grid import N_POINTS
from cutenv.tissue.slab import DEPTHS, at_depth

_STEPS = len(DEPTHS) - 1

NOMINAL: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("stiffness", "f8", (N_POINTS, _STEPS + 1)),  # K with the tip at each point, by depth of cut [N/m]
            ("thickness", "f8"),  # of the slab, the deepest cut [m]
            ("toughness_per_depth", "f8"),  # fracture part of R [N/m]
            ("friction_per_depth", "f8"),  # on a moving blade [N/m]
        ],
    )
)
"""Structured dtype of the mean tissue."""


@lru_cache(maxsize=8)
def nominal_tissue(tissue: TissueDescription) -> StructArray:
    """Return the :data:`NOMINAL` of a tissue, shape (1,), read-only."""
    nominal = np.zeros(1, NOMINAL)
    nominal["thickness"] = tissue.thickness
    nominal["toughness_per_depth"] = (1.0 - tissue.friction_share) * tissue.fracture_resistance
    nominal["friction_per_depth"] = tissue.nominal_friction_per_depth
    _fill(nominal, tissue.slab(), tissue.modulus, tissue.thickness)
    nominal.setflags(write=False)
    return nominal


@njit
def _fill(nominal: StructArray, slabs: StructArray, modulus: float, thickness: float) -> None:
    stiffness, slab = nominal[0].stiffness, slabs[0]
    for i in range(N_POINTS):
        for k in range(_STEPS + 1):
            effective_depth, _ = at_depth(slab, i, thickness * k / _STEPS, thickness)
            stiffness[i, k] = modulus * slab.kappa[i] * effective_depth


@njit_inline
def nominal_stiffness(nominal: Struct, i: int, depth: float) -> float:
    """Return K [N/m] of the mean tissue for a tip at point ``i`` and a cut ``depth`` [m] deep."""
    level = min(depth / nominal.thickness, 1.0) * _STEPS
    k = min(int(level), _STEPS - 1)
    stiffness = nominal.stiffness
    low = stiffness[i, k]
    K: float = low + (level - k) * (stiffness[i, k + 1] - low)
    return K
