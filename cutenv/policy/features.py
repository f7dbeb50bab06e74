"""Features of a learned policy: the observation, quantities derived from it, and a short history.

The most useful derived quantity is the position of the tip.  While the blade advances, the force determines it only
for a known stiffness; while it draws back, the force falls along a straight line whose slope is the stiffness, down
to friction, and there is the tip.  Both estimates are features; nothing is included that a rig could not know.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array32, Indices, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.elementary import log, tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv.policy.signals import (
    ANGLE_COLUMN,
    DEPTH_COLUMN,
    DISTANCE_COLUMN,
    FORCE_COLUMN,
    FORCE_MAX_COLUMN,
    FORCE_MEAN_COLUMN,
    FORCE_MIN_COLUMN,
    POSITION_COLUMN,
    SPEED_COLUMN,
)
from cutenv.policy.tip_estimate import PASSAGE, pass_by, tip_behind
from cutenv.task.observation import CLIP, COMPONENTS, SCALES, checked_observation
from cutenv.task_quantities import SHALLOWEST
from cutenv.tissue.description import measured_liver
from cutenv.tissue.nominal import nominal_stiffness, nominal_tissue
from cutenv.tissue.specimen import SPACING

_WORKED_OUT = 14  # derived features, besides observation and history
_CHANNELS = 5  # values per decision of the history
_FORCES = [FORCE_COLUMN, FORCE_MEAN_COLUMN, FORCE_MIN_COLUMN, FORCE_MAX_COLUMN]
_LENGTH = 0.010  # [m], scale of lengths
_FINE = 0.002  # [m], scale of lengths that decide whether a cut is a success
_FORCE_PER_DEPTH = 300.0  # [N/m]

_STEADY = -0.002  # [m/s], speed below which a blade draws back steadily
_SETTLED = 0.0006  # [m] of retreat after which the delayed force no longer contains the earlier friction
_FLAT, _FLAT_OVER = 0.10, 0.0004  # [N], [m]: pure friction changes by less than this over this distance
_STEEP = 0.15  # [N] above friction: still elastic
_SPAN = 0.0006  # [m], shortest distance over which a slope is fitted
_SOFTEST, _STIFFEST = 0.25, 4.0  # multiples of the mean tissue's stiffness

MEMORY: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("passage", PASSAGE),  # of the blade, for the estimate of the tip
            ("furthest", "f8"),  # furthest position of the blade so far [m]
            ("steady", "i8"),  # number of decisions for which the blade has drawn back
            ("back_from", "f8"),  # position at which the retreat began [m]
            ("position", "f8"),  # at the last decision, or the last one at least _FLAT_OVER away [m]
            ("force", "f8"),  # there [N]
            ("count", "i8"),  # number of readings during elastic retreat; then their moments about back_from
            ("x", "f8"),
            ("F", "f8"),
            ("xx", "f8"),
            ("xF", "f8"),
            ("nearest", "f8"),  # shortest distance of those readings from back_from [m]
            ("friction_per_depth", "f8"),  # measured, or nominal [N/m]
            ("stiffness_ratio", "f8"),  # measured K over that of the mean tissue, at the tip [1]
            ("probed", "i8"),  # 1 once the tip has been located by drawing back
            ("tip", "f8"),  # located tip [m]
        ],
    )
)
"""Structured dtype of the features' memory of one cut."""


