"""Features of a learned policy.

The observation, quantities derived from it, and a short history.

The most useful derived quantities are the position of the tip (:mod:`cutenv.agents.policy.tip_estimate`), and how far
an unstable run would carry it if it began now.  Nothing is included that a rig could not know.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array32, Indices, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.elementary import log, tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv.agents.policy.interface import (
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
from cutenv.agents.policy.tip_estimate import CUT_ESTIMATE, estimate_cut, nothing_yet
from cutenv.sim.quantities import DECELERATION, SHALLOWEST
from cutenv.sim.tissue.crack_tip import BladeReading
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.specimen import nominal_tissue
from cutenv.task.observation import CLIP, COMPONENTS, SCALES, checked_observation

_WORKED_OUT = 21  # derived features, besides observation and history
_CHANNELS = 5  # values per decision of the history
_LENGTH = 0.010  # [m], scale of lengths
_FINE = 0.002  # [m], scale of lengths that decide whether a cut is a success
_NEAR = 0.010  # [m] before the target, where a cut calls for care
_FORCE_PER_DEPTH = 300.0  # [N/m]


class Remembered(NamedTuple):
    """Memory of n cuts: records and arrays of shape (n, ...)."""

    memory: StructArray  # :data:`~cutenv.agents.policy.tip_estimate.CUT_MEMORY`
    estimates: StructArray  # last estimate of each, :data:`~cutenv.agents.policy.tip_estimate.CUT_ESTIMATE`
    frames: StructArray  # history, shape (n, decisions, 5)


class Features:
    """Features of one cut or many, decision after decision.

    Those of many are bit for bit those of each alone.

    Parameters
    ----------
    history : int
        Number of past decisions in the history: mean, minimum and maximum force, position and angle of each.
    force : bool
        Whether the force is used; if not, every force counts as zero, also in the derived features.

    Raises
    ------
    TypeError, ValueError
        If ``count`` or ``history`` is not a whole number, or ``force`` is not True or False.
    """

    components: ClassVar[int] = len(COMPONENTS)
    """Numbers in an observation; a task may add some to those of gentle cutting, which come first."""
    added: ClassVar[int] = 0
    """Number of features that a task adds."""
    forces: ClassVar[Sequence[int]] = (FORCE_COLUMN, FORCE_MEAN_COLUMN, FORCE_MIN_COLUMN, FORCE_MAX_COLUMN)
    """Columns of all forces in an observation."""

    def __init__(self, count: int = 1, *, history: int = 0, force: bool = True) -> None:
        if in_range("count", count, 1, 10**7, "1", "Give the number of cuts.") % 1.0:
            raise ValueError(f"count = {count} is not a whole number of cuts.")
        if in_range("history", history, 0, 1000, "1", "A handful of decisions is enough.") % 1.0:
            raise ValueError(f"history = {history} is not a whole number of decisions.")
        if not isinstance(force, bool):
            raise TypeError(f"force = {force!r} must be True (used) or False (not used).")
        self._remembered = Remembered(
            np.repeat(nothing_yet(measured_liver()), int(count)), np.zeros(int(count), CUT_ESTIMATE),
            np.zeros((int(count), int(history), _CHANNELS)),
        )  # fmt: skip
        self._force = force
        self.size = feature_count(int(history)) + self.added
        self._all = np.arange(int(count))

    def reset(self) -> None:
        """Forget the last cut, or all of them."""
        self.forget(self._all)

    def forget(self, cuts: int | Indices) -> None:
        """Forget one of the cuts, or several, given by index."""
        self._remembered.memory[cuts] = nothing_yet(measured_liver())[0]
        self._remembered.frames[cuts] = 0.0

    @property
    def memory(self) -> StructArray:
        """Memory of each cut, :data:`~cutenv.agents.policy.tip_estimate.CUT_MEMORY`, shape (count,)."""
        return self._remembered.memory

    @property
    def estimates(self) -> StructArray:
        """Last estimate of each cut, :data:`~cutenv.agents.policy.tip_estimate.CUT_ESTIMATE`, shape (count,)."""
        return self._remembered.estimates

    def __call__(self, observations: ArrayLike, cuts: Indices | None = None) -> Array32:
        """Return the features, float32, (n, size), clipped like observations.

        ``observations``, (n, components), are of all ``cuts``, or of those given by index; those of a single cut may
        have one axis.

        Raises ValueError if they have another shape, or are not finite.
        """
        shape = np.shape(observations)
        seen = np.array(observations, np.float32, ndmin=2)
        cuts = self._all if cuts is None else cuts
        if seen.shape != (len(cuts), self.components):
            if not self.added:
                checked_observation(observations)
            raise ValueError(f"observations have shape {shape}; give ({len(cuts)}, {self.components}).")
        if self.added and not np.isfinite(seen).all():
            raise ValueError(f"observation = {seen} must be finite; give it as the environment returned it.")
        if not self._force:
            seen[:, self.forces] = 0.0
        features = np.empty((len(seen), self.size - self.added), np.float32)
        nominal, along = nominal_tissue(measured_liver()), self.seen_along(seen)
        if not extract_some(self._remembered, cuts, nominal, along, features):
            checked_observation(observations)  # raises with the reason
        if self.added:
            features = np.concatenate([features, np.empty((len(seen), self.added), np.float32)], axis=1)
            self.add(seen, cuts, features)
        found: Array32 = features.reshape(*shape[:-1], self.size)
        return found

    def seen_along(self, seen: Array32) -> Array32:
        """Return gentle cutting's part, (n, 12), of observations, (n, components)."""
        return np.ascontiguousarray(seen[:, : len(COMPONENTS)])

    def add(self, seen: Array32, cuts: Indices, features: Array32) -> None:
        """Fill ``cuts``' last ``added`` features from observations, (n, components)."""


