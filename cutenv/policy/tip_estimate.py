"""The crack tip estimated from observations: blade position less elastic force over nominal stiffness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.task.observation import OFFSETS, SCALES, checked_observation
from cutenv.task.tip_estimation import PRESLIDING, dragged
from cutenv.task_quantities import SHALLOWEST
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.nominal import nominal_stiffness, nominal_tissue

_FORCE, _POSITION, _DEPTH = 0, 4, 7  # components of the observation
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time


class TipEstimate:
    """Estimator of the crack tip from observations, for tissue of mean stiffness and friction.

    An observation contains the depth at the blade; the tip is behind it, where the bulge is thinner.  So the depth
    is stored as the blade passes.

    Parameters
    ----------
    tissue : TissueDescription, optional
        The tissue that the rig assumes; default the measured pig liver.
    """

    def __init__(self, tissue: TissueDescription | None = None) -> None:
        self._nominal = nominal_tissue(tissue or measured_liver())
        self._depths = np.zeros(N_POINTS)
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self._passed = 0
        self._bristle = self._position = 0.0

    def __call__(self, observation: NDArray[np.float32]) -> float:
        """Return the tip [m] for an observation, shape (12,), of the cut since :meth:`reset`."""
        seen = checked_observation(observation) * SCALES + OFFSETS
        self._passed, self._bristle, self._position, tip = _estimate(
            seen, self._nominal, self._depths, self._passed, self._bristle, self._position
        )
        return tip


@njit
def _estimate(
    seen: StructArray, nominals: StructArray, depths: StructArray, passed: int, bristle: float, before: float
) -> tuple[int, float, float, float]:
    nominal = nominals[0]
    position = max(seen[_POSITION], 0.0)
    depth = max(seen[_DEPTH], SHALLOWEST)
    passed = remember_depth(depths, passed, position, depth)
    bristle = dragged(bristle, position - before)
    elastic = max(seen[_FORCE] - bristle / PRESLIDING * nominal.friction_per_depth * depth, 0.0)
    return passed, bristle, position, tip_behind(position, elastic, nominal, depths, passed)


@njit
def remember_depth(depths: StructArray, passed: int, position: float, depth: float) -> int:
    """Fill ``depths``, shape (301,) [m], up to the blade, by linear interpolation since the last observation.

    ``passed`` is the number of grid points that the blade had passed; returns the number passed now.
    """
    reached = min(round(position / SPACING), len(depths) - 1) + 1
    before = depths[passed - 1] if passed > 0 else depth
    for k in range(passed, reached):
        depths[k] = before + (depth - before) * (k + 1 - passed) / (reached - passed)
    return max(passed, reached)


@njit_internal
def tip_behind(position: float, elastic: float, nominal: Struct, depths: StructArray, passed: int) -> float:
    """Return the tip [m] behind a blade at ``position`` [m] under an ``elastic`` force [N], in the mean tissue."""
    tip = position
    for _ in range(_ITERATIONS):
        place = min(max(round(tip / SPACING), 0), passed - 1)
        tip = position - elastic / nominal_stiffness(nominal, place, depths[place])
    return max(tip, 0.0)
