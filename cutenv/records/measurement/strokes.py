"""Strokes: parts of a record with motion in one direction.

On the return stroke the blade leaves the tip until only friction remains (section 6.2, Figures 6.5 to 6.7).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth import DepthProfile
from cutenv.sim.trace import Trace
from cutenv.sim.trace import blade_speed as blade_speed

STANDSTILL_SPEED = 0.5e-3  # speed below which the blade counts as standing [m/s]: half the lowest speed of the thesis
END_WINDOW = 0.1  # time before a record's end over which the blade's mean speed is taken [s]
END_SPEED = 0.8e-3
"""Mean speed below which the blade rests at a record's end [m/s]: the slowest cut of the thesis moves at 1 mm/s."""

SHORTEST_STROKE = 0.2e-3  # shortest way of a stroke [m]


@dataclass(frozen=True, kw_only=True)
class Stroke:
    """Forward or backward stroke, instants ``start`` to ``stop - 1``."""

    start: int
    stop: int
    forward: bool

    @property
    def samples(self) -> slice:
        """The instants as a slice."""
        return slice(self.start, self.stop)


def strokes(trace: Trace) -> list[Stroke]:
    """Split a record at stops and turns, without strokes below 0.2 mm."""
    (position,), speed = trace.require("position", by="strokes"), trace.blade_speed
    direction = np.where(np.abs(speed) > STANDSTILL_SPEED, np.sign(speed), 0.0)
    borders = [0, *(np.flatnonzero(np.diff(direction)) + 1).tolist(), len(trace)]
    found = []
    for start, stop in itertools.pairwise(borders):
        if direction[start] != 0.0 and abs(position[stop - 1] - position[start]) >= SHORTEST_STROKE:
            found.append(Stroke(start=start, stop=stop, forward=bool(direction[start] > 0)))
    return found


