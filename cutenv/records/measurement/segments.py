"""Loading segments: ramps between valleys and hilltops (thesis, 3.3.2)."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.measurement.strokes import Stroke, bin_means, bins_of_readings, strokes, turning_points
from cutenv.sim.trace import Trace

SMALLEST_DROP = 0.1
"""Default smallest significant drop of a quiet record [N]: twice the resolution of the thesis's sensor (sec. 3.1)."""

SMALLEST_DROP_NOISE = 6.0
"""Least smallest drop over the noise of a mean of the smoothed readings [1]: with 4, noise still parts some ramps."""

SMALLEST_DROP_SHARE = 0.1
"""Default for records without newtons, as a share of their range of force from the 5 % to the 95 % quantile."""

SMOOTHING_TIME = 0.01  # default averaging time [s]: 0.25 mm at 2.54 cm/s; at 1 kHz noise of 0.025 N falls to 0.008

FEWEST_SMOOTHED = 3
"""Smallest default number of readings averaged, if position is known: reduces the noise of a slow sensor."""

STRAIGHT_RAMP = 0.75
"""Smallest R squared of a ramp that counts as straight: that of a rise of 0.15 N under noise of 0.025 N."""

STEADY_SHARE = 0.3  # largest relative change of speed over a ramp that counts as steady
_AVERAGED = 10  # readings, whose means show correlated noise
_MIN_BINS = 3  # smallest number of bins left of a ramp
_INNER_QUANTILES = (0.05, 0.95)
_NORMAL_MEDIAN = 0.6745  # of the absolute value of a standard normal number

