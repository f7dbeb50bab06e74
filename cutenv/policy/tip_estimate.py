"""Where the tip is, from what a rig sees: the blade less the elastic force over the nominal stiffness."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv.compiled import compiled, for_kernels
from cutenv.cutting.records import Records
from cutenv.task.observation import OFFSETS, SCALES, checked_observation
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.drawing import unit_stiffness
from cutenv.tissue.grid import N_POINTS, SPACING

_FORCE, _POSITION, _SPEED, _DEPTH = 0, 4, 5, 7  # components of the observation
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time
SHALLOWEST = 0.001
"""Depth of cut that is counted at least [m]."""


class TipEstimate:
    """The crack tip for an observation, if the tissue were the mean one.

    An observation tells the depth at the blade; the tip stands behind, where the bulge is thinner.  So the depth is
    remembered from when the blade passed.

    Parameters
    ----------
    tissue : TissueDescription, optional
        What the rig believes to cut; default the measured pig liver.
    """

    def __init__(self, tissue: TissueDescription | None = None) -> None:
        tissue = tissue or measured_liver()
        self._stiffness_per_depth = nominal_stiffness_per_depth(tissue)
        self._friction_per_depth = nominal_friction_per_depth(tissue)
        self._depths = np.zeros(N_POINTS)
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self._passed = 0

    def __call__(self, observation: NDArray[np.float32]) -> float:
        """The tip [m] for an observation, shape (12,), of the cut since :meth:`reset`."""
        seen = checked_observation(observation) * SCALES + OFFSETS
        self._passed, tip = _estimate(
            seen, self._stiffness_per_depth, self._friction_per_depth, self._depths, self._passed
        )
        return tip


def nominal_stiffness_per_depth(tissue: TissueDescription) -> NDArray[np.float64]:
    """K/B of the mean tissue, shape (301,) [N/m2]."""
    return tissue.intercept_90 * unit_stiffness(tissue)


def nominal_friction_per_depth(tissue: TissueDescription) -> float:
    """Friction on a moving blade in the mean tissue [N/m]."""
    return tissue.friction_share * tissue.fracture_resistance


@compiled
def _estimate(
    seen: Records, stiffness_per_depth: Records, friction_per_depth: float, depths: Records, passed: int
) -> tuple[int, float]:
    position, speed = max(seen[_POSITION], 0.0), seen[_SPEED]
    depth = max(seen[_DEPTH], SHALLOWEST)
    passed = remember_depth(depths, passed, position, depth)
    friction = math.copysign(friction_per_depth * depth, speed) if speed != 0.0 else 0.0
    elastic = max(seen[_FORCE] - friction, 0.0)
    return passed, tip_behind(position, elastic, stiffness_per_depth, depths, passed)


@compiled
def remember_depth(depths: Records, passed: int, position: float, depth: float) -> int:
    """Fill ``depths``, shape (301,) [m], up to the blade, evenly between here and where it was last seen.

    ``passed`` is how many of them the blade had passed; returns how many it has passed now.
    """
    reached = min(round(position / SPACING), len(depths) - 1) + 1
    before = depths[passed - 1] if passed > 0 else depth
    for k in range(passed, reached):
        depths[k] = before + (depth - before) * (k + 1 - passed) / (reached - passed)
    return max(passed, reached)


@for_kernels
def tip_behind(position: float, elastic: float, stiffness_per_depth: Records, depths: Records, passed: int) -> float:
    """The tip [m] behind a blade at ``position`` [m] that feels an elastic force [N]."""
    tip = position
    for _ in range(_ITERATIONS):
        place = min(max(round(tip / SPACING), 0), passed - 1)
        tip = position - elastic / (stiffness_per_depth[place] * depths[place])
    return max(tip, 0.0)