class Features:
    """Features of one cut or many, decision after decision; those of many are bit for bit those of each alone.

    Parameters
    ----------
    count : int
        Number of cuts.
    history : int
        Number of past decisions in the history: mean, minimum and maximum force, position and angle of each.
    force : bool
        Whether the force is used; if not, every force counts as zero, also in the derived features.

    Attributes
    ----------
    size : int
        Number of features of a cut.

    Raises
    ------
    TypeError, ValueError
        If ``count`` or ``history`` is not a whole number, or ``force`` is not True or False.
    """

    def __init__(self, count: int = 1, *, history: int = 6, force: bool = True) -> None:
        if in_range("count", count, 1, 10**7, "1", "Give the number of cuts.") % 1.0:
            raise ValueError(f"count = {count} is not a whole number of cuts.")
        if in_range("history", history, 0, 1000, "1", "A handful of decisions is enough.") % 1.0:
            raise ValueError(f"history = {history} is not a whole number of decisions.")
        if not isinstance(force, bool):
            raise TypeError(f"force = {force!r} must be True (used) or False (not used).")
        self._memory, self._frames = np.zeros(int(count), MEMORY), np.zeros((int(count), int(history), _CHANNELS))
        self._force = force
        self.size = feature_count(int(history))
        self._all = np.arange(int(count))
        self.reset()

    def reset(self) -> None:
        """Forget the last cut, or all of them."""
        self.forget(self._all)

    def forget(self, cuts: int | Indices) -> None:
        """Forget one of the cuts, or several, given by index."""
        self._memory[cuts] = _nothing()[0]
        self._frames[cuts] = 0.0

    def __call__(self, observations: ArrayLike, cuts: Indices | None = None) -> Array32:
        """Return the features, float32, clipped like observations.

        Parameters
        ----------
        observations : array, shape (n, 12), or (12,) of a single cut
            Observations of all cuts, or of those given by index.
        cuts : array of int, shape (n,), optional
            Indices of the cuts.

        Returns
        -------
        array, shape (n, size), or (size,) of a single cut
            The features.
        """
        shape = np.shape(observations)
        seen = np.array(observations, np.float32, ndmin=2)
        cuts = self._all if cuts is None else cuts
        if seen.shape != (len(cuts), len(COMPONENTS)):
            checked_observation(observations)
            raise ValueError(f"observations have shape {shape}; give ({len(cuts)}, {len(COMPONENTS)}).")
        if not self._force:
            seen[:, _FORCES] = 0.0
        features = np.empty((len(seen), self.size), np.float32)
        nominal = nominal_tissue(measured_liver())
        if not extract_some(self._memory, self._frames, cuts, nominal, seen, features):
            checked_observation(observations)  # raises with the reason
        found: Array32 = features.reshape(*shape[:-1], self.size)
        return found


def feature_count(history: int) -> int:
    """Return the number of features with ``history`` past decisions."""
    return len(COMPONENTS) + _WORKED_OUT + _CHANNELS * history


@lru_cache(maxsize=1)
def _nothing() -> StructArray:
    nothing = np.zeros(1, MEMORY)
    nothing["friction_per_depth"] = nominal_tissue(measured_liver())["friction_per_depth"]
    nothing["stiffness_ratio"] = 1.0
    return nothing


@njit
def extract_some(
    memory: StructArray,
    frames: StructArray,
    cuts: StructArray,
    nominals: StructArray,
    observations: StructArray,
    features: StructArray,
) -> bool:
    """Fill ``features``, shape (n, size), and update the memory of the n cuts given by index.

    Returns False, and changes nothing, if an observation is not finite.
    """
    for k in range(len(cuts)):
        for i in range(observations.shape[1]):
            if not math.isfinite(observations[k, i]):
                return False
    for k in range(len(cuts)):
        n = cuts[k]
        _extract(memory[n], frames[n], nominals[0], observations[k], features[k])
    return True