def bins_of_readings(n_readings: int, size: int) -> NDArray[np.intp]:
    """Return borders of bins of ``size`` readings, shape (n_bins + 1,).

    The last bin has up to twice as many.
    """
    n_bins = max(1, n_readings // size)
    return np.append(np.arange(n_bins) * size, n_readings).astype(np.intp)


def bins_of_travel(position: Array, length: float) -> NDArray[np.intp]:
    """Return borders of bins of ``length`` [m], shape (n_bins + 1,).

    Noise that moves a position back over a border opens no new bin; a step over a whole bin leaves it out.
    """
    number = np.floor(np.maximum.accumulate(np.abs(position - position[0])) / length)
    return np.concatenate(([0], np.flatnonzero(np.diff(number)) + 1, [len(position)])).astype(np.intp)


def bin_means(values: Array, borders: NDArray[np.intp]) -> Array:
    """Return bin means of ``values``, shape (n_bins,)."""
    return np.asarray(np.add.reduceat(values, borders[:-1]) / np.diff(borders))


def turning_points(values: Array, smallest_swing: float) -> list[tuple[int, int]]:
    """Find index pairs (valley, hilltop) of swings by ``smallest_swing``.

    A rise that ends the series counts, though no fall follows.
    """
    points: list[int] = []
    rising = False
    extreme = 0  # the lowest point since the last hilltop, or the highest since the last valley
    for i, value in enumerate(values.tolist()):
        beyond = value - float(values[extreme])
        if beyond == 0.0:
            continue
        if (beyond > 0.0) == rising:
            extreme = i
        elif abs(beyond) >= smallest_swing:
            points.append(extreme)
            rising = not rising
            extreme = i
    if rising:
        points.append(extreme)
    return list(zip(points[::2], points[1::2], strict=True))


_BIN = 0.2e-3  # [m] of travel: every position has the same weight, whatever the speed
_TURNS = 0.4e-3  # [m] after the turn, where friction and a delayed sensor follow the reversal; left out
_PLAIN_LENGTH = 2e-3  # [m] of plain friction behind the tip: with less, tip and friction cannot be separated
_LOADED_LENGTH = 1e-3  # [m] in addition: in less, a slope through some bins could pass for the tissue's
_PUSHED_BACK = 0.1  # of the largest force: larger than the error of a sensor's zero
_SINGULAR = 1e-12  # determinant of the normal equations over the product of their diagonal
_UNLOADED = 3.0  # residual standard deviations: a smaller elastic force at the turn counts as none
_VARIES = 0.5  # largest ratio of least to greatest depth behind the tip at which offset and friction can be separated
_CORRELATED = 5.0  # factor on the error for independent bins: the error of depth is correlated over 10 mm


@dataclass(frozen=True, kw_only=True)
class ReturnStroke:
    """Properties measured on the return from a cut's deepest point.

    Attributes
    ----------
    stop : int
        Index of the reading of the trace before which the stroke ends.
    tip : float
        Position at which the force became plain friction [m]: unloading is elastic, and it ends at the tip.
    friction_per_depth : float
        Friction on the moving blade per depth of cut [N/m].
    stiffness : float
        K of the unloading [N/m], without the crack growth that accompanies loading; 0 if the tip was already unloaded
        when the blade turned.
    offset, offset_error : float
        Constant part of the force, and its standard error [N]; 0 unless requested.
    """

    stop: int
    tip: float
    friction_per_depth: float
    stiffness: float
    offset: float = 0.0
    offset_error: float = 0.0


def fit_return_stroke(trace: Trace, depth: DepthProfile, *, with_offset: bool = False) -> ReturnStroke | None:
    """Fit stiffness, tip, friction and offset to the return stroke.

    F = K max(x - a, 0) - f B(x) + c, by least squares in K, f, c and a. The first 0.4 mm are left out: friction
    reverses as the bristles of tissue on the blade bend over, and the sensor follows with a delay.

    Parameters
    ----------
    trace : Trace
        With position; force in any unit.
    with_offset : bool
        True: c is the offset of a sensor whose zero is not known. False: c = 0.

    Returns
    -------
    ReturnStroke or None
        None if the blade did not come back, or not far enough past the tip, or cut no depth; with an offset also if
        depth varies by less than a factor of 2 behind the tip, where offset and friction cannot be separated.
    """
    (position,) = trace.require("position", by="fit_return_stroke")
    way_back = _way_back(trace, position)
    if not way_back:
        return None
    x, F = (np.concatenate(parts) for parts in zip(*(_binned(trace, position, s) for s in way_back), strict=True))
    turn = float(x.max())
    x, F = (values[x < turn - _TURNS] for values in (x, F))
    B = depth.at(x)
    if not len(x) or not B.any() or float(np.ptp(x)) < _PLAIN_LENGTH + _LOADED_LENGTH:
        return None
    lowest, highest = float(x.min()) + _PLAIN_LENGTH, float(x.max())

    def misfit(a: float) -> float:
        return float(_hinge(x, F, B, a, with_offset).squares)

    places = np.linspace(lowest, highest, 200)
    best = int(np.argmin(_hinge(x, F, B, places[:, np.newaxis], with_offset).squares))
    if best == 0:
        return None
    around = (float(places[best - 1]), float(places[min(best + 1, len(places) - 1)]))
    tip = float(minimize_scalar(misfit, bounds=around, method="bounded").x)
    fit = _hinge(x, F, B, tip, with_offset)
    noise = float(np.sqrt(fit.squares / len(x)))
    if fit.stiffness * (turn - tip) < _UNLOADED * noise:
        # Nothing to unload: the tip was at the blade, or the blade in the open crack.
        tip = turn
        fit = _hinge(x, F, B, tip, with_offset)
    plain = B[x <= tip]
    if with_offset and plain.min() > _VARIES * plain.max():
        return None
    if -fit.friction * float(B.mean()) > _PUSHED_BACK * float(trace.force.max()):
        return None  # the supposed friction still pushes the blade back: it is elastic force
    return ReturnStroke(
        stop=way_back[-1].stop,
        tip=tip,
        friction_per_depth=max(float(fit.friction), 0.0),
        stiffness=float(fit.stiffness),
        offset=float(fit.offset),
        offset_error=_CORRELATED * noise / math.sqrt(len(plain)) * _inflation(plain) if with_offset else 0.0,
    )


def _way_back(trace: Trace, position: Array) -> list[Stroke]:
    """Return backward strokes between deepest point and next forward one."""
    deepest = int(np.argmax(position))
    later = [s for s in strokes(trace) if s.stop > deepest]
    if later and later[0].forward:  # the stroke that led to the deepest point
        later = later[1:]
    ends = next((i for i, stroke in enumerate(later) if stroke.forward), len(later))
    return later[:ends]


def _binned(trace: Trace, position: Array, stroke: Stroke) -> tuple[Array, Array]:
    borders = bins_of_travel(position[stroke.samples], _BIN)
    return bin_means(position[stroke.samples], borders), bin_means(trace.force[stroke.samples], borders)


class _Hinge(NamedTuple):
    """Best return-stroke fit for each given tip. F = K max(x - a, 0) - f B + c, with its sum of squares [N2]."""

    stiffness: Array  # K [N/m]
    friction: Array  # f [N/m]
    offset: Array  # c [N]
    squares: Array


def _hinge(x: Array, F: Array, B: Array, a: float | Array, with_offset: bool) -> _Hinge:
    """Fit for one tip, or tips of shape (n, 1)."""
    h = np.maximum(x - a, 0.0)
    h0, B0, F0 = (values.mean(axis=-1) if with_offset else np.zeros(values.shape[:-1]) for values in (h, B, F))
    # Centred about their means, the three are free of the constant.
    dh, dB, dF = h - h0[..., np.newaxis], B - B0, F - F0
    hh, hB, BB, hF, BF = _dot(dh, dh), dh @ dB, float(dB @ dB), dh @ dF, float(dB @ dF)
    determinant = hh * BB - hB**2
    # With no reading ahead of the tip, or one, only friction can be determined.
    singular = determinant <= _SINGULAR * hh * BB
    K = np.where(singular, 0.0, (hF * BB - BF * hB) / np.where(singular, 1.0, determinant))
    f = (K * hB - BF) / BB if BB > 0.0 else np.zeros_like(K)
    residual = dF - K[..., np.newaxis] * dh + f[..., np.newaxis] * dB
    return _Hinge(K, f, F0 - K * h0 + f * B0, _dot(residual, residual))


def _dot(one: Array, other: Array) -> Array:
    """Return the sums of products along the last axis."""
    sums: Array = np.matmul(one[..., np.newaxis, :], other[..., np.newaxis])[..., 0, 0]
    return sums


def _inflation(B: Array) -> float:
    """Return a constant's error factor [1] when fitted with B."""
    return math.sqrt(float(np.mean(B**2)) / max(float(B.var()), _SINGULAR * float(np.mean(B**2))))
