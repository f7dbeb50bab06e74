"""Search for the cuts in a long record.

The sensor's zero, the first contact, the end, the pauses between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import check_parameters, parameter
from cutenv.records.measurement.strokes import END_SPEED, END_WINDOW, STANDSTILL_SPEED
from cutenv.sim.trace import Trace

_SMOOTHED = 0.010  # [s] over which force is averaged: noise of 0.05 N at 1 kHz decreases to 0.016 N
_STEADY = 0.1  # [s] over which position is averaged: a potentiometer's 0.1 mm decrease to 0.01 mm
_REST = 0.2  # [s] of rest that is kept at most: twice what shows it
_ABOVE_NOISE = 5.0  # standard deviations: one false contact in 3 million
_SHARE = 0.02  # share of the largest force that counts as contact in a record without newtons
_LEVEL = 0.2  # share of the contact force by which the two halves of a quiet start may differ
_MIN_ZERO_READINGS = 10  # least number of readings for a zero
_MIN_CONTACT = 0.1  # [s] under force: a knock on the table is not a cut
_CALMEST = 0.95  # share of the changes between readings that counts as noise, the others as drops
_CALMEST_SD = 0.871  # standard deviation of the calmest 95 % of normal numbers


@dataclass(frozen=True, kw_only=True)
class CutSearch:
    """Criteria that separate cuts from what is between them."""

    contact: float = parameter(
        0.1, unit="N", low=1e-4, high=100.0, provenance="assumed",
        source="least force that counts as contact: twice the resolution of the thesis's sensor; noise raises it",
        sensitivity=(0.05, 0.5),
    )  # fmt: skip
    pause: float = parameter(
        1.5, unit="s", low=0.05, high=3600.0, provenance="assumed",
        source="unloaded and standing for so long parts two cuts: a turn takes less, another specimen longer",
        sensitivity=(0.5, 5.0),
    )  # fmt: skip
    quiet: float = parameter(
        0.1, unit="s", low=0.01, high=60.0, provenance="assumed",
        source="shortest quiet start that gives the sensor's zero", sensitivity=(0.1, 1.0),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


@dataclass(frozen=True, kw_only=True)
class Tare:
    """Mean sensor reading in instants ``0 .. stop - 1`` before contact."""

    offset: float
    standard_error: float
    stop: int


@dataclass(frozen=True, kw_only=True)
class FoundCut:
    """Cut in a record, at instants ``start`` to ``stop - 1``."""

    start: int
    stop: int

    @property
    def samples(self) -> slice:
        """Instants of the cut as a slice."""
        return slice(self.start, self.stop)


STANDARD = CutSearch()  # search with the default criteria


def noise_level(force: Array) -> float:
    """Return the noise SD from the calmest 95 % of changes."""
    change = np.sort(np.abs(np.diff(force)))
    calmest = change[: max(1, math.ceil(_CALMEST * len(change)))]
    return float(np.sqrt(np.mean(calmest**2) / 2.0)) / _CALMEST_SD


def contact_level(trace: Trace, search: CutSearch) -> float:
    """Return the least smoothed force above noise, in the force's unit."""
    floor = search.contact if trace.force_unit == "N" else _SHARE * float(np.ptp(trace.force))
    smoothed = _readings(trace, _SMOOTHED)
    return max(floor, _ABOVE_NOISE * noise_level(trace.force) / math.sqrt(smoothed))


def find_tare(trace: Trace, search: CutSearch | None = None) -> Tare | None:
    """Find the sensor's zero in a record's quiet start.

    It is the mean without outliers; None if the start is not quiet: shorter than `quiet` or 10 readings, moving (where
    position is known), or rising. A blade at rest that presses with a constant force from the first instant on cannot
    be distinguished from an offset.
    """
    search = search or CutSearch()
    least = max(_MIN_ZERO_READINGS, _readings(trace, search.quiet))
    if len(trace) < 2 * least:
        return None
    contact = contact_level(trace, search)
    sigma = noise_level(trace.force)
    first = float(trace.force[:least].mean())
    away = np.abs(_smooth(trace.force, _readings(trace, _SMOOTHED)) - first) > contact
    if trace.position is not None:
        away |= moving(trace)
    stop = int(np.argmax(away)) if away.any() else len(trace)
    # The force begins to rise before it is detected; if it never is, the sensor measured nothing at all.
    stop -= _readings(trace, 0.5 * search.quiet) if stop < len(trace) else 0
    if stop < least:
        return None
    quiet = trace.force[:stop]
    half = stop // 2
    unsteady = abs(float(quiet[:half].mean() - quiet[half:].mean()))
    if unsteady > max(_LEVEL * contact, 2.0 * _ABOVE_NOISE * sigma / math.sqrt(stop)):
        return None
    kept = quiet[np.abs(quiet - np.median(quiet)) <= max(_ABOVE_NOISE * sigma, contact)]
    return Tare(offset=float(kept.mean()), standard_error=float(kept.std()) / math.sqrt(len(kept)), stop=stop)


