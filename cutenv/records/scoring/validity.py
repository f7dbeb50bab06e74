"""Validity of a record for scoring, and fixed-rate samples.

A record is not valid with bad force, if it is truncated, or with two cuts in one. Lurches of the blade where the force
falls suddenly tell about its position and clock.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from cutenv._base.arrays import Array
from cutenv.records.measurement import QualityIssue
from cutenv.records.measurement.signal_faults import Readings, smoothness, spike_rows
from cutenv.records.measurement.strokes import END_SPEED, END_WINDOW, STANDSTILL_SPEED
from cutenv.sim.trace import Trace


class Unavailable(ValueError):
    """Reason why a metric cannot be computed from a cut."""


LONGEST_RECORD = 3600.0  # longest record that is scored [s]
_OPEN = 0.015  # [m] behind the furthest point the crack is open: the tip never lags the blade by that much
_MAX_SPEED = 2.0  # [m/s], the greatest speed of a blade
_REPEATED_CRACK = 0.010  # [m] of open crack crossed under force that count as another cut
_LOADED = 0.5  # fraction of the force at the first passage: friction is a fifth, and at most two fifths
_NOTHING = 0.1  # [N], or 0.05 of the range of force: reading of a sensor without contact
_EACH_ALONE = ": two cuts in one record. Save each in a file of its own, or number their rows in a column 'cut'"
_PLACE = 1e-3  # [m], bin width for comparing the forces of two passages
_UNLOADED = 0.25  # fraction of the largest force below which a record without position counts as unloaded
_LOADED_FOR = 0.3  # [s] of load on either side of such a pause
_PAUSE = 1.5  # [s] without force between loads, the same as for dividing long records into cuts


def force_unusable(trace: Trace, quality: Sequence[QualityIssue]) -> str:
    """Return why the force is unusable, or ""."""
    if trace.duration > LONGEST_RECORD:
        return f"the record lasts {trace.duration:.3g} s, more than an hour; time is in seconds, and one cut a record"
    said = [flaw.message for flaw in quality if flaw.refuse or flaw.kind == "reversed"]
    return " ".join(said).rstrip(".")


def is_truncated(trace: Trace) -> str:
    """Return why a record whose metadata name no end is truncated, or ""."""
    if trace.position is None or trace.metadata.get("end") is not None:
        return ""
    first = min(int(np.searchsorted(trace.time, trace.time[-1] - END_WINDOW)), len(trace) - 2)
    speed = float((trace.position[-1] - trace.position[first]) / (trace.time[-1] - trace.time[first]))
    if abs(speed) < END_SPEED:
        return ""
    return (
        f"the record ends while the blade moves at {1e3 * speed:.2g} mm/s: record until it stands; or, if the cut was "
        'complete, write so in the metadata of a file of cutenv\'s own format: end="finished"'
    )


def starts_late(trace: Trace) -> str:
    """Return why a record misses its cut's beginning, or ""."""
    if trace.position is None:
        return ""
    last = max(int(np.searchsorted(trace.time, trace.time[0] + END_WINDOW)), 1)
    last = min(last, len(trace) - 1)
    speed = float((trace.position[last] - trace.position[0]) / (trace.time[last] - trace.time[0]))
    nothing = _NOTHING if trace.force_unit == "N" else 0.05 * float(np.ptp(trace.force))
    if speed < END_SPEED or float(trace.force[: last + 1].min()) < 2.0 * nothing:
        return ""
    return (
        f"the record begins under force while the blade moves at {1e3 * speed:.2g} mm/s: start it before the blade "
        "touches the tissue"
    )


