"""Samples at a fixed rate, at which force and motion of records of any rate are compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from cutenv._base.arrays import Array
from cutenv.scoring.unavailable import Unavailable
from cutenv.scoring.validity import LONGEST_RECORD
from cutenv.trace import Trace

RATE = 100.0
"""Rate at which force and motion are compared [Hz]: a hand moves below 10 Hz."""
BANDWIDTH = 5.0
"""Low-pass cut-off of the force for its rate and jerk [Hz]: Butterworth of order 2, forward and backward, no delay."""
SHORTEST_FORCE = 30
"""Samples at :data:`RATE` that a change at :data:`BANDWIDTH` needs."""
_FEWEST_HZ = 20.0  # readings a second, below which 5 Hz cannot be resolved
_UNDER_FORCE = 0.1  # fraction of the rise from the unloaded force to the peak at which a cut without position begins
_AT_ENDS = 5  # samples at 100 Hz averaged at either end


def even_instants(time: Array, rate: float) -> Array:
    """Return sampling instants at ``rate`` [Hz] from the first of ``time`` [s], as many as fit.

    Raises
    ------
    Unavailable
        If the time is longer than an hour.
    """
    span = float(time[-1] - time[0])
    if span > LONGEST_RECORD:
        raise Unavailable(f"it lasts {span:.3g} s, more than an hour")
    # The tolerance keeps rounding from deciding about the last instant when a clock starts at another time.
    return np.asarray(float(time[0]) + np.arange(int(span * rate + 1e-3) + 1) / rate)


def even_centres(time: Array) -> Array:
    """Return the centres of the windows of 10 ms that fit into ``time`` [s]; shape (m,).

    Raises
    ------
    Unavailable
        If the time is longer than an hour.
    """
    return even_instants(time, RATE)[:-1] + 0.5 / RATE


def even_means(trace: Trace) -> Array:
    """Return the force at 100 Hz, means over 10 ms, in the trace's unit; shape (m,) of :func:`even_centres`.

    Raises
    ------
    Unavailable
        If the record is too short, too long, or has too few readings a second.
    """
    if trace.sample_rate < _FEWEST_HZ:
        raise Unavailable(f"fewer than {_FEWEST_HZ:g} readings a second")
    instants = even_instants(trace.time, RATE)
    if len(instants) - 1 < SHORTEST_FORCE:
        raise Unavailable("shorter than 0.3 s")
    # Means over 10 ms, so that noise above 50 Hz is not aliased to lower frequencies.
    impulse = cumulative_trapezoid(trace.force, trace.time, initial=0)
    return np.asarray(np.diff(np.interp(instants, trace.time, impulse)) * RATE)


def smoothed(values: Array) -> Array:
    """Return values at 100 Hz, low-pass filtered at :data:`BANDWIDTH` without delay, of the same shape."""
    return np.asarray(sosfiltfilt(butter(2, BANDWIDTH, fs=RATE, output="sos"), values))


def under_force(time: Array, even_time: Array, smooth: Array) -> NDArray[np.bool_]:
    """Return the mask of the instants ``time`` [s] from the first force to the last, shape (n,).

    ``smooth`` is the force at ``even_time`` [s], both of shape (m,), in any unit.

    Raises
    ------
    Unavailable
        If the force never rises.
    """
    least = float(min(smooth[:_AT_ENDS].mean(), smooth[-_AT_ENDS:].mean()))
    under = even_time[smooth > least + _UNDER_FORCE * (float(smooth.max()) - least)]
    if not len(under):
        raise Unavailable("the force never rises")
    window = 1.5 / RATE  # an even sample stands for its window, the first and the last for the record's ends
    return np.asarray((time >= under[0] - window) & (time <= under[-1] + window))
