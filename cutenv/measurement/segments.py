"""Loading segments: the ramps between valleys and hilltops of the cutting force (thesis, section 3.3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv.measurement.strokes import Stroke, bin_means, bins_of_readings, strokes, turning_points
from cutenv.trace import Trace
from cutenv.validation import in_range

Array = NDArray[np.float64]

SMALLEST_DROP = 0.1
"""Default smallest significant drop [N]: twice the resolution of the thesis's sensor (section 3.1)."""

SMOOTHING_READINGS = 10
"""Default number of readings averaged: noise of 0.025 N falls to 0.008 N; 0.25 mm at 2.54 cm/s and 1 kHz."""

STRAIGHT = 0.75
"""Least R squared of a ramp that counts as straight: that of a rise of 0.15 N under noise of 0.025 N."""

STEADY = 0.3
"""Largest change of speed over a ramp, as a share of its mean, that counts as none."""

_FEWEST = 3  # bins that must remain of a ramp


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One ramp of loading, without its rounded ends; the line is fitted by least squares.

    Attributes
    ----------
    start, stop : int
        The readings ``start`` to ``stop - 1`` of the trace.
    position : float
        Of the blade, mean over these readings [m].
    force : float
        On the fitted line at `position` [N].
    force_rise, displacement : float
        Delta F [N] of the line and Delta U [m] of the blade, from the first of these readings to the last.
    slope : float
        dF/dU [N/m].
    r_squared : float
        Share of the force's variance that the line explains [1].
    drop : float
        Fall of the smoothed force from hilltop to the next valley [N]; 0 if none of significance followed.
    speed : float
        Mean [m/s].
    speed_change : float
        Speed of the ramp's second half less that of its first, over the mean [1].
    angle : float or None
        Mean [rad]; None if the trace does not hold it.
    depth : float or None
        Mean depth of cut at the blade [m]; None if the trace does not hold it.
    after_standstill : bool
        Whether it is the first of its stroke: the blade had just met the tissue, turned or stood, and part of
        the ramp is elastic, without the growth that accompanies steady loading.
    """

    start: int
    stop: int
    position: float
    force: float
    force_rise: float
    displacement: float
    slope: float
    r_squared: float
    drop: float
    speed: float
    speed_change: float
    angle: float | None
    depth: float | None
    after_standstill: bool

    @property
    def samples(self) -> slice:
        """The readings as a slice."""
        return slice(self.start, self.stop)

    @property
    def is_steady(self) -> bool:
        """Whether its slope tells the tissue: ended by a drop, no stroke's first, straight, of one speed."""
        whole = self.drop > 0.0 and not self.after_standstill
        return whole and self.r_squared >= STRAIGHT and abs(self.speed_change) <= STEADY


def loading_segments(
    trace: Trace, *, smallest_drop: float = SMALLEST_DROP, smoothing_readings: int = SMOOTHING_READINGS
) -> list[Segment]:
    """Find the ramps of loading between the valleys and hilltops of the cutting force.

    In each forward stroke the force is averaged over bins of `smoothing_readings`. A rise counts from its
    lowest to its highest bin, and a new one begins only after a fall of `smallest_drop`. The line is fitted
    to the readings themselves, leaving out the first and the last bin of the ramp, which may hold part of a
    drop.

    Parameters
    ----------
    trace : Trace
        With position; force in newtons. Speed is taken from position and time.
    smallest_drop : float
        Smallest significant rise and drop [N], 1e-4 to 100: well above the noise of a mean of
        `smoothing_readings`.
    smoothing_readings : int
        1 to 10000. A ramp of fewer than 5 times as many readings is not found.

    Returns
    -------
    list of Segment
        In order of time; may be empty.

    Raises
    ------
    ValueError
        If the trace holds no position or no newtons, or a parameter is out of range.

    Notes
    -----
    Thesis, section 3.3.2 and Figure 3.4, which describe the filter by its result only: hilltops and valleys
    of the significant loadings and unloadings. Friction at a constant depth shifts a ramp and leaves its
    slope; a delay of the sensor shifts it along the cut. Slower than 0.5 mm/s the blade counts as standing.
    """
    by = "loading_segments"
    in_range("smallest_drop", smallest_drop, 1e-4, 100.0, "N", "A tenth of a newton is a drop to begin with.")
    in_range("smoothing_readings", smoothing_readings, 1, 10_000, "1", "It is a number of readings.")
    trace.require_newtons(by=by)
    (position,) = trace.require("position", by=by)
    return [
        segment
        for stroke in strokes(trace.time, position)
        if stroke.forward
        for segment in _segments_of(trace, position, stroke, smallest_drop, int(smoothing_readings))
    ]


def _segments_of(
    trace: Trace, position: Array, stroke: Stroke, smallest_drop: float, smoothing_readings: int
) -> list[Segment]:
    borders = bins_of_readings(stroke.stop - stroke.start, smoothing_readings)
    smooth = bin_means(trace.force[stroke.samples], borders)
    ramps = turning_points(smooth, smallest_drop)
    found = []
    for i, (valley, hilltop) in enumerate(ramps):
        if hilltop - valley - 1 < _FEWEST:
            continue
        after = ramps[i + 1][0] if i + 1 < len(ramps) else hilltop + int(np.argmin(smooth[hilltop:]))
        drop = float(smooth[hilltop] - smooth[after])
        found.append(
            _fitted(
                trace,
                position,
                stroke.start + int(borders[valley + 1]),
                stroke.start + int(borders[hilltop]),
                drop=drop if drop >= smallest_drop else 0.0,
                after_standstill=i == 0,
            )
        )
    return found


def _fitted(trace: Trace, position: Array, start: int, stop: int, *, drop: float, after_standstill: bool) -> Segment:
    here = slice(start, stop)
    x, F, t = position[here], trace.force[here], trace.time[here]
    dx, dF = x - x.mean(), F - F.mean()
    slope = float(dx @ dF / (dx @ dx))
    variance = float(dF @ dF)
    displacement, speed = float(x[-1] - x[0]), float((x[-1] - x[0]) / (t[-1] - t[0]))
    half = len(x) // 2
    first_half, second_half = (x[half] - x[0]) / (t[half] - t[0]), (x[-1] - x[half]) / (t[-1] - t[half])
    return Segment(
        start=start,
        stop=stop,
        position=float(x.mean()),
        force=float(F.mean()),
        force_rise=slope * displacement,
        displacement=displacement,
        slope=slope,
        r_squared=slope * float(dx @ dF) / variance if variance > 0.0 else 1.0,
        drop=drop,
        speed=speed,
        speed_change=float(second_half - first_half) / speed,
        angle=None if trace.angle is None else float(trace.angle[here].mean()),
        depth=None if trace.depth is None else float(trace.depth[here].mean()),
        after_standstill=after_standstill,
    )
