"""Drawn lines: straight, arc, S, part of an ellipse, random, through points."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv._engine.elementary import arctangent, sine_and_cosine
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING

WIDTH = 0.08
"""Width of the slab [m]; the clamp is as wide."""
SIDE_MARGIN = 0.01
"""Least distance of a line to the sides of the slab [m]."""
LARGEST_CURVATURE = 50.0
"""Limit on a line's curvature [1/m]: a radius of 20 mm, more than the tissue that a blade drags along."""
STEEPEST = math.radians(60.0)
"""Limit on the angle of a line to the axis of the slab [rad]."""
_CHORD = 0.7  # distance of a chord that cuts off half an excision from the centre, over the half axis
_PARTS = 20001  # points of a curve for its integral
_FINE = 20  # parts of the grid's spacing for the integrals
_ROUNDING = 1e-9


Pair: TypeAlias = tuple[Array, Array] | Array
"""Numbers along and across the slab."""


class CutLine(NamedTuple):
    """Drawn line, at points every 0.5 mm of its length, each part (301,).

    It starts at the clamp, x = 0; y = 0 is the middle of the slab.
    """

    x: Array
    """Place along the slab [m]."""
    y: Array
    """Place across the slab, to the left [m]."""
    angle: Array
    """Angle of its direction to the x axis [rad]."""
    curvature: Array
    """[1/m], positive to the left."""


def straight() -> CutLine:
    """Return the axis of the slab."""
    return bent(np.zeros(N_POINTS))


def arc(radius: float, *, start: float = 0.0, turn: float = math.pi / 4.0) -> CutLine:
    """Return a line bent along an arc, square to the clamp.

    The radius [m] is 20 mm or more, negative to the right; ``start`` is the length of line before the arc [m], ``turn``
    the angle by which it turns [rad], beyond which the line goes on straight.  ValueError if it bends or turns too far.
    """
    size = in_range("radius", abs(radius), 1.0 / LARGEST_CURVATURE, 1e3, "m", _BEND_CURE)
    start = in_range("start", start, 0.0, LENGTH, "m", "Give the length of line before the arc.")
    turn = in_range("turn", turn, 0.0, STEEPEST, "rad", "Angles are in radians: 45 degrees is 0.7854.")
    s = np.arange(N_POINTS) * SPACING
    return bent(np.where((s >= start) & (s <= start + turn * size), 1.0 / math.copysign(size, radius), 0.0))


def mirrored(line: CutLine) -> CutLine:
    """Return the line that bends to the other side."""
    return CutLine(line.x, -line.y, -line.angle, -line.curvature)


def s_shape(radius: float, length: float = 0.1) -> CutLine:
    """Return an S-shaped line that ends parallel to the slab's axis.

    The least radius [m] is 20 mm or more, negative first to the right; the S is 20 mm to 150 mm long [m], and beyond it
    the line is straight.
    """
    size = in_range("radius", abs(radius), 1.0 / LARGEST_CURVATURE, 1e3, "m", _BEND_CURE)
    length = in_range("length", length, 0.02, LENGTH, "m", "Give the length of the S.")
    share = np.minimum(np.arange(N_POINTS) * SPACING / length, 1.0)
    return bent(sine_and_cosine(2.0 * math.pi * share)[0] / math.copysign(size, radius))