_Along = Literal["position", "displacement", "slope", "speed", "speed_change"]


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One loading ramp, trimmed, with a least-squares line.

    The line is force against position, or against time if the trace holds no position. Force is in the unit of the
    trace, written as N here.

    Attributes
    ----------
    start, stop : int
        The readings ``start`` to ``stop - 1`` of the trace.
    time, duration : float
        Mean of these readings, and from the first to the last [s].
    force : float
        Force on the fitted line at `position`, or else at `time` [N].
    force_rise : float
        Delta F of the line from the first of these readings to the last [N].
    rate : float
        dF/dt, from a separate line against time [N/s].
    r_squared : float
        Share of the force's variance that the line explains [1].
    drop : float
        Fall of the smoothed force from hilltop to the next valley [N]; 0 if no significant one followed.
    restlessness : float
        Scatter of these readings about the line over their noise from one to the next, and from one mean of 10 to the
        next [1]: 1 for a straight ramp, more for one that bends or hides a drop.
    after_standstill : bool
        True if it is the first of its stroke: the blade had just met the tissue, turned or stood, and part of the
        ramp is elastic, without the growth that accompanies steady loading. Without position the whole record is
        one stroke.
    position, displacement : float or None
        Position of the blade, mean, and Delta U from the first to the last [m]; None if the trace holds no position.
    slope : float or None
        dF/dU [N/m]; None without position.
    speed, speed_change : float or None
        Mean speed [m/s]; that of the ramp's second half less that of its first, over the mean [1]; None without
        position.
    angle : float or None
        Mean angle [rad]; None if the trace does not hold it.
    depth : float or None
        Mean depth of cut at the blade [m]; None if the trace does not hold it.
    """

    start: int
    stop: int
    time: float
    duration: float
    force: float
    force_rise: float
    rate: float
    r_squared: float
    drop: float
    after_standstill: bool
    position: float | None = None
    displacement: float | None = None
    slope: float | None = None
    speed: float | None = None
    speed_change: float | None = None
    angle: float | None = None
    depth: float | None = None
    restlessness: float = 1.0

    @property
    def samples(self) -> slice:
        """The readings as a slice."""
        return slice(self.start, self.stop)

    @property
    def is_steady(self) -> bool:
        """True if the slope is a tissue property.

        The ramp is ended by a drop, not a stroke's first, straight, and of one speed. False without position: a rate
        depends on the blade's speed as well.
        """
        whole = self.drop > 0.0 and not self.after_standstill
        return (
            whole
            and self.r_squared >= STRAIGHT_RAMP
            and self.speed_change is not None
            and abs(self.speed_change) <= STEADY_SHARE
        )

    def require(self, *names: _Along, by: str) -> tuple[float, ...]:
        """Return properties along the cut, in the order of the names, in SI.

        One that is None is a ValueError, which names the function `by` that needs them.
        """
        values = tuple(getattr(self, name) for name in names)
        missing = [name for name, value in zip(names, values, strict=True) if value is None]
        if missing:
            raise ValueError(
                f"{by} needs {' and '.join(missing)} of a loading segment, which only a trace with position gives."
            )
        return values


def loading_segments(
    trace: Trace, *, smallest_drop: float | None = None, smoothing_readings: int | None = None
) -> list[Segment]:
    """Find loading ramps between valleys and hilltops of force.

    In each forward stroke the force is averaged over bins of `smoothing_readings`. A rise counts from its
    lowest to its highest bin, and a new one begins only after a fall of `smallest_drop`. The line is fitted
    to the readings themselves, leaving out the first and the last bin of the ramp, which may hold part of a
    drop. A trace without position counts as one stroke, and its ramps are lines against time.

    Parameters
    ----------
    trace : Trace
        Record; speed is computed from position and time. Without position, segments have a `rate` and no `slope`.
    smallest_drop : float, optional
        Smallest significant rise and drop, well above the noise of a mean of `smoothing_readings`; in newtons,
        1e-4 to 100, or in the unit of a normalised record. By default 0.1 N, or six times that noise where this is
        more; for a normalised record a tenth of its own range of force (5 % to 95 % quantile): to compare such
        records, give the same value for all.
    smoothing_readings : int, optional
        1 to 10000. By default as many as 10 ms hold, 10 at 1 kHz, but 3 at least, or 1 without position. A ramp of
        fewer than 5 times as many readings is not found.

    Returns
    -------
    list of Segment
        In order of time; may be empty.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    Notes
    -----
    Thesis, section 3.3.2 and Figure 3.4, which describe the filter by its result only: hilltops and valleys of the
    significant loadings and unloadings. Friction at a constant depth shifts a ramp and leaves its slope; a delay of
    the sensor shifts it along the cut. Below 0.5 mm/s the blade counts as standing.

    Examples
    --------
    >>> saw = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3]
    >>> trace = Trace(time=[0.1 * i for i in range(12)], force=saw, force_unit="1")
    >>> [(round(s.rate, 3), round(s.drop, 3), s.slope) for s in loading_segments(trace)]
    [(2.0, 0.7, None), (2.0, 0.0, None)]
    """
    drop, readings = _settings(trace, smallest_drop, smoothing_readings)
    return [segment for way in _forward(trace) for segment in _segments_of(trace, way, drop, readings)]


def filtered(trace: Trace, *, smallest_drop: float | None = None, smoothing_readings: int | None = None) -> Trace:
    """Return the record with strokes reduced to significant hilltops and valleys.

    Between these the force is a straight line along the cut, without position in time: the sawtooth of Figure 3.4 of
    the thesis. Before the first valley and after the last hilltop of a stroke, and in other strokes, it is as recorded.
    Parameters and errors are those of :func:`loading_segments`.

    Examples
    --------
    >>> saw = [0.0, 0.21, 0.4, 0.6, 0.8, 1.0, 0.3, 0.5, 0.7, 0.93, 1.1, 1.3]
    >>> trace = Trace(time=[0.1 * i for i in range(12)], force=saw, force_unit="1")
    >>> filtered(trace).force.round(2).tolist()
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.3, 0.5, 0.7, 0.9, 1.1, 1.3]
    """
    drop, readings = _settings(trace, smallest_drop, smoothing_readings)
    force = trace.force.copy()
    along = trace.time if trace.position is None else trace.position
    for way in _forward(trace):
        borders = bins_of_readings(way.stop - way.start, readings)
        places, means = (bin_means(values[way.samples], borders) for values in (along, trace.force))
        turns = [place for ramp in turning_points(means, drop) for place in ramp]
        if turns:
            between = slice(way.start + int(borders[turns[0]]), way.start + int(borders[turns[-1] + 1]))
            force[between] = np.interp(along[between], np.maximum.accumulate(places[turns]), means[turns])
    return dataclasses.replace(trace, force=force)


def _settings(trace: Trace, smallest_drop: float | None, smoothing_readings: int | None) -> tuple[float, int]:
    readings = smoothing_readings_of(trace) if smoothing_readings is None else smoothing_readings
    readings = int(in_range("smoothing_readings", readings, 1, 10_000, "1", "It is a number of readings."))
    drop = _smallest_drop(trace, readings) if smallest_drop is None else _checked_drop(trace, smallest_drop)
    return drop, readings


def _forward(trace: Trace) -> list[Stroke]:
    ways = [Stroke(start=0, stop=len(trace), forward=True)] if trace.position is None else strokes(trace)
    return [way for way in ways if way.forward]


def _smallest_drop(trace: Trace, readings: int) -> float:
    if trace.force_unit == "N":
        # A drop that is only noise would end a ramp below the force that starts a crack run.
        return max(SMALLEST_DROP, SMALLEST_DROP_NOISE * force_noise(trace) / math.sqrt(readings))
    low, high = np.quantile(trace.force, _INNER_QUANTILES)
    return SMALLEST_DROP_SHARE * float(high - low)


def _checked_drop(trace: Trace, smallest_drop: float) -> float:
    if trace.force_unit == "N":
        return in_range(
            "smallest_drop", smallest_drop, 1e-4, 100.0, "N", "A tenth of a newton is a drop to begin with."
        )
    cure = (
        f"The force is normalised: give the drop in its unit; without one it is {_smallest_drop(trace, 1):.3g} here, "
        "a tenth of the record's range."
    )
    return in_range("smallest_drop", smallest_drop, 1e-12, 1e9, "1", cure)


def smoothing_readings_of(trace: Trace) -> int:
    """Return a record's default number of readings to average."""
    fewest = 1 if trace.position is None else FEWEST_SMOOTHED
    return max(fewest, min(round(SMOOTHING_TIME * trace.sample_rate), 10_000))


