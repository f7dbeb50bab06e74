"""Faults of raw reading columns: clock, numbers and spectrum."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from cutenv._base.arrays import Array
from cutenv.records.measurement.signal_quality import GAP_STEPS, UNEVEN_SHARE
from cutenv.records.measurement.strokes import END_WINDOW, STANDSTILL_SPEED

Sureness = Literal["certain", "likely", "possible"]

SLOWEST_RATE, FASTEST_RATE = 2.0, 50e3  # readings a second that no record of a cut has fewer or more of [Hz]
MAINS = (50.0, 60.0)  # frequencies of the mains [Hz]; twice and three times them are looked for as well
FEWEST_LEVELS = 25  # number of different readings below which the resolution is too coarse for a cut
WIDEST_COUNTS = 40.0  # range of whole numbers beyond which they are counts of a converter: no cut takes 40 N
_SPIKE_NOISE, _SPIKE_RANGE = 9.0, 0.12  # a spike's height over the noise beside it, and over the range of force
_SPIKE_LENGTH, _SPIKE_TIME = 2, 0.03  # readings, and [s], of a spike
_BLOCK, _BLOCK_CHANGES = 24, 12  # readings of a block that came twice, and how many of them differ from the one before
_REPEATED = 0.95  # share of readings that are equal to the one before them, of those that would be
_SMOOTH = 0.38  # variance of second over that of first differences: 3 for noise, 2 for sudden drops
_EVEN = 0.01  # [s] over which a force is averaged for that: slower than the noise, faster than a drop
_LINE = 1e-7  # probability that noise has so strong a line (Fisher's test)
_STEADY, _SUDDEN = 0.08, 0.12  # largest change within 50 ms over the range: less for a blade, more for a force


class Fault(NamedTuple):
    """Fault of a record: kind, rows, certainty, finding and cure."""

    kind: str
    rows: tuple[int, int]
    sure: Sureness
    seen: str
    cure: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Columns of a record, as a file states them.

    Parameters
    ----------
    time, force : ndarray, shape (n,)
        Time [s] in any order, and force in ``force_unit``; finite.
    position, speed : ndarray, shape (n,), optional
        Position [m] and speed [m/s] of the blade.
    force_unit : {"N", "1"}
        "1": normalised.
    metadata : mapping
        Facts about the record, as of a :class:`~cutenv.sim.trace.Trace`.
    """

    time: Array
    force: Array
    position: Array | None = None
    speed: Array | None = None
    force_unit: str = "N"
    metadata: Mapping[str, Any] = field(default_factory=dict)
    step: float = field(init=False)
    """Usual step of the time [s]; 0 if the time stands still."""

    def __post_init__(self) -> None:
        forward = np.diff(self.time)
        forward = forward[forward > 0.0]
        object.__setattr__(self, "step", float(np.median(forward)) if len(forward) else 0.0)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def all_rows(self) -> tuple[int, int]:
        """First and last row."""
        return 0, len(self) - 1

    @property
    def span(self) -> float:
        """Force range without outermost readings [force unit]."""
        low, high = np.percentile(self.force, (0.5, 99.5))
        return float(high - low)

    @property
    def resolution(self) -> float:
        """Usual distance of neighbouring force values [force unit], else 0."""
        values = np.unique(self.force)
        return float(np.median(np.diff(values))) if len(values) > 1 else 0.0

    @property
    def noise(self) -> float:
        """Force noise SD between readings, without drops [force unit]."""
        return 1.4826 * float(np.median(np.abs(np.diff(self.force, 2)))) / math.sqrt(6.0)

    def at_rest(self, end: bool = False) -> slice | None:
        """Return rows at rest at the start or end, or None."""
        if self.position is None or self.step == 0.0:
            return None
        still = np.abs(self.position - self.position[-1 if end else 0]) < STANDSTILL_SPEED * END_WINDOW
        still = still[::-1] if end else still
        count = len(still) if still.all() else int(np.argmin(still))
        count -= max(2, count // 20)  # it begins to move before it has moved
        if count * self.step < END_WINDOW or count < 8:
            return None
        return slice(len(still) - count, None) if end else slice(count)


def column_faults(readings: Readings) -> Iterator[Fault]:
    """Yield faults of columns: clock, rate, counts, swaps."""
    yield from _backward(readings)
    yield from _rate(readings)
    yield from _counts(readings)
    yield from _swapped(readings)


def signal_faults(readings: Readings) -> Iterator[Fault]:
    """Yield faults of a continuous force signal.

    These are forward jumps, spikes, levels, filters, lines, and doubled readings.
    """
    yield from _forward(readings)
    yield from _spikes(readings)
    yield from doubled_readings(readings)
    yield from _levels(readings)
    filtered = list(_filtered(readings))
    yield from filtered or _lines(readings)  # a filter leaves of noise what looks like a line


def _backward(readings: Readings) -> Iterator[Fault]:
    back = np.flatnonzero(np.diff(readings.time) < 0.0)
    if len(back):
        i = int(back[0])
        seen = f"the time goes back from {readings.time[i]:g} to {readings.time[i + 1]:g} s"
        more = f", and {len(back) - 1} times more" if len(back) > 1 else ""
        cure = "Divide the file where its clock restarts, or take the time from the sensor."
        yield Fault("clock jump", (i, i + 1), "certain", seen + more, cure)


def _forward(readings: Readings) -> Iterator[Fault]:
    """Find time jumps in which the blade hardly advances."""
    if readings.position is None:
        return
    jumps = np.diff(readings.time) > GAP_STEPS * readings.step
    if jumps.mean() > UNEVEN_SHARE:  # readings that come in bursts
        return
    steps, ways = np.diff(readings.time), np.abs(np.diff(readings.position))
    moving = ways[ways > STANDSTILL_SPEED * readings.step]
    usual = float(np.median(moving)) if len(moving) else math.inf
    for i in np.flatnonzero(jumps).tolist():
        beside = np.delete(ways[max(i - 5, 0) : i + 6], min(i, 5))
        if float(np.median(beside)) > 0.3 * usual and ways[i] < 4.0 * float(np.median(beside)):
            seen = f"the time jumps by {steps[i]:.3g} s, in which the moving blade has gone {1e3 * ways[i]:.2g} mm"
            yield Fault("clock jump", (i, i + 1), "likely", seen, "Take the jump out of the time: no reading is lost.")


def _rate(readings: Readings) -> Iterator[Fault]:
    if readings.step == 0.0 or SLOWEST_RATE <= 1.0 / readings.step <= FASTEST_RATE:
        return
    unit = "milliseconds" if readings.step > 1.0 / SLOWEST_RATE else "seconds divided by 1000, or a counter's"
    seen = f"there are {1.0 / readings.step:.3g} readings a second"
    cure = f"Give the unit of time: it looks like {unit}."
    yield Fault("rate", readings.all_rows, "certain", seen, cure)


def _counts(readings: Readings) -> Iterator[Fault]:
    force = readings.force
    whole = bool((force == np.rint(force)).all())
    if readings.force_unit == "N" and whole and np.ptp(force) > WIDEST_COUNTS:
        seen = f"the force is whole numbers from {force.min():.0f} to {force.max():.0f}"
        cure = "These are counts of a converter: multiply by newtons a count, from weights that are known."
        yield Fault("counts", readings.all_rows, "certain" if np.abs(force).max() > 1e3 else "likely", seen, cure)


def _swapped(readings: Readings) -> Iterator[Fault]:
    """Find swapped force and position by their speed of change."""
    if readings.position is None or readings.step == 0.0:
        return
    force, position = (_suddenness(each, readings.step) for each in (readings.force, readings.position))
    if 0.0 < force < _STEADY and position > _SUDDEN:
        seen = f"the force goes up to {readings.force.max():.3g} as evenly as a blade, and the position drops suddenly"
        cure = "Force and position are exchanged: name the columns the other way round."
        yield Fault("swapped", readings.all_rows, "likely", seen, cure)


def _suddenness(values: Array, step: float) -> float:
    """Return the largest change of 50 ms means over range [1]."""
    smooth = _averaged(values, max(1, round(5.0 * _EVEN / step)))
    span = float(np.ptp(smooth)) if len(smooth) > 1 else 0.0
    return float(np.abs(np.diff(smooth)).max()) / span if span else 0.0


def _averaged(values: Array, count: int) -> Array:
    """Return means of ``count`` values each, without the rest."""
    whole = len(values) // count * count
    return np.asarray(values[:whole].reshape(-1, count).mean(axis=1))


def spike_rows(readings: Readings) -> tuple[list[NDArray[np.intp]], Array]:
    """Find one or two readings far beyond noise and drops.

    Returned are the rows of each spike, and the usual force beside each reading [force unit].
    """
    force = readings.force
    if len(force) < 4 * _SPIKE_LENGTH + 1:
        return [], force
    usual = median_filter(force, 4 * _SPIKE_LENGTH + 1, mode="nearest")
    beyond = force - usual
    share = _SPIKE_RANGE if _SPIKE_LENGTH * readings.step < _SPIKE_TIME else 1.0  # a hand can press for longer
    limit = max(_SPIKE_NOISE * readings.noise, share * readings.span, 2.5 * readings.resolution)
    far = np.flatnonzero(np.abs(beyond) > limit)
    groups = np.split(far, np.flatnonzero(np.diff(far) > 1) + 1) if len(far) else []
    return [group for group in groups if len(group) <= _SPIKE_LENGTH and _returns(force, group, limit)], usual


def _spikes(readings: Readings) -> Iterator[Fault]:
    (found, usual), force = spike_rows(readings), readings.force
    if not found:
        return
    top = max(found, key=lambda group: float(np.abs(force - usual)[group].max()))
    i = int(top[np.argmax(np.abs(force - usual)[top])])
    seen = f"{force[i]:.4g} for {len(top)} reading{'s' * (len(top) > 1)} among {usual[i]:.3g}"
    more = f", and {len(found) - 1} like it" if len(found) > 1 else ""
    cure = "Leave these readings out, and look at cable and connector."
    yield Fault("spike", (int(found[0][0]), int(found[-1][-1])), "likely", seen + more, cure)


def _returns(force: Array, group: NDArray[np.intp], limit: float) -> bool:
    """Return True if readings around a group differ less than it."""
    first, last = int(group[0]), int(group[-1])
    before, after = float(force[max(first - 1, 0)]), float(force[min(last + 1, len(force) - 1)])
    height = float(np.abs(force[group] - 0.5 * (before + after)).min())
    return height > 0.7 * limit and abs(before - after) < 0.5 * height


def doubled_readings(readings: Readings) -> Iterator[Fault]:
    """Yield repeated rows or blocks, and multiply stored readings."""
    still = np.flatnonzero(np.diff(readings.time) == 0.0)
    force = readings.force
    if len(still):
        i, same = int(still[0]), bool((force[still] == force[still + 1]).all())
        seen = f"{len(still)} rows have the time of the row before{', and its force' * same}"
        cure = "Delete the rows that are there twice." if same else "Take a clock that counts finely enough."
        yield Fault("doubled", (i, int(still[-1]) + 1), "certain", seen, cure)
        return
    equal = np.diff(force) == 0.0
    lengths = np.diff(np.flatnonzero(np.concatenate(([True], ~equal, [True]))))
    times = int(np.median(lengths))
    if times >= 2 and np.mean(lengths == times) >= _REPEATED and len(lengths) > FEWEST_LEVELS:
        seen = f"each reading is stored {times} times"
        cure = f"Keep one of {times}: the sensor gives {1.0 / (times * readings.step):.3g} readings a second."
        yield Fault("doubled", readings.all_rows, "certain", seen, cure)
        return
    again = _block_again(force)
    if again is not None:
        first, second = again
        seen = f"{_BLOCK} readings or more from row {second} on are those from row {first} on"
        cure = "The program stored a buffer twice: delete the copy, and the time that it takes."
        yield Fault("doubled", (first, second + _BLOCK - 1), "certain", seen, cure)


def _block_again(force: Array) -> tuple[int, int] | None:
    """Return where a changing block stands, and where again."""
    if len(force) <= _BLOCK:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(force, _BLOCK)
    changing = np.lib.stride_tricks.sliding_window_view(np.diff(force) != 0.0, _BLOCK - 1).sum(axis=1)
    seen: dict[bytes, int] = {}
    for i in np.flatnonzero(changing >= _BLOCK_CHANGES).tolist():
        window = windows[i]
        if len(np.unique(window)) < _BLOCK_CHANGES // 2:
            continue
        first = seen.setdefault(window.tobytes(), i)
        if first + _BLOCK <= i:
            return first, i
    return None


def _levels(readings: Readings) -> Iterator[Fault]:
    values = np.unique(readings.force)
    if 1 < len(values) < FEWEST_LEVELS and len(readings) > 8 * FEWEST_LEVELS:
        seen = f"the force takes {len(values)} different values, {np.median(np.diff(values)):.3g} apart"
        cure = "Choose a smaller range of the sensor, or a converter of more bits."
        yield Fault("quantised", readings.all_rows, "certain", seen, cure)


def smoothness(readings: Readings) -> tuple[float, float] | None:
    """Return a force's smoothness over hundredths of a second.

    That is the variance of second over that of first differences of means over 10 ms: 3 for noise, 2 for sudden drops,
    less for a force that a filter has smoothed; and the frequency above which it does not change [Hz]. None if the
    record is too short, has too few readings a second, or its force does not change.
    """
    if readings.step == 0.0 or readings.step > 2.0 * _EVEN:
        return None
    smooth = _averaged(readings.force, max(1, round(_EVEN / readings.step)))
    if len(smooth) < 8 * FEWEST_LEVELS or not (first := float(np.mean(np.diff(smooth) ** 2))) > 0.0:
        return None
    ratio = float(np.mean(np.diff(smooth, 2) ** 2)) / first
    return ratio, math.sqrt(ratio) / (2.0 * math.pi * max(_EVEN, readings.step))


def _filtered(readings: Readings) -> Iterator[Fault]:
    found = smoothness(readings)
    if found is not None and found[0] < _SMOOTH:
        seen = f"nothing in the force changes faster than some {found[1]:.2g} Hz"
        cure = "Take the filter of amplifier or program out, or set it to a fifth of the readings a second."
        yield Fault("filtered", readings.all_rows, "likely", seen, cure)


def _lines(readings: Readings) -> Iterator[Fault]:
    """Find spectral lines in force at rest: mains or their alias."""
    rest = readings.at_rest()
    if rest is None:
        return
    force = readings.force[rest]
    slow = np.polyval(np.polyfit(np.arange(len(force)), force, 2), np.arange(len(force)))
    power = np.abs(np.fft.rfft((force - slow) * np.hanning(len(force)))) ** 2
    power = power[3:]  # the parabola has taken the slowest out
    if len(power) < 8 or power.sum() == 0.0:
        return
    k = int(np.argmax(power))
    # Hann's window spreads a line over three places, so that noise has a third as many independent ones.
    share = float(power[max(k - 1, 0) : k + 2].sum() / power.sum())
    places = len(power) / 3.0
    if places * (1.0 - share) ** (places - 1.0) > _LINE:
        return
    rate = 1.0 / readings.step
    hertz, fine = (k + 3) * rate / len(force), 1.5 * rate / len(force)
    overtones = [n * each for each in MAINS for n in (1, 2, 3)]
    direct = next((each for each in overtones if abs(each - hertz) < fine and each < 0.5 * rate), None)
    seen_as = {each: abs(each - round(each / rate) * rate) for each in overtones if each >= 0.5 * rate}
    alias = next((each for each, shown in seen_as.items() if abs(shown - hertz) < fine), None)
    size = math.sqrt(2.0) * float(np.std(force - slow))
    seen = f"{hertz:.3g} Hz of {size:.2g} while the blade rests"
    if direct is None and alias is not None:
        seen += f", as {alias:g} Hz of the mains look at {rate:.3g} readings a second"
        cure = "Record faster than twice that, or filter before the converter; afterwards it cannot be taken out."
        yield Fault("aliasing", readings.all_rows, "likely", seen, cure)
    else:
        cure = "Earth the shield of the cable at one end, and keep it from cables of the mains and motors."
        yield Fault("hum", readings.all_rows, "possible" if direct is None else "likely", seen, cure)
