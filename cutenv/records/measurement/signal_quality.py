"""Signal quality: stuck or clipping sensor, gaps, sign, clock."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.special import erf, ndtr

from cutenv.records.measurement.segments import SMALLEST_DROP
from cutenv.records.measurement.strokes import STANDSTILL_SPEED, turning_points
from cutenv.sim.trace import Trace, blade_speed

Mask = NDArray[np.bool_]

SHORTEST_RECORD = 50  # smallest number of readings of a cut: a loading ramp takes 5 bins of 10 readings to be detected
STUCK_ODDS = 1e-4  # largest probability that noise leaves a reading of a good record repeated for so long [1]

STUCK_TRAVEL = 5e-3
"""Travel on new ground [m] during which the force of any cut changes: a unit of cutting is 5.9 mm (Table 4.1)."""

CLIPPED_TOPS = 3  # number of flat tops at the same largest reading that are not chance in a record without noise
GAP_STEPS = 10.0  # number of usual time steps beyond which a step is a gap, as in :class:`cutenv.sim.trace.Trace`
GAP_TRAVEL = 1e-3  # travel during a gap [m] beyond which the record is refused: a tenth of a unit of cutting is 0.6 mm

GAP_TIME = 0.1
"""Duration [s] of a gap beyond which a record without position is refused: 2.5 mm at the thesis's highest speed."""

UNEVEN_STEP, UNEVEN_SHARE = 0.5, 0.05
"""Limits of an irregular clock: more than 5 % of the steps differ from the usual one by more than half of it."""

SPEED_ERROR = 0.25  # relative difference between speed and change of position, beyond that of commanded speeds and lags
_MAX_EQUAL_READINGS = 20  # readings, and [ms] at 1 kHz, that may be equal in any record
_FLICKER = 0.4  # share of readings at which the force turns, above which noise covers the resolution
_COVERED = 2.0  # standard deviations of noise over resolution above which the force counts as continuous
_CAUTION = 0.6  # factor on the estimated noise, which is largest where it straddles a level
_MAX_DEVIATIONS = 3.7  # standard deviations of the largest of 10,000 normal numbers
_STEEPER = 4.0  # duration of a flat top over that of the rise before it: loading slows down by 2.5 at most
_LEVELS = 3.0  # height of that rise, in resolutions
_MIN_FLAT_READINGS = 5  # equal readings that can be a flat top
_NOISE_FREE = 0.05  # largest share of readings at which a force without noise turns
_PULL = 3.0  # ratio of lowest to highest force at which the force counts as reversed
_RISES = 2  # rises of force before a run that distinguish a cut from friction alone, which rises once
_ZERO = 0.1  # [N], or the share 0.02 of the largest force: below it, a sensor with a dead zone shows nothing


@dataclass(frozen=True, kw_only=True)
class QualityIssue:
    """One issue of signal quality in a record.

    Attributes
    ----------
    kind : str
        "short", "constant", "stuck", "clipping", "gap", "clock", "reversed" or "speed".
    rows : tuple of int
        First and last instant of the trace that show it, counted from 0.
    refuse : bool
        True if numbers from the record would be wrong; False for a mere warning.
    """

    kind: str
    rows: tuple[int, int]
    message: str
    refuse: bool


