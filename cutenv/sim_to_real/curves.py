"""Differences of two records of the same cut: force over position, position and height over time."""

from __future__ import annotations

import math

import numpy as np

from cutenv._base.arrays import Array
from cutenv.trace import PLACE, Trace

STEP = 1e-4
"""Spacing of the positions at which forces are compared [m]."""
_RETREAT = 1e-4  # [m] behind the furthest point: the flicker of an encoder is smaller
_SHORTEST = 0.005  # [m], shortest common length that is compared
_TIME_STEP = 0.005  # [s], interval of a rig's positions


def force_over_position(trace: Trace) -> tuple[Array, Array]:
    """Return the force where the blade first reached each position, up to its first retreat.

    Parameters
    ----------
    trace : Trace
        Record with position.

    Returns
    -------
    tuple of ndarray, each of shape (n,)
        Positions [m], ``STEP`` apart, and forces in the trace's unit.

    Raises
    ------
    ValueError
        If the trace holds no position.
    """
    force, position = trace.require("force", "position", by="force_over_position")
    furthest = np.maximum.accumulate(position)
    back = np.flatnonzero(position < furthest - _RETREAT)
    stop = len(position) if len(back) == 0 else int(np.argmax(position[: back[0]])) + 1
    new = np.flatnonzero(np.diff(furthest[:stop], prepend=-np.inf) > 0.0)
    at = np.arange(np.ceil(position[new[0]] / STEP), np.floor(furthest[stop - 1] / STEP) + 1) * STEP
    return at, np.interp(at, position[new], force[new])


def force_difference(first: Trace, second: Trace, *, displaced: float = 0.0) -> Array | None:
    """Return first minus second force at equal positions of the blade, up to the first retreat of either.

    Parameters
    ----------
    first, second : Trace
        Records with position.
    displaced : float
        Distance by which the second is shifted away from the clamp [m].

    Returns
    -------
    ndarray of shape (n,) or None
        Difference in the traces' unit, ``STEP`` apart; None if they have less than 5 mm in common.
    """
    (at, force), (other_at, other) = force_over_position(first), force_over_position(second)
    if not len(at) or not len(other_at):
        return None
    other_at = other_at + displaced
    low, high = max(at[0], other_at[0]), min(at[-1], other_at[-1])
    if high - low < _SHORTEST:
        return None
    common = np.arange(low, high, STEP)
    return np.interp(common, at, force) - np.interp(common, other_at, other)


def force_rmse(first: Trace, second: Trace, *, displaced: float = 0.0) -> float | None:
    """Return the root mean square of :func:`force_difference`."""
    difference = force_difference(first, second, displaced=displaced)
    return None if difference is None else rms(difference)


def force_offset(first: Trace, second: Trace) -> float | None:
    """Return the absolute mean of :func:`force_difference`: it shows a drifting zero; crack runs cancel out."""
    difference = force_difference(first, second)
    return None if difference is None else abs(float(difference.mean()))


def position_rmse(first: Trace, second: Trace) -> float | None:
    """Return the root mean square difference of position at equal times since the start [m].

    Returns
    -------
    float or None
        Over the time that both cuts last; None if they have less than 0.1 s in common.
    """
    return _rmse_over_time(first, second, "position")


def height_rmse(first: Trace, second: Trace) -> float | None:
    """Return the root mean square difference of height at equal times since the start [m].

    Returns
    -------
    float or None
        None if one has no height, or they have less than 0.1 s in common.
    """
    if first.height is None or second.height is None:
        return None
    return _rmse_over_time(first, second, "height")


def place_rmse(first: Trace, second: Trace) -> float | None:
    """Return the root mean square distance between two blades in the plane at equal times since the start [m].

    Returns
    -------
    float or None
        None if one has no places, or they have less than 0.1 s in common.
    """
    if first.blade_x is None or second.blade_x is None:
        return None
    x, y = (_rmse_over_time(first, second, name) for name in PLACE)
    return None if x is None or y is None else math.hypot(x, y)


def _rmse_over_time(first: Trace, second: Trace, name: str) -> float | None:
    time, own = first.require("time", name, by=f"{name}_rmse")
    other_time, other = second.require("time", name, by=f"{name}_rmse")
    low, high = max(time[0], other_time[0]), min(time[-1], other_time[-1])
    if high - low < 20 * _TIME_STEP:
        return None
    common = np.arange(low, high, _TIME_STEP)
    return rms(np.interp(common, time, own) - np.interp(common, other_time, other))


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
