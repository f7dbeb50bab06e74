"""Values of observations in SI units, by column, and actions of many cuts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, Array32
from cutenv.task.observation import (
    ANGLE_CENTRE,
    ANGLE_SCALE,
    COMPONENTS,
    OFFSETS,
    SCALES,
    checked_observation,
    speed_action,
)

_COLUMNS = {component.name: k for k, component in enumerate(COMPONENTS)}
FORCE_COLUMN, FORCE_MEAN_COLUMN, FORCE_MIN_COLUMN, FORCE_MAX_COLUMN = (
    _COLUMNS[name] for name in ("force", "force_mean", "force_min", "force_max")
)
POSITION_COLUMN, SPEED_COLUMN, ANGLE_COLUMN, DEPTH_COLUMN, DISTANCE_COLUMN = (
    _COLUMNS[name] for name in ("position", "speed", "angle", "depth", "distance")
)
"""Columns of an observation, for compiled code and arrays."""


def in_si(observations: ArrayLike) -> Array:
    """Return observations, shape (n, 12), in SI units; raise ValueError for a wrong shape or a number not finite."""
    values: Array = checked_observation(observations) * SCALES + OFFSETS
    return values


def to_actions(speeds: Array, angles: Array | float) -> Array32:
    """Return actions, shape (n, 2) float32 in [-1, 1], for speeds [m/s], shape (n,), and angles [rad]; clipped."""
    actions = np.empty((len(speeds), 2), np.float32)
    actions[:, 0], actions[:, 1] = speed_action(speeds), (angles - ANGLE_CENTRE) / ANGLE_SCALE
    return np.clip(actions, -1.0, 1.0, out=actions)


def choose(condition: NDArray[np.bool_], actions: Array32, others: Array32) -> Array32:
    """Return ``actions`` where the condition, shape (n,), holds, else ``others``; shape (n, 2)."""
    chosen: Array32 = np.where(condition[:, None], actions, others)
    return chosen