def quality_issues(trace: Trace) -> tuple[QualityIssue, ...]:
    """Check the signal quality of a record.

    Returns
    -------
    tuple of QualityIssue
        In order of time; empty for a good record.

    Notes
    -----
    A repeated reading is not an issue by itself: a sensor of coarse resolution repeats at rest, and so does a record
    without noise. How long noise lets a reading repeat follows from how often the force turns (noise that flickers
    between two levels turns at every other reading), and from the ratio of noise to resolution.
    """
    found = [*_short(trace), *_clock(trace), *_speed(trace)]
    if np.ptp(trace.force) == 0.0:
        found += _constant(trace)
    else:
        signal = _Signal.of(trace)
        clipped = _clipping(trace, signal)
        hidden = [range(flaw.rows[0], flaw.rows[1] + 1) for flaw in clipped]
        stuck = [flaw for flaw in _stuck(trace, signal) if not any(flaw.rows[0] in rows for rows in hidden)]
        found += [*clipped, *stuck, *_reversed(trace, signal)]
    return tuple(sorted(found, key=lambda flaw: flaw.rows))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Signal:
    """Force signal properties: equal runs, noise, resolution, advance."""

    starts: NDArray[np.intp]
    lengths: NDArray[np.intp]
    turning: float  # share of readings at which the force turns, without the longest run and the extremes
    resolution: float  # [force unit]
    noise: float  # noise over resolution [1]
    is_continuous: bool
    zero: float  # largest force that counts as none
    new_ground: Mask | None

    @classmethod
    def of(cls, trace: Trace) -> _Signal:
        force = trace.force
        changes = np.diff(force)
        starts = np.concatenate(([0], np.flatnonzero(changes) + 1)).astype(np.intp)
        lengths = np.diff(np.append(starts, len(force)))
        directions = np.sign(changes[changes != 0.0])
        extreme = (force[starts] == force.max()) | (force[starts] == force.min())
        extreme[np.argmax(lengths)] = True
        elsewhere = len(force) - int(lengths[extreme].sum())
        turning = float(np.count_nonzero(np.diff(directions))) / max(elsewhere, 1)
        resolution = float(np.median(np.diff(np.unique(force))))
        typical = float(np.median(np.abs(changes[changes != 0.0])))
        is_continuous = turning >= _FLICKER and typical > _COVERED * resolution
        return cls(
            starts=starts,
            lengths=lengths,
            turning=turning,
            resolution=resolution,
            # Of two readings one is on another level with a probability of 2/sqrt(pi) noise/resolution, on average;
            # three of four changes between levels reverse the one before.
            noise=_CAUTION * (turning / 0.75) * math.sqrt(math.pi) / 2.0,
            is_continuous=is_continuous,
            zero=_ZERO if trace.force_unit == "N" else 0.02 * float(np.abs(force).max()),
            new_ground=_new_ground(trace),
        )

    def longest_chance(self, repeats: float, n_readings: int, least: int) -> float:
        """Return the run length that noise exceeds once in `1/STUCK_ODDS` records."""
        if repeats <= 0.0:
            return least
        if repeats >= 1.0:
            return math.inf
        return max(least, math.log(STUCK_ODDS / n_readings) / math.log(repeats))


def _new_ground(trace: Trace) -> Mask | None:
    """Return a mask of forward motion beyond previous positions, or None."""
    if trace.position is None:
        return None
    reached = np.maximum.accumulate(trace.position)
    behind = reached - trace.position
    return np.asarray((trace.blade_speed > STANDSTILL_SPEED) & (behind <= STANDSTILL_SPEED))


def _short(trace: Trace) -> list[QualityIssue]:
    if len(trace) >= SHORTEST_RECORD:
        return []
    message = (
        f"the record has {len(trace)} readings, fewer than the {SHORTEST_RECORD} that show a ramp of loading. Record "
        "faster or longer."
    )
    return [QualityIssue(kind="short", rows=(0, len(trace) - 1), message=message, refuse=True)]


def _constant(trace: Trace) -> list[QualityIssue]:
    message = f"the force is {_shown(trace, 0)} at every instant. Check the sensor's cable, and the column."
    return [QualityIssue(kind="constant", rows=(0, len(trace) - 1), message=message, refuse=True)]


def _clock(trace: Trace) -> list[QualityIssue]:
    step = np.diff(trace.time)
    usual = float(np.median(step))
    found = []
    gaps = step > GAP_STEPS * usual
    gaps &= gaps.mean() <= UNEVEN_SHARE  # so many are no gaps: the readings come in bursts
    for i in np.flatnonzero(gaps).tolist():
        lost = f"{step[i]:.3g} s, {step[i] / usual:.0f} usual steps"
        if trace.position is not None:
            way = abs(float(trace.position[i + 1] - trace.position[i]))
            refuse, lost = way > GAP_TRAVEL, f"{lost} and {1e3 * way:.2g} mm of travel"
        else:
            refuse = bool(step[i] > GAP_TIME)
        message = f"nothing was recorded for {lost}. Record it again, or use the parts on either side."
        found.append(QualityIssue(kind="gap", rows=(i, i + 1), message=message, refuse=refuse))
    uneven = (np.abs(step - usual) > UNEVEN_STEP * usual) & ~gaps
    if uneven.mean() > UNEVEN_SHARE:
        first, last = _ends(uneven)
        message = (
            f"{uneven.mean():.0%} of the time steps differ by half from the usual {usual:.3g} s. Take the time from "
            "the sensor, not from the program that stores it."
        )
        found.append(QualityIssue(kind="clock", rows=(first, last + 1), message=message, refuse=False))
    return found