def feature_count(history: int) -> int:
    """Return the number of features with ``history`` past decisions."""
    return len(COMPONENTS) + _WORKED_OUT + _CHANNELS * history


@njit
def extract_some(
    remembered: Remembered, cuts: StructArray, nominals: StructArray, observations: StructArray, features: StructArray
) -> bool:
    """Fill ``features``, (n, size), and update memory of n indexed cuts.

    Returns False, and changes nothing, if an observation is not finite.
    """
    for k in range(len(cuts)):
        for i in range(observations.shape[1]):
            if not math.isfinite(observations[k, i]):
                return False
    for k in range(len(cuts)):
        _extract(remembered, cuts[k], nominals[0], observations[k], features[k])
    return True


@njit_internal
def _extract(remembered: Remembered, n: int, nominal: Struct, observation: StructArray, features: StructArray) -> None:
    memory, estimate, frames = remembered.memory[n], remembered.estimates[n], remembered.frames[n]
    force = observation[FORCE_COLUMN] * SCALES[FORCE_COLUMN]
    mean_force = observation[FORCE_MEAN_COLUMN] * SCALES[FORCE_MEAN_COLUMN]
    position = max(observation[POSITION_COLUMN] * SCALES[POSITION_COLUMN], 0.0)
    speed = observation[SPEED_COLUMN] * SCALES[SPEED_COLUMN]
    depth = max(observation[DEPTH_COLUMN] * SCALES[DEPTH_COLUMN], SHALLOWEST)
    target = position + observation[DISTANCE_COLUMN] * SCALES[DISTANCE_COLUMN]

    estimate_cut(memory, nominal, BladeReading(position, speed, depth, force), mean_force, estimate)
    left = target - estimate.tip
    reach = left - max(speed, 0.0) ** 2 / (2.0 * DECELERATION)  # less the way that the blade needs to stop

    k = len(observation)
    for i in range(k):
        features[i] = observation[i]
    features[k] = (target - estimate.nominal_tip) / _LENGTH
    features[k + 1] = (position - estimate.nominal_tip) / _LENGTH
    features[k + 2] = left / _LENGTH
    features[k + 3] = (position - estimate.tip) / _LENGTH
    features[k + 4] = tanh(left / _FINE)
    features[k + 5] = memory.probed
    features[k + 6] = memory.probed * (target - memory.located) / _LENGTH
    features[k + 7] = memory.probed * tanh((target - memory.located) / _FINE)
    features[k + 8] = memory.probed * (memory.furthest - memory.located) / _LENGTH
    features[k + 9] = log(memory.stiffness_ratio)
    features[k + 10] = memory.friction_per_depth / nominal.friction_per_depth - 1.0
    features[k + 11] = (memory.furthest - position) / _LENGTH
    features[k + 12] = force / depth / _FORCE_PER_DEPTH
    features[k + 13] = observation[FORCE_MAX_COLUMN] * SCALES[FORCE_MAX_COLUMN] / depth / _FORCE_PER_DEPTH
    features[k + 14] = estimate.elastic / (estimate.resistance * depth) - 1.0
    features[k + 15] = estimate.resistance / nominal.toughness_per_depth - 1.0
    features[k + 16] = estimate.run / _LENGTH
    features[k + 17] = (left - estimate.run) / _LENGTH
    features[k + 18] = tanh((left - estimate.run) / _FINE)
    features[k + 19] = tanh(reach / _FINE)
    features[k + 20] = tanh((reach - _NEAR) / _FINE)
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
