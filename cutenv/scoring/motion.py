"""Metrics of the motion. Smoothness is reported and never rewarded: a perfect constant feed scores badly on it."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.measurement.strokes import STANDSTILL_SPEED, strokes
from cutenv.scoring.even_samples import RATE, even_instants
from cutenv.scoring.metric import metric
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.unavailable import Unavailable

_PADDING = 0.1  # rest added at either end, as a fraction of the movement: smoothness is defined from rest to rest
_PAD_LEVEL = 4  # zero padding for the spectrum: 2^4 times the movement's length
_CUT_OFF, _THRESHOLD = 10.0, 0.05  # [Hz]; fraction of the largest amplitude
_MOTION = ("position",)


@metric(
    "s", "lower", formula="from the first motion to the last, or from the first force", source="cost of the task",
    validity="without position: while the force is above a tenth of its range",
    invariances=("time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"),
)  # fmt: skip
def duration(cut: ScoredCut) -> float:
    """Duration of the cut."""
    if cut.trace.position is None:
        under = cut.time[cut.advancing]
        return float(under[-1] - under[0])
    first, last, _ = moving_between(cut)
    return float(cut.time[last] - cut.time[first])


@metric(
    "s", "lower", formula="time below 0.5 mm/s between the first motion and the last", source="motion analysis",
    validity="speed from position over 50 ms", needs=_MOTION,
    invariances=("time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"),
)  # fmt: skip
def idle_time(cut: ScoredCut) -> float:
    """Time for which the blade stood still before it went on."""
    first, last, moving = moving_between(cut)
    return float(cut.weights[first : last + 1] @ ~moving[first : last + 1])


@metric(
    "1", "lower", formula="strokes that go the other way than the one before", source="motion analysis",
    validity="strokes of 0.2 mm and more", needs=_MOTION,
    invariances=("time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"),
)  # fmt: skip
def reversals(cut: ScoredCut) -> float:
    """Reversals of the blade's motion."""
    _ = cut.position  # raises if it was not recorded
    found = strokes(cut.trace)
    return float(sum(a.forward != b.forward for a, b in itertools.pairwise(found)))


@metric(
    "1", "none", formula="minus the arc length of the speed's normalised spectrum, to 10 Hz", validity="rest to rest",
    source="Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9", needs=_MOTION,
    invariances=("time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"),
)  # fmt: skip
def sparc(cut: ScoredCut) -> float:
    """Smoothness of the motion, by the spectral arc length (SPARC)."""
    return spectral_arc_length(_rest_to_rest(cut), RATE)


@metric(
    "1", "none", formula="-ln(T^3 / v_peak^2 integral of (d2v/dt2)^2 dt)", validity="rest to rest",
    source="Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9", needs=_MOTION,
    invariances=("time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"),
)  # fmt: skip
def log_dimensionless_jerk(cut: ScoredCut) -> float:
    """Smoothness of the motion, by its jerk (LDLJ)."""
    return log_jerk(_rest_to_rest(cut), RATE)


def spectral_arc_length(speed: Array, rate: float) -> float:
    """Compute the SPARC of a speed profile, shape (n,), at ``rate`` [Hz]; 0 is smoothest.

    Raises
    ------
    Unavailable
        If it does not move.
    """
    n = int(2 ** (np.ceil(np.log2(len(speed))) + _PAD_LEVEL))
    frequency = np.arange(0, rate, rate / n)
    amplitude = np.abs(np.fft.fft(speed, n))
    if amplitude.max() == 0.0:
        raise Unavailable("the blade does not move")
    amplitude = amplitude / amplitude.max()
    inside = frequency <= _CUT_OFF
    frequency, amplitude = frequency[inside], amplitude[inside]
    above = np.flatnonzero(amplitude >= _THRESHOLD)
    frequency, amplitude = frequency[above[0] : above[-1] + 1], amplitude[above[0] : above[-1] + 1]
    span = float(frequency[-1] - frequency[0])
    if span == 0.0:
        raise Unavailable("too short a movement for a spectrum")
    return -float(np.sum(np.hypot(np.diff(frequency) / span, np.diff(amplitude))))


def log_jerk(speed: Array, rate: float) -> float:
    """Compute the LDLJ of a speed profile, shape (n,), at ``rate`` [Hz]; larger is smoother.

    Raises
    ------
    Unavailable
        If it does not move, or moves without any jerk.
    """
    peak = float(np.abs(speed).max())
    if peak == 0.0 or len(speed) < 4:
        raise Unavailable("the blade does not move")
    dt = 1.0 / rate
    jerk = np.diff(speed, 2) / dt**2
    total = float(np.sum(jerk**2)) * dt
    if total == 0.0:
        raise Unavailable("the motion has no jerk at all")
    return -float(np.log((len(speed) * dt) ** 3 / peak**2 * total))


def moving_between(cut: ScoredCut) -> tuple[int, int, NDArray[np.bool_]]:
    """Return the first and last instant of motion, and a mask of motion at each instant, shape (n,)."""
    moving = _moving(cut)
    first, last = np.flatnonzero(moving)[[0, -1]]
    return int(first), int(last), moving


def _moving(cut: ScoredCut) -> NDArray[np.bool_]:
    moving: NDArray[np.bool_] = np.abs(cut.blade_speed) > STANDSTILL_SPEED
    if not moving.any():
        raise Unavailable("the blade never moves")
    return moving


def _rest_to_rest(cut: ScoredCut) -> Array:
    """Return the speed at 100 Hz [m/s] from the first motion to the last, with a little rest at either end."""
    first, last, _ = moving_between(cut)
    instants = even_instants(cut.time[first : last + 1], RATE)
    if len(instants) < 30:
        raise Unavailable("shorter than 0.3 s")
    speed = np.interp(instants, cut.time, cut.blade_speed)
    rest = np.zeros(max(3, round(_PADDING * len(speed))))
    return np.concatenate((rest, speed, rest))