def force_noise(trace: Trace) -> float:
    """Return a reading's white-noise SD in the force's unit.

    The noise is 0 for fewer than 3 readings, else that of second differences, in which a ramp has no share, by their
    median, in which crack runs have none.
    """
    bends = np.abs(np.diff(trace.force, 2))
    return float(np.median(bends)) / (_NORMAL_MEDIAN * math.sqrt(6.0)) if len(bends) else 0.0


def _segments_of(trace: Trace, stroke: Stroke, smallest_drop: float, smoothing_readings: int) -> list[Segment]:
    borders = bins_of_readings(stroke.stop - stroke.start, smoothing_readings)
    smooth = bin_means(trace.force[stroke.samples], borders)
    ramps = turning_points(smooth, smallest_drop)
    found = []
    for i, (valley, hilltop) in enumerate(ramps):
        if hilltop - valley - 1 < _MIN_BINS:
            continue
        after = ramps[i + 1][0] if i + 1 < len(ramps) else hilltop + int(np.argmin(smooth[hilltop:]))
        drop = float(smooth[hilltop] - smooth[after])
        found.append(
            _fitted(
                trace,
                stroke.start + int(borders[valley + 1]),
                stroke.start + int(borders[hilltop]),
                drop=drop if drop >= smallest_drop else 0.0,
                after_standstill=i == 0,
            )
        )
    return found


def _fitted(trace: Trace, start: int, stop: int, *, drop: float, after_standstill: bool) -> Segment:
    here = slice(start, stop)
    t, F = trace.time[here], trace.force[here]
    rate, r_squared = _line(t, F)
    duration = float(t[-1] - t[0])
    in_time = Segment(
        start=start,
        stop=stop,
        time=float(t.mean()),
        duration=duration,
        force=float(F.mean()),
        force_rise=rate * duration,
        rate=rate,
        r_squared=r_squared,
        drop=drop,
        after_standstill=after_standstill,
        angle=None if trace.angle is None else float(trace.angle[here].mean()),
        depth=None if trace.depth is None else float(trace.depth[here].mean()),
    )
    return in_time if trace.position is None else _along_the_cut(in_time, t, trace.position[here], F)


def _along_the_cut(in_time: Segment, t: Array, x: Array, F: Array) -> Segment:
    """Return a segment with line against position, and motion."""
    slope, r_squared = _line(x, F)
    displacement, speed = float(x[-1] - x[0]), float((x[-1] - x[0]) / (t[-1] - t[0]))
    half = len(x) // 2
    first_half, second_half = (x[half] - x[0]) / (t[half] - t[0]), (x[-1] - x[half]) / (t[-1] - t[half])
    return dataclasses.replace(
        in_time,
        force_rise=slope * displacement,
        r_squared=r_squared,
        position=float(x.mean()),
        displacement=displacement,
        slope=slope,
        restlessness=_restlessness(F - slope * x),
        speed=speed,
        speed_change=float(second_half - first_half) / speed,
    )


def _restlessness(residual: Array) -> float:
    """Return the residual SD over that from successive differences.

    Means of several readings include correlated noise, as in a filtered or interpolated record.
    """
    means = bin_means(residual, bins_of_readings(len(residual), _AVERAGED))
    noise = max(_from_differences(residual), math.sqrt(_AVERAGED) * _from_differences(means))
    return float(residual.std()) / noise if noise > 0.0 else 1.0


def _from_differences(values: Array) -> float:
    """Return white noise SD from differences, 0 for one value."""
    change = np.diff(values)
    return math.sqrt(float((change * change).mean()) / 2.0) if len(change) else 0.0


def _line(x: Array, F: Array) -> tuple[float, float]:
    """Return the least-squares slope and explained variance share."""
    dx, dF = x - x.mean(), F - F.mean()
    # Sums, not vector products: for those BLAS wakes its threads, which costs more than it saves.
    xx, xF, FF = float((dx * dx).sum()), float((dx * dF).sum()), float((dF * dF).sum())
    return xF / xx, xF**2 / (xx * FF) if FF > 0.0 else 1.0