@njit_internal
def _extract(
    memory: Struct,
    frames: StructArray,
    nominal: Struct,
    observation: StructArray,
    features: StructArray,
) -> None:
    force = observation[FORCE_COLUMN] * SCALES[FORCE_COLUMN]
    position = max(observation[POSITION_COLUMN] * SCALES[POSITION_COLUMN], 0.0)
    speed = observation[SPEED_COLUMN] * SCALES[SPEED_COLUMN]
    depth = max(observation[DEPTH_COLUMN] * SCALES[DEPTH_COLUMN], SHALLOWEST)
    target = position + observation[DISTANCE_COLUMN] * SCALES[DISTANCE_COLUMN]

    passage = memory.passage
    pass_by(passage, position, depth)
    memory.furthest = max(memory.furthest, position)
    _watch(memory, nominal, position, speed, force, depth)
    nominal_tip = tip_behind(passage, nominal, depth, force, nominal.friction_per_depth, 1.0)
    tip = max(tip_behind(passage, nominal, depth, force, memory.friction_per_depth, memory.stiffness_ratio), memory.tip)

    k = len(observation)
    for i in range(k):
        features[i] = observation[i]
    features[k] = (target - nominal_tip) / _LENGTH
    features[k + 1] = (position - nominal_tip) / _LENGTH
    features[k + 2] = (target - tip) / _LENGTH
    features[k + 3] = (position - tip) / _LENGTH
    features[k + 4] = tanh((target - tip) / _FINE)
    features[k + 5] = memory.probed
    features[k + 6] = memory.probed * (target - memory.tip) / _LENGTH
    features[k + 7] = memory.probed * tanh((target - memory.tip) / _FINE)
    features[k + 8] = memory.probed * (memory.furthest - memory.tip) / _LENGTH
    features[k + 9] = log(memory.stiffness_ratio)
    features[k + 10] = memory.friction_per_depth / nominal.friction_per_depth - 1.0
    features[k + 11] = (memory.furthest - position) / _LENGTH
    features[k + 12] = force / depth / _FORCE_PER_DEPTH
    features[k + 13] = observation[FORCE_MAX_COLUMN] * SCALES[FORCE_MAX_COLUMN] / depth / _FORCE_PER_DEPTH
    k += _WORKED_OUT

    for i in range(len(frames)):
        for j in range(_CHANNELS):
            features[k + _CHANNELS * i + j] = frames[i, j]
        features[k + _CHANNELS * i + 3] = (position - frames[i, 3]) / _LENGTH
    for i in range(len(features)):
        features[i] = min(max(features[i], -CLIP), CLIP)
    for i in range(len(frames) - 1, 0, -1):
        frames[i] = frames[i - 1]
    if len(frames) > 0:
        frames[0, 0] = observation[FORCE_MEAN_COLUMN]
        frames[0, 1] = observation[FORCE_MIN_COLUMN]
        frames[0, 2] = observation[FORCE_MAX_COLUMN]
        frames[0, 3] = position
        frames[0, 4] = observation[ANGLE_COLUMN]


@njit_internal
def _watch(memory: Struct, nominal: Struct, position: float, speed: float, force: float, depth: float) -> None:
    """Update stiffness, friction and tip from the force while the blade draws back."""
    if speed < _STEADY:
        if memory.steady == 0:
            memory.back_from = position
            memory.count = 0
            memory.x = memory.F = memory.xx = memory.xF = 0.0
        memory.steady += 1
    else:
        memory.steady = 0
    drawn_back = memory.back_from - position
    if memory.steady > 1 and drawn_back > _SETTLED:
        fell = memory.force - force
        if force < 0.0 and fell < _FLAT and memory.position - position > _FLAT_OVER:
            memory.friction_per_depth = -force / depth
            _find_tip(memory, nominal, depth)
        elif force > _STEEP - memory.friction_per_depth * depth:
            memory.count += 1
            memory.x += drawn_back
            memory.F += force
            memory.xx += drawn_back**2
            memory.xF += drawn_back * force
            if memory.count == 1:
                memory.nearest = drawn_back
            if memory.count > 1 and drawn_back - memory.nearest > _SPAN:
                _find_tip(memory, nominal, depth)
    if memory.steady <= 1 or memory.position - position > _FLAT_OVER:  # whatever the decision rate
        memory.position = position
        memory.force = force


@njit_internal
def _find_tip(memory: Struct, nominal: Struct, depth: float) -> None:
    """Locate the tip: extrapolate the straight line of the force down to friction."""
    n = memory.count
    if n < 2:
        return
    spread = memory.xx - memory.x**2 / n
    slope = (memory.x * memory.F / n - memory.xF) / max(spread, 1e-12)  # fall of the force over the retreat [N/m]
    if slope <= 0.0:
        return
    mean_x, mean_F = memory.x / n, memory.F / n
    tip = memory.back_from - mean_x - (mean_F + memory.friction_per_depth * depth) / slope
    place = min(max(round(tip / SPACING), 0), memory.passage.passed - 1)
    ratio = slope / nominal_stiffness(nominal, place, memory.passage.depths[place])
    if _SOFTEST < ratio < _STIFFEST and tip > memory.tip - 0.003:
        memory.tip = tip
        memory.stiffness_ratio = ratio
        memory.probed = 1