def _speed(trace: Trace) -> list[QualityIssue]:
    if trace.speed is None or trace.position is None:
        return []
    # Both over the same 50 ms, so that a lurch counts alike.
    travel = cumulative_trapezoid(trace.speed, trace.time, initial=0)
    said = blade_speed(trace.time, travel)
    moves = np.abs(said) > STANDSTILL_SPEED
    squares = float(said[moves] @ said[moves])
    if squares == 0.0:
        return []
    share = float(trace.blade_speed[moves] @ said[moves]) / squares
    if abs(share - 1.0) <= SPEED_ERROR:
        return []
    message = (
        f"the position changes {share:.2g} times as fast as the recorded speed. Check unit and sign of the speed "
        "(backward is negative), or leave it out."
    )
    return [QualityIssue(kind="speed", rows=_ends(moves), message=message, refuse=False)]


def _reversed(trace: Trace, signal: _Signal) -> list[QualityIssue]:
    """Find a force that pulls forward, or is mostly negative."""
    force, where = trace.force, signal.new_ground
    if where is not None:
        if np.count_nonzero(where) < SHORTEST_RECORD or float(force[where].mean()) > -signal.zero:
            return []
    else:
        low, high = np.percentile(force, (1.0, 99.0))
        if -low <= max(_PULL * high, signal.zero):
            return []
        where = force < 0.0
    place = "it is negative" if signal.new_ground is None else "the blade cuts"
    message = (
        f"the force is {force[where].mean():.2g}{_unit(trace)} on average where {place}: it counts positive against "
        "forward motion. Reverse its sign (force=-column), or subtract the sensor's offset."
    )
    return [QualityIssue(kind="reversed", rows=_ends(where), message=message, refuse=signal.new_ground is not None)]


def _ends(where: Mask) -> tuple[int, int]:
    """Return a mask's first and last instant."""
    first, last = np.flatnonzero(where)[[0, -1]]
    return int(first), int(last)


def _stuck(trace: Trace, signal: _Signal) -> list[QualityIssue]:
    """Find equal runs longer than noise or a cut allows."""
    few = max(_MAX_EQUAL_READINGS, round(_MAX_EQUAL_READINGS * 1e-3 * trace.sample_rate))
    if signal.is_continuous:
        by_noise = float(few)
    else:
        repeats = float(erf(1.0 / (2.0 * math.sqrt(2.0) * signal.noise))) if signal.noise > 0.0 else 1.0
        by_noise = signal.longest_chance(repeats, len(trace), few)
    found = []
    for k in np.flatnonzero(signal.lengths >= few).tolist():
        first, last = int(signal.starts[k]), int(signal.starts[k] + signal.lengths[k] - 1)
        travel = _travel(trace, signal, first, last)
        if abs(float(trace.force[first])) <= 2.0 * signal.zero and not _is_amid_cut(trace, signal, first, last, travel):
            continue  # a blade in the air, or a dead zone
        hangs_in_cut = travel >= STUCK_TRAVEL and _is_cutting(trace, signal, first)
        if signal.lengths[k] < by_noise and not hangs_in_cut:
            continue
        seconds = float(trace.time[last] - trace.time[first])
        way = None if trace.position is None else float(np.ptp(trace.position[first : last + 1]))
        message = (
            f"the sensor shows {_shown(trace, first)} for {seconds:.3g} s without a change"
            f"{f', while the blade moves {1e3 * way:.1f} mm' if way else ''}. Check it and record again."
        )
        refuse = way is None or way > GAP_TRAVEL
        found.append(QualityIssue(kind="stuck", rows=(first, last), message=message, refuse=refuse))
    return found