def find_cuts(trace: Trace, search: CutSearch | None = None) -> list[FoundCut]:
    """Find start and end of every cut in a tared record.

    Cuts are separated where the blade is unloaded for `search.pause`, and at rest, if its position is known. A cut
    begins where the force first rises, and ends with the last force or, if position is known, the last motion, so that
    it includes the way back. If the blade stops suddenly, so much rest is kept as shows that the cut is complete. A
    stretch in which the blade only returns, under friction, belongs to the cut before; motion without force is not a
    cut.
    """
    search = search or CutSearch()
    contact = contact_level(trace, search)
    smooth = _smooth(trace.force, _readings(trace, _SMOOTHED))
    loaded = np.abs(smooth) > contact
    if trace.position is None:
        active, forward = loaded, loaded
    else:
        speed = steady_speed(trace)
        active, forward = loaded | (np.abs(speed) > STANDSTILL_SPEED), speed > STANDSTILL_SPEED
    instants = np.flatnonzero(active)
    if not len(instants):
        return []
    # A pause needs readings that show it; a gap in the record with force on both sides is not one.
    parted = (np.diff(trace.time[instants]) >= search.pause) & (np.diff(instants) > 1)
    found: list[FoundCut] = []
    for stretch in np.split(instants, np.flatnonzero(parted) + 1):
        here = slice(int(stretch[0]), int(stretch[-1]) + 1)
        under_force = stretch[loaded[stretch]]
        lasted = len(under_force) * trace.duration / (len(trace) - 1)
        if not len(under_force) or lasted < _MIN_CONTACT:
            continue
        if not (loaded & forward)[here].any():
            if found:
                found[-1] = FoundCut(start=found[-1].start, stop=here.stop)
            continue
        before = found[-1].stop if found else 0
        start = _rise(np.abs(smooth), int(under_force[0]), before, _LEVEL * contact)
        start = max(before, start - _readings(trace, _SMOOTHED))
        found.append(FoundCut(start=start, stop=here.stop))
    for k, cut in enumerate(found):
        found[k] = _with_rest(trace, cut, found[k + 1].start if k + 1 < len(found) else len(trace))
    return [cut for cut in found if cut.stop - cut.start >= 2]


def moving(trace: Trace) -> NDArray[np.bool_]:
    """Return where the blade moves, within 0.1 s, shape (n,)."""
    return np.abs(steady_speed(trace)) > STANDSTILL_SPEED


def steady_speed(trace: Trace) -> Array:
    """Return the speed between means over 0.1 s [m/s], shape (n,).

    The speed is without noise, but too coarse for a stroke.
    """
    time, (position,) = trace.time, trace.require("position", by="finding cuts")
    window = _readings(trace, _STEADY)
    if len(time) < 3 * window:
        return np.gradient(position, time)
    half = window // 2 + 1
    means, moments = _smooth(position, window), _smooth(time, window)
    ahead = np.minimum(np.arange(len(time)) + half, len(time) - 1)
    behind = np.maximum(np.arange(len(time)) - half, 0)
    return np.asarray((means[ahead] - means[behind]) / (moments[ahead] - moments[behind]))


def _with_rest(trace: Trace, cut: FoundCut, end: int) -> FoundCut:
    """Return a cut with the rest needed in its last 0.1 s."""
    if trace.position is None or cut.stop - cut.start < 2:
        return cut
    x, time = trace.position, trace.time
    last = np.arange(cut.stop - 1, min(end, int(np.searchsorted(time, time[cut.stop - 1] + _REST)) + 1))
    first = np.clip(np.searchsorted(time, time[last] - END_WINDOW), cut.start, last - 1)
    rests = np.abs((x[last] - x[first]) / (time[last] - time[first])) < END_SPEED
    return FoundCut(start=cut.start, stop=int(last[np.argmax(rests)]) + 1)


def _rise(smooth: Array, loaded: int, before: int, level: float) -> int:
    """Return the instant of first force rise before its detection."""
    calm = np.flatnonzero(smooth[before : loaded + 1] <= level)
    return before + int(calm[-1]) if len(calm) else before


def _readings(trace: Trace, seconds: float) -> int:
    return max(1, round(seconds * trace.sample_rate))


def _smooth(values: Array, window: int) -> Array:
    """Return centred means of ``window`` readings, fewer at ends; shape (n,)."""
    sums = np.concatenate(([0.0], np.cumsum(values)))
    i = np.arange(len(values))
    first = np.maximum(i - window // 2, 0)
    last = np.minimum(i - window // 2 + window, len(values))
    return np.asarray((sums[last] - sums[first]) / (last - first))