def half_ellipse(length: float = 0.08, height: float = 0.015, end_angle: float | None = None) -> CutLine:
    """Return one side of an elliptical excision, from axis to axis.

    ``length`` and ``height`` are those of the part of an ellipse that a chord cuts off, from end to end and to its
    summit [m]; a negative height is on the right. A whole half would leave the axis at right angles, where no blade can
    begin. ``end_angle`` is that to the axis at which it leaves and comes back [rad], more than that of a parabola of
    this height; by default the chord is at 0.7 of the half axis of the ellipse.  ValueError if it leaves the slab,
    bends too far, or no ellipse has this angle.
    """
    length = in_range("length", length, 0.02, LENGTH, "m", "Give the distance between the ends of the excision.")
    size = in_range("height", abs(height), 1e-3, WIDTH / 2.0 - SIDE_MARGIN, "m", "Give the height of one side.")
    chord = _CHORD
    if end_angle is not None:
        steepness = sine_and_cosine(np.array(end_angle))
        over = float(steepness[0] / steepness[1]) * length / (2.0 * size) - 1.0
        parabola = math.degrees(math.atan(4.0 * size / length))
        if not over > 1.0:
            raise ValueError(
                f"end_angle = {end_angle:g} rad: an ellipse {1e3 * length:g} mm long and {1e3 * size:g} mm high "
                f"ends at more than {parabola:.1f} degrees. Give {math.radians(parabola):.3f} to {STEEPEST:.3f} rad."
            )
        chord = 1.0 / over
    u, square = np.linspace(-1.0, 1.0, _PARTS), 1.0 - chord * chord
    root, rise = np.sqrt(1.0 - square * u * u), math.copysign(size, height) / (1.0 - chord)
    x, y = 0.5 * length * (u + 1.0), rise * (root - chord)
    rates = np.full(_PARTS, 0.5 * length), -rise * square * u / root
    return _laid((x, y), rates, (np.zeros(_PARTS), -rise * square / (root * root * root)), u)


def random_line(rng: np.random.Generator, largest_curvature: float = 30.0, least_length: float = 0.1) -> CutLine:
    """Draw a smooth line of two waves with ``least_length`` [m] in the slab."""
    largest_curvature = in_range("largest_curvature", largest_curvature, 0.0, LARGEST_CURVATURE, "1/m", _BEND_CURE)
    s = np.arange(N_POINTS) * SPACING
    while True:
        lengths, phases, sizes = rng.uniform(0.06, 0.2, 2), rng.uniform(size=2), rng.uniform(-0.5, 0.5, 2)
        waves = (sizes * sine_and_cosine(2.0 * math.pi * (s[:, np.newaxis] / lengths + phases))[0]).sum(axis=1)
        try:
            line = bent(largest_curvature * waves)
        except ValueError:
            continue
        if length_within(line) >= least_length:
            return line


def bent(curvature: ArrayLike) -> CutLine:
    """Return the line of a given curvature [1/m], (301,), square to the clamp.

    It may leave the slab, see :func:`length_within`.  ValueError, which names the place, if it bends or turns too far.
    """
    given = np.asarray(curvature, dtype=float)
    if given.shape != (N_POINTS,) or not np.isfinite(given).all():
        raise ValueError(
            f"curvature of shape {given.shape}: give {N_POINTS} finite numbers [1/m], one every {1e3 * SPACING:g} mm."
        )
    s = np.arange(N_POINTS) * SPACING
    fine = np.linspace(0.0, LENGTH, _FINE * (N_POINTS - 1) + 1)
    angle = _integral(np.interp(fine, s, given), fine)
    sine, cosine = sine_and_cosine(angle)
    x_excess, y = _integral(cosine - 1.0, fine), _integral(sine, fine)
    every = slice(None, None, _FINE)
    line = CutLine(s + x_excess[every], y[every], angle[every], given)
    fault = _fault(line, _limits(line)[1:])
    if fault is not None:
        raise ValueError(fault)
    return line


def length_within(line: CutLine) -> float:
    """Return a line's length within the slab [m]."""
    outside = (line.x > LENGTH) | (abs(line.y) > WIDTH / 2.0 - SIDE_MARGIN + _ROUNDING)
    return float(SPACING * (np.argmax(outside) - 1 if outside.any() else N_POINTS - 1))


def places_within(line: CutLine) -> Array:
    """Return places every 2.5 mm within the slab [m], (n, 2)."""
    last = round(length_within(line) / SPACING)
    return np.column_stack((line.x, line.y))[: last + 1 : 5]