def holds_two_cuts(trace: Trace) -> str:
    """Return why a record holds more than one cut, or "".

    "" if it does not, or if there is no position.

    A cut never heals: in the open crack the blade meets only friction.
    """
    if trace.position is None:
        return ""
    x, F = trace.position, trace.force
    back, usual = -np.diff(x), float(np.median(np.diff(trace.time)))
    if (restarts := np.flatnonzero(back > max(_OPEN, _MAX_SPEED * usual))).size:
        i = int(restarts[0])
        return (
            f"the blade is {1e3 * back[i]:.3g} mm further back from one reading to the next, at "
            f"{trace.time[i + 1]:.3g} s{_EACH_ALONE}"
        )
    furthest = np.maximum.accumulate(x)
    forward = trace.blade_speed > STANDSTILL_SPEED
    again = forward & (x < furthest - _OPEN)
    first = forward & (x >= furthest - 1e-4)
    if not again.any() or not first.any():
        return ""
    places = np.arange(float(x.min()), float(x.max()) + _PLACE, _PLACE)
    before, after = _by_place(x, F, first, places), _by_place(x, F, again, places)
    known = np.isfinite(before) & np.isfinite(after)
    nothing = _NOTHING if trace.force_unit == "N" else 0.05 * float(np.ptp(F))
    loaded = known & (np.nan_to_num(after) > np.maximum(_LOADED * np.nan_to_num(before), nothing))
    if np.count_nonzero(loaded) * _PLACE < _REPEATED_CRACK:
        return ""
    place = float(places[np.flatnonzero(loaded)[0]])
    return f"the blade cuts again at {100 * place:.1f} cm, where it had cut before{_EACH_ALONE}"


def without_spikes(trace: Trace) -> tuple[Trace, str]:
    """Return a record without position spikes, and the omissions in words.

    A spike is one reading, or two, far from those on either side; it is replaced by what is usual there.
    """
    if trace.position is None:
        return trace, ""
    found, usual = spike_rows(Readings(time=trace.time, force=trace.force, position=trace.position))
    if not found:
        return trace, ""
    rows = np.concatenate(found)
    force = trace.force.copy()
    force[rows] = usual[rows]
    top = int(rows[np.argmax(np.abs(trace.force - usual)[rows])])
    number = "one reading" if len(rows) == 1 else f"{len(rows)} readings"
    said = (
        f"record: {number} left out, {trace.force[top]:.3g} {trace.force_unit.replace('1', '')} at "
        f"{trace.time[top]:.3g} s among {usual[top]:.2g}: look at cable and connector"
    )
    return dataclasses.replace(trace, force=force), said


SLOWEST_SCORED = 25.0
"""Readings a second below which runs of the crack and lurches of the blade cannot be told from slow growth [Hz]."""
_SMOOTHED = 0.25  # smoothness of a force below which a filter has taken the runs out; honest records have 0.37 and more
_LEAST_LOAD, _OVER_NOISE = 0.05, 6.0  # [N], and multiple of the noise, by which a blade in tissue is loaded
_LEAST_WORK, _MOST_WORK = 0.2, 8.0  # of the mean tissue's fracture energy; a factor of three in tissue, two in friction
_LEVEL, _AT_LEVEL = 0.015, 0.25  # of the range below the largest force; share of the way there: 0.08 in any cut
_CUT = 0.010  # [m] of cut from which its work tells
_NOISE, _SLOW_NOISE = 0.15, 0.1  # [N] of one reading, and of a mean over 20 ms, that hide short runs
_AHEAD = 1.5e-3  # [m] by which a tip may be noted ahead of all places of the blade; simulated ones never are


def unseen(trace: Trace) -> str:
    """Return why runs and lurches cannot be seen, or ""."""
    if trace.sample_rate < SLOWEST_SCORED:
        return (
            f"{trace.sample_rate:.3g} readings a second are too few to see how the tissue runs and the blade lurches: "
            f"record {SLOWEST_SCORED:g} or more, better 100"
        )
    smooth = smoothness(Readings(time=trace.time, force=trace.force))
    if smooth is not None and smooth[0] < _SMOOTHED:
        return (
            f"nothing in the force changes faster than some {smooth[1]:.2g} Hz: a filter has taken out what is scored. "
            "Take the filter of amplifier or program out, or set it to a fifth of the readings a second"
        )
    return ""


