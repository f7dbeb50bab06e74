"""The crack tip estimated from observations: blade position less elastic force over nominal stiffness."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Indices, Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.policy.signals import DEPTH_COLUMN, FORCE_COLUMN, POSITION_COLUMN, in_si
from cutenv.task.tip_estimation import PRESLIDING, dragged
from cutenv.task_quantities import SHALLOWEST
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.nominal import nominal_stiffness, nominal_tissue

_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time

PASSAGE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("depths", "f8", (N_POINTS,)),  # depth of cut as far as the blade has been [m]
            ("passed", "i8"),  # number of these that are known
            ("bristle", "f8"),  # deflection of the friction bristles [m]
            ("position", "f8"),  # of the blade at the last observation [m]
        ],
    )
)
"""Structured dtype of what an estimate of the tip remembers of one cut; zeros at its start."""


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
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self.begin(1)

    def begin(self, count: int) -> None:
        """Forget all cuts, and begin ``count``."""
        self._passages = np.zeros(count, PASSAGE)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self._passages[cuts] = np.zeros((), PASSAGE)

    def __call__(self, observation: NDArray[np.float32]) -> float:
        """Return the tip [m] for an observation, shape (12,), of the cut since :meth:`reset`."""
        return float(self.tips(in_si(observation)[None])[0])

    def tips(self, seen: Array) -> Array:
        """Return the tips [m], shape (n,), for the observations of all cuts in SI units, shape (n, 12)."""
        tips = np.empty(len(seen))
        _estimate(self._passages, self._nominal, seen, tips)
        return tips


@njit
def _estimate(passages: StructArray, nominals: StructArray, seen: StructArray, tips: StructArray) -> None:
    nominal = nominals[0]
    for n in range(len(passages)):
        passage, position, depth = (
            passages[n],
            max(seen[n, POSITION_COLUMN], 0.0),
            max(seen[n, DEPTH_COLUMN], SHALLOWEST),
        )
        pass_by(passage, position, depth)
        tips[n] = tip_behind(passage, nominal, depth, seen[n, FORCE_COLUMN], nominal.friction_per_depth, 1.0)


@njit_internal
def pass_by(passage: Struct, position: float, depth: float) -> None:
    """Note the blade's ``position`` [m] and ``depth`` [m]: the bristles, and the depths passed since the last time."""
    passage.passed = remember_depth(passage.depths, passage.passed, position, depth)
    passage.bristle = dragged(passage.bristle, position - passage.position)
    passage.position = position


@njit_internal
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
def tip_behind(
    passage: Struct, nominal: Struct, depth: float, force: float, friction_per_depth: float, stiffness_ratio: float
) -> float:
    """Return the tip [m] behind the blade, from the measured ``force`` [N], the blade's ``depth`` [m] and friction.

    The tissue's stiffness is ``stiffness_ratio`` times that of the mean tissue, ``nominal``.
    """
    friction = passage.bristle / PRESLIDING * friction_per_depth * depth
    elastic = max(force - friction, 0.0) / stiffness_ratio
    tip: float = passage.position
    for _ in range(_ITERATIONS):
        place = min(max(round(tip / SPACING), 0), passage.passed - 1)
        tip = passage.position - elastic / nominal_stiffness(nominal, place, passage.depths[place])
    return max(tip, 0.0)