def through(points: ArrayLike) -> CutLine:
    """Return the smooth line through points, straight beyond the last one.

    The points, (n, 2), are three or more places along and across the slab [m], from the clamp (0, 0) on, each further
    along than the last.  ValueError, which names the place, if one is outside the slab, or the line turns back or bends
    too far.
    """
    given = np.asarray(points, dtype=float)
    if given.ndim != 2 or given.shape[1] != 2 or len(given) < 3 or not np.isfinite(given).all():
        raise ValueError(f"points of shape {given.shape}: give three or more finite places (x, y) [m].")
    if abs(given[0]).max() > _ROUNDING:
        raise ValueError(
            f"The line starts at ({given[0, 0]:g}, {given[0, 1]:g}) m: it must leave the clamp at (0, 0), the middle."
        )
    back = np.flatnonzero(np.diff(given[:, 0]) <= 0.0)
    if back.size:
        x, y = given[back[0] + 1]
        raise ValueError(f"The line turns back at ({x:g}, {y:g}) m: each place must be further along than the last.")
    from scipy.interpolate import CubicSpline

    chord = np.append(0.0, np.cumsum(np.hypot(*np.diff(given, axis=0).T)))
    spline = CubicSpline(chord, given)
    fine = np.linspace(0.0, chord[-1], _PARTS)
    return _laid(spline(fine).T, spline(fine, 1).T, spline(fine, 2).T, fine)


def _laid(place: Pair, rates: Pair, second_rates: Pair, at: Array) -> CutLine:
    """Return a parametric curve as a line, from places and derivatives."""
    (x, y), (d_x, d_y), (dd_x, dd_y) = place, rates, second_rates
    speed = np.sqrt(d_x * d_x + d_y * d_y)
    forward = d_x > 0.0
    angle = np.where(forward, arctangent(d_y / np.where(forward, d_x, 1.0)), math.pi)  # backward it turns too far
    curvature = (d_x * dd_y - d_y * dd_x) / (speed * speed * speed)
    drawn = CutLine(x, y, angle, curvature)
    fault = _fault(drawn, _limits(drawn))
    if fault is not None:
        raise ValueError(fault)
    way = _integral(speed, at)
    s = np.arange(N_POINTS) * SPACING
    beyond = np.maximum(s - way[-1], 0.0)
    sine, cosine = sine_and_cosine(angle[-1])
    return CutLine(
        np.interp(s, way, x) + beyond * cosine,
        np.interp(s, way, y) + beyond * sine,
        np.interp(s, way, angle),
        np.where(beyond > 0.0, 0.0, np.interp(s, way, curvature)),
    )


_BEND_CURE = (
    f"A line's least radius is {1e3 / LARGEST_CURVATURE:g} mm, its largest curvature {LARGEST_CURVATURE:g} per m."
)


def _limits(line: CutLine) -> tuple[tuple[NDArray[np.bool_], str, str], ...]:
    """Return where a line breaks a limit, how, and the cure."""
    aside, steepest = 1e3 * (WIDTH / 2.0 - SIDE_MARGIN), math.degrees(STEEPEST)
    return (
        (1e3 * abs(line.y) > aside + _ROUNDING, "leaves the slab", f"Stay within {aside:g} mm of its axis."),
        (
            abs(line.angle) > STEEPEST + _ROUNDING,
            "turns too far",
            f"Stay within {steepest:.0f} degrees of the slab's axis.",
        ),
        (abs(line.curvature) > LARGEST_CURVATURE + _ROUNDING, "bends too far", _BEND_CURE),
    )


def _fault(line: CutLine, limits: tuple[tuple[NDArray[np.bool_], str, str], ...]) -> str | None:
    """Return which limit a line breaks, and where, or None."""
    for wrong, what, cure in limits:
        if wrong.any():
            k = int(np.argmax(wrong))
            return f"The line {what} at ({line.x[k]:.4f}, {line.y[k]:.4f}) m. {cure}"
    return None


def _integral(values: Array, places: Array) -> Array:
    """Return the cumulative integral of values by the trapezoidal rule."""
    return np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(places)))
