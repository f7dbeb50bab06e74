"""Strokes: parts of a record in which the blade moves one way without a stop."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.trace import Trace
from cutenv.trace import blade_speed as blade_speed

STANDSTILL_SPEED = 0.5e-3
"""Speed below which the blade counts as standing [m/s]: half the lowest speed of the thesis."""
END_WINDOW = 0.1
"""Time before a record's end over which the blade's mean speed is taken [s]."""
END_SPEED = 0.8e-3
"""Mean speed below which the blade rests at a record's end [m/s]: the slowest cut of the thesis moves at 1 mm/s."""

_SHORTEST = 0.2e-3  # [m]


@dataclass(frozen=True, kw_only=True)
class Stroke:
    """Instants ``start`` to ``stop - 1`` of a record, in which the blade moves forward, or back."""

    start: int
    stop: int
    forward: bool

    @property
    def samples(self) -> slice:
        """The instants as a slice."""
        return slice(self.start, self.stop)


def strokes(trace: Trace) -> list[Stroke]:
    """Split a record with position where the blade stands or turns; strokes below 0.2 mm are left out."""
    (position,), speed = trace.require("position", by="strokes"), trace.blade_speed
    direction = np.where(np.abs(speed) > STANDSTILL_SPEED, np.sign(speed), 0.0)
    borders = [0, *(np.flatnonzero(np.diff(direction)) + 1).tolist(), len(trace)]
    found = []
    for start, stop in itertools.pairwise(borders):
        if direction[start] != 0.0 and abs(position[stop - 1] - position[start]) >= _SHORTEST:
            found.append(Stroke(start=start, stop=stop, forward=bool(direction[start] > 0)))
    return found


def bins_of_readings(n_readings: int, size: int) -> NDArray[np.intp]:
    """Return the borders of bins of ``size`` readings, the last of up to twice as many; shape (n_bins + 1,)."""
    n_bins = max(1, n_readings // size)
    return np.append(np.arange(n_bins) * size, n_readings).astype(np.intp)


def bins_of_travel(position: Array, length: float) -> NDArray[np.intp]:
    """Return the borders of the bins of ``length`` [m] through which a stroke passes; shape (n_bins + 1,).

    Noise that moves a position back over a border opens no new bin; a step over a whole bin leaves it out.
    """
    number = np.floor(np.maximum.accumulate(np.abs(position - position[0])) / length)
    return np.concatenate(([0], np.flatnonzero(np.diff(number)) + 1, [len(position)])).astype(np.intp)


def bin_means(values: Array, borders: NDArray[np.intp]) -> Array:
    """Return the mean of ``values`` in each bin, shape (n_bins,)."""
    return np.asarray(np.add.reduceat(values, borders[:-1]) / np.diff(borders))


def turning_points(values: Array, smallest_swing: float) -> list[tuple[int, int]]:
    """Find pairs (valley, hilltop) of indices: rises of ``smallest_swing`` or more, separated by falls of that much.

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