def noisy(trace: Trace, even: Array) -> str:
    """Return why noise hides short crack runs, or "".

    "" if it does not.

    ``even`` is the force at 100 Hz, means over 10 ms [N], shape (m,): slower noise is seen in its means alone.
    """
    each = Readings(time=trace.time, force=trace.force).noise
    slow = even[: len(even) // 2 * 2].reshape(-1, 2).mean(axis=1)
    mean = Readings(time=np.arange(0.0, len(slow)) * 2.0 / RATE, force=slow).noise
    if each <= _NOISE and mean <= _SLOW_NOISE:
        return ""
    return (
        f"the force has a noise of {max(each, mean):.2g} N, which hides how the tissue runs: look at cable and "
        f"amplifier, or take a sensor of less than {_NOISE:g} N of noise"
    )


def levelled(even: Array) -> str:
    """Return why an advancing force is implausible, or "".

    The force at 100 Hz has shape (m,). A sensor or amplifier at its limit still has noise, which hides that the
    readings are the same.
    """
    share = float(np.mean(even > even.max() - _LEVEL * np.ptp(even)))
    if share < _AT_LEVEL:
        return ""
    return (
        f"the force stays at its largest for {share:.0%} of the way: the sensor or its amplifier is at its limit. "
        "Choose a larger range"
    )


def never_loaded(smooth: Array, even: Array, advancing: NDArray[np.bool_]) -> str:
    """Return why an advancing blade cuts nothing, or "" if it cuts.

    The force [N] is at 100 Hz, below 5 Hz (`smooth`), and as means over 10 ms (`even`).
    """
    noise = Readings(time=np.arange(len(even)) / RATE, force=even).noise
    rises = float(np.percentile(smooth[advancing], 95.0) - np.percentile(smooth, 2.0))
    if rises > max(_LEAST_LOAD, _OVER_NOISE * noise):
        return ""
    return f"no cut: the force rises by {max(rises, 0.0):.2g} N at most while the blade advances, so it is in the air"


def noted_ahead(tip: float, position: Array) -> str:
    """Return why a noted tip [m] is impossibly ahead, or ""."""
    ahead = tip - float(position.max())
    if ahead <= _AHEAD:
        return ""
    return f"the tip is noted {1e3 * ahead:.2g} mm ahead of where the blade has been, and none runs ahead of its blade"


def implausible_work(ratio: float, tip: float) -> str:
    """Return why work shows a force not in newtons, or "".

    `ratio` is the work over the fracture energy of the mean tissue, `tip` where the crack tip ended [m].
    """
    if tip < _CUT or _LEAST_WORK <= ratio <= _MOST_WORK:
        return ""
    return (
        f"the force does {ratio:.2g} times the work that cutting this tissue takes, and any cut of it does "
        f"{_LEAST_WORK:g} to {_MOST_WORK:g} times: check that it is in newtons, and its zero; another tissue needs "
        "--tissue"
    )


def validity_warnings(trace: Trace, quality: Sequence[QualityIssue]) -> list[str]:
    """Return warnings about a record that can be scored."""
    said = [f"record: {flaw.message.rstrip('.')}" for flaw in quality if not flaw.refuse]
    if trace.position is None:
        said += _remarks_on_force(trace)
    return said


def _remarks_on_force(trace: Trace) -> list[str]:
    F, time = trace.force, trace.time
    before, after = float(F[time <= time[0] + END_WINDOW].mean()), float(F[time >= time[-1] - END_WINDOW].mean())
    zero = min(before, after)
    level = zero + _UNLOADED * (float(F.max()) - zero)
    said = []
    if after > level:
        said.append("record: it ends under force; if it was truncated, the cut was longer than this")
    loaded = np.flatnonzero(level < F)
    if len(loaded) > 1:
        pauses = np.diff(time[loaded])
        i = int(np.argmax(pauses))
        if pauses[i] > _PAUSE and min(i + 1, len(loaded) - i - 1) >= _LOADED_FOR * trace.sample_rate:
            said.append(
                f"record: no force for {pauses[i]:.1f} s between loads; if these are two cuts, score each alone"
            )
    return said


def _by_place(x: Array, F: Array, chosen: NDArray[np.bool_], places: Array) -> Array:
    """Return the chosen instants' mean force by bin, (n,), or NaN."""
    where = np.digitize(x[chosen], places) - 1
    count = np.bincount(where, minlength=len(places))[: len(places)]
    total = np.bincount(where, weights=F[chosen], minlength=len(places))[: len(places)]
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


RATE = 100.0  # rate at which force and motion are compared [Hz]: a hand moves below 10 Hz
BANDWIDTH = 5.0
"""Low-pass cut-off of the force for its rate and jerk [Hz]: Butterworth of order 2, forward and backward, no delay."""
SHORTEST_FORCE = 30  # samples at :data:`RATE` that a change at :data:`BANDWIDTH` needs
_FEWEST_HZ = 20.0  # readings a second, below which 5 Hz cannot be resolved
_UNDER_FORCE = 0.1  # fraction of the rise from the unloaded force to the peak at which a cut without position begins
_AT_ENDS = 5  # samples at 100 Hz averaged at either end


def even_instants(time: Array, rate: float) -> Array:
    """Return instants at ``rate`` [Hz] from ``time``'s first [s]."""
    span = float(time[-1] - time[0])
    if span > LONGEST_RECORD:
        raise Unavailable(f"it lasts {span:.3g} s, more than an hour")
    # The tolerance keeps rounding from deciding about the last instant when a clock starts at another time.
    return np.asarray(float(time[0]) + np.arange(int(span * rate + 1e-3) + 1) / rate)


def even_centres(time: Array) -> Array:
    """Return centres of 10 ms windows within ``time`` [s], shape (m,)."""
    return even_instants(time, RATE)[:-1] + 0.5 / RATE


def even_means(trace: Trace) -> Array:
    """Return the force at 100 Hz by 10 ms means, shape (m,).

    The means are in the trace's unit, at :func:`even_centres`.
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
    """Return 100 Hz values low-pass filtered at :data:`BANDWIDTH` without delay."""
    from scipy.signal import butter, sosfiltfilt  # a third of a second, which every command that scores would wait

    return np.asarray(sosfiltfilt(butter(2, BANDWIDTH, fs=RATE, output="sos"), values))


def under_force(time: Array, even_time: Array, smooth: Array) -> NDArray[np.bool_]:
    """Return a mask of ``time`` [s] from first to last force, (n,).

    ``smooth`` is the force at ``even_time`` [s], both of shape (m,), in any unit.
    """
    least = float(min(smooth[:_AT_ENDS].mean(), smooth[-_AT_ENDS:].mean()))
    under = even_time[smooth > least + _UNDER_FORCE * (float(smooth.max()) - least)]
    if not len(under):
        raise Unavailable("the force never rises")
    window = 1.5 / RATE  # an even sample stands for its window, the first and the last for the record's ends
    return np.asarray((time >= under[0] - window) & (time <= under[-1] + window))


LURCH_SPEED = 0.02
"""Speed beyond the usual that a blade on a drive never has where the force falls suddenly, and in a hand has [m/s]."""
_SUDDEN, _SUDDEN_SHARE = 0.1, 0.1  # [N], and share of the range, by which a force falls within 20 ms
_BEFORE, _AFTER, _AFTERWARDS = 5, 20, 40  # samples at 100 Hz around such a fall: of the lurch, and until it is over
_EARLIER = 30  # samples at 100 Hz before it, of which those up to 10 before are without a lurch
_WAY = 0.8e-3  # [m] of a lurch
_SHARPEST_SMOOTHED = 10.0  # [1/s], sharpness of lurches below which they are no hand's: honest ones have 17 and more
_FINE = 1000  # samples a second at which a lurch is looked at closely
_FALL, _SPEED = 4, 5  # such samples over which the force falls, and over which the largest speed is taken
_USUAL, _STARTS, _LASTS = 150, 50, 200  # such samples: from when to when before the fall it is usual; of a lurch
_MIN_LURCHES = 3  # lurches whose median decides which fault comes first
QUICKNESS = 1.67
"""Largest speed of a lurch over the root of fall and way [1/kg^0.5], of a hand as ``cutenv play`` has it, median."""


class Lurches(NamedTuple):
    """Motion of a blade where the force falls suddenly.

    In a hand it lurches there, on a stiff drive it does not.
    """

    drops: int
    """Sudden falls of the force."""
    top: float
    """Largest speed after them, less that around them [m/s]."""
    sharpness: float | None
    """Largest speed of a lurch over its way [1/s], mean of all by their ways; None without any of 0.8 mm."""
    slowness: float | None
    """Factor by which a hand's blade follows the falls of the force more quickly; None without a lurch.

    What a fall of the force does over the way of a lurch moves the mass of hand and blade, whatever the tissue: by
    a clock at twice its speed the mass seems to be four times as large.
    """
    early: float | None
    """Share of a lurch that comes before the fall of the force that causes it, median; None of fewer than three."""


def lurches_of(trace: Trace, position: Array, even: Array) -> Lurches:
    """Return the blade's motion at sudden falls of force.

    Position [m] and means of the force over 10 ms [N] are at 100 Hz.
    """
    speed = RATE * np.diff(position, append=position[-1])
    fall = np.zeros(len(even))
    fall[1:-1] = even[:-2] - even[2:]
    sudden = np.flatnonzero(fall > max(_SUDDEN, _SUDDEN_SHARE * float(np.ptp(even))))
    drops, top, ways, peaks, falls = 0, 0.0, [], [], []
    for group in np.split(sudden, np.flatnonzero(np.diff(sudden) > _BEFORE - 1) + 1) if len(sudden) else ():
        t = int(group[np.argmax(fall[group])])
        if t < _EARLIER or t + _AFTERWARDS >= len(even):
            continue
        quiet = speed[t - _EARLIER : t - 2 * _BEFORE], speed[t + _AFTER + _BEFORE : t + _AFTERWARDS]
        usual = max(0.0, *(float(np.median(each)) for each in quiet))
        way = float(position[t + _AFTER] - position[t - _BEFORE]) - (_BEFORE + _AFTER) / RATE * usual
        peak = float(speed[t - _BEFORE : t + _AFTER].max()) - usual
        drops, top = drops + 1, max(top, peak)
        falls.append((t + 0.5) / RATE)
        if way > _WAY:
            ways.append(way)
            peaks.append(peak)
    sharpness = float(np.dot(peaks, ways) / np.dot(ways, ways)) if ways else None
    close = np.array(list(_closely(trace, falls))).reshape(-1, 3)
    if not len(close):
        return Lurches(drops, top, sharpness, None, None)
    slowness = QUICKNESS / float(np.average(close[:, 0], weights=close[:, 2]))
    early = float(np.median(close[:, 1])) if len(close) >= _MIN_LURCHES else None
    return Lurches(drops, top, sharpness, slowness, early)


def _closely(trace: Trace, falls: list[float]) -> Iterator[tuple[float, float, float]]:
    """Yield lurches near ``falls``: quickness [1/kg^0.5], earlier share, way [m]."""
    assert trace.position is not None
    instants = even_instants(trace.time, _FINE)
    x, F = (np.interp(instants, trace.time, each) for each in (trace.position, trace.force))
    drop = F - np.append(F[_FALL:], np.full(_FALL, F[-1]))
    for fall in falls:
        near = round(_FINE * fall)
        start = near - 30 + int(np.argmax(drop[near - 30 : near + 30]))
        if start + _LASTS + _STARTS >= len(x):
            continue
        usual = max(float(x[start - _STARTS] - x[start - _USUAL]) * _FINE / (_USUAL - _STARTS), 0.0)
        way = float(x[start + _LASTS] - x[start]) - usual * _LASTS / _FINE
        if way < _WAY:
            continue
        lurch = x[start - _STARTS : start + _LASTS + _STARTS]
        speed = float((lurch[_SPEED:] - lurch[:-_SPEED]).max()) * _FINE / _SPEED - usual
        fallen = float(F[start - 9 : start + 1].mean() - F[start + _FALL : start + _FALL + 20].min())
        early = float(x[start] - x[start - _STARTS]) - usual * _STARTS / _FINE
        yield speed / float(np.sqrt(max(fallen, 1e-3) * way)), early / way, way


def smoothed_motion(lurches: Lurches) -> str:
    """Return why lurches rule out a hand's motion, or ""."""
    sharp = lurches.sharpness
    if sharp is None or sharp >= _SHARPEST_SMOOTHED or lurches.top < LURCH_SPEED:
        return ""
    return (
        f"where the force falls suddenly the blade takes some {1e3 / sharp:.0f} ms for a lurch, and a hand less than "
        f"{1e3 / _SHARPEST_SMOOTHED:.0f}: the position was smoothed, or the clock runs fast. Record both as they are"
    )