def _travel(trace: Trace, signal: _Signal, first: int, last: int) -> float:
    """Return travel on new ground [m], 0 without position."""
    if trace.position is None or signal.new_ground is None:
        return 0.0
    here = trace.position[first : last + 1][signal.new_ground[first : last + 1]]
    return float(np.ptp(here)) if len(here) else 0.0


def _is_amid_cut(trace: Trace, signal: _Signal, first: int, last: int, travel: float) -> bool:
    """Return True for missing force between forces in a cut."""
    loaded = np.abs(trace.force) > 2.0 * signal.zero
    return bool(travel > GAP_TRAVEL and loaded[:first].any() and loaded[last + 1 :].any())


def _is_cutting(trace: Trace, signal: _Signal, first: int) -> bool:
    """Return True if force rose and fell on new ground before."""
    assert signal.new_ground is not None
    before = trace.force[:first][signal.new_ground[:first]]
    swing = SMALLEST_DROP if trace.force_unit == "N" else signal.zero
    return len(turning_points(before, swing)) >= _RISES


def _clipping(trace: Trace, signal: _Signal) -> list[QualityIssue]:
    found = []
    for extreme in (float(trace.force.max()), float(trace.force.min())):
        if abs(extreme) <= signal.zero:
            continue
        runs = np.flatnonzero((trace.force[signal.starts] == extreme) & (signal.lengths >= _MIN_FLAT_READINGS))
        flat = np.union1d(
            _tops_beyond_noise(trace, signal, runs),
            _tops_beyond_slope(trace, signal, runs, math.copysign(1.0, extreme)),
        )
        if not len(flat):
            continue
        message = (
            f"the force stays at its {'largest' if extreme > 0.0 else 'lowest'} reading, {extreme:.4g}{_unit(trace)}, "
            f"{len(flat)} times, {int(signal.lengths[flat].sum())} readings in all: the sensor or its amplifier is at "
            "its limit. Choose a larger range and record again."
        )
        rows = (int(signal.starts[flat[0]]), int(signal.starts[flat[-1]] + signal.lengths[flat[-1]] - 1))
        found.append(QualityIssue(kind="clipping", rows=rows, message=message, refuse=True))
    return found


def _tops_beyond_noise(trace: Trace, signal: _Signal, runs: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return runs at the extreme that noise would have exceeded.

    Where the blade stands all the time, its force may rest: noise below the resolution need not show.
    """
    if signal.turning < _NOISE_FREE:
        return runs[:0]
    if signal.is_continuous:
        longest = float(_MIN_FLAT_READINGS)
    else:
        repeats = float(ndtr(1.0 / signal.noise - _MAX_DEVIATIONS))
        longest = signal.longest_chance(repeats, len(trace), _MIN_FLAT_READINGS)
    runs = runs[signal.lengths[runs] >= longest]
    if trace.position is None:
        return runs
    ends = np.minimum(signal.starts[runs] + signal.lengths[runs], len(trace) - 1)
    standing = STANDSTILL_SPEED * longest * float(np.median(np.diff(trace.time)))
    moves: Mask = np.abs(trace.position[ends] - trace.position[signal.starts[runs]]) >= standing
    return runs[moves]


def _tops_beyond_slope(trace: Trace, signal: _Signal, runs: NDArray[np.intp], sign: float) -> NDArray[np.intp]:
    """Return runs at the extreme that outlast a steady rise."""
    force = sign * trace.force
    flat = []
    for k in runs.tolist():
        first, length = int(signal.starts[k]), int(signal.lengths[k])
        lead = max(2, round(length / _STEEPER))
        if first < lead:
            continue
        rise, half = (float(force[first] - force[first - before]) for before in (lead, lead // 2))
        steady = rise >= _LEVELS * signal.resolution and 0.25 * rise <= half <= 0.75 * rise  # friction alone jumps
        if steady and (signal.new_ground is None or bool(signal.new_ground[first : first + length // 2].all())):
            flat.append(k)
    return np.array(flat if len(flat) >= CLIPPED_TOPS else [], dtype=np.intp)


def _shown(trace: Trace, i: int) -> str:
    return f"{trace.force[i]:.4g}{_unit(trace)}"


def _unit(trace: Trace) -> str:
    return " N" if trace.force_unit == "N" else ""
