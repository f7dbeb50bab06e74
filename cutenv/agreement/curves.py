"""Two records of the same cut beside each other: force along the way, position along the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv.trace import Trace

Array = NDArray[np.float64]

STEP = 1e-4
"""Of the positions at which forces are compared [m]."""
_RETREAT = 1e-4  # [m] back from the furthest point: an encoder's flicker is less
_SHORTEST = 0.005  # [m] of common way, below which nothing is compared
_TIME_STEP = 0.005  # [s]: a rig's positions come so often


def force_over_position(trace: Trace) -> tuple[Array, Array]:
    """Force where the blade first came to each position, up to its first retreat.

    Parameters
    ----------
    trace : Trace
        With position.

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
    """First less second force at equal positions of the blade, up to the first retreat of either.

    Parameters
    ----------
    first, second : Trace
        With position.
    displaced : float
        By which the second is taken to lie farther from the clamp than it does [m].

    Returns
    -------
    ndarray of shape (n,) or None
        In the traces' unit, ``STEP`` apart; None if they have less than 5 mm in common.
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
    """Root mean square of :func:`force_difference`."""
    difference = force_difference(first, second, displaced=displaced)
    return None if difference is None else rms(difference)


def force_offset(first: Trace, second: Trace) -> float | None:
    """Size of the mean of :func:`force_difference`: a zero that wanders, where runs of the crack cancel out."""
    difference = force_difference(first, second)
    return None if difference is None else abs(float(difference.mean()))


def position_rmse(first: Trace, second: Trace) -> float | None:
    """Root mean square of the difference of position at equal times since the start, as long as both cuts last [m].

    Returns
    -------
    float or None
        None if they have less than 0.1 s in common.
    """
    time, position = first.require("time", "position", by="position_rmse")
    other_time, other = second.require("time", "position", by="position_rmse")
    low, high = max(time[0], other_time[0]), min(time[-1], other_time[-1])
    if high - low < 20 * _TIME_STEP:
        return None
    common = np.arange(low, high, _TIME_STEP)
    return rms(np.interp(common, time, position) - np.interp(common, other_time, other))


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
