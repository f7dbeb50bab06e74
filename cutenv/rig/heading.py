"""Heading of a blade that two straight axes lead: the direction in which it points, turned at a commanded rate."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cutenv._base.arrays import Array

_KEPT = 400  # moments that are remembered: two for each decision


class Heading:
    """Direction of a blade in the plane, as angle to the axis of the slab [rad], positive to the left.

    No drive turns the blade about its vertical axis: the two axes lead it where it is to point.
    """

    def __init__(self) -> None:
        self.begin(0.0)

    def begin(self, heading: float) -> None:
        """Point in a direction [rad], and forget the turns before."""
        self._moments: deque[tuple[float, float]] = deque([(-math.inf, heading)], maxlen=_KEPT)

    @property
    def now(self) -> float:
        """Direction at the end of the last turn [rad]."""
        return self._moments[-1][1]

    def turn(self, rate: float, start: float, end: float) -> None:
        """Turn at a rate [rad/s] from a time ``start`` to ``end`` [s]."""
        self._moments += [(start, self.now), (end, self.now + rate * (end - start))]

    def at(self, times: Array) -> Array:
        """Return the directions at times [s], shape (n,) [rad]; before the first turn and after the last they stay."""
        moments = np.array(self._moments)
        if not math.isfinite(moments[0, 0]):
            moments[0, 0] = moments[1, 0] if len(moments) > 1 else 0.0
        headings: Array = np.interp(times, moments[:, 0], moments[:, 1])
        return headings

    def speeds(self, speed: float, time: float, *, lead: float) -> tuple[float, float]:
        """Return the speeds along the slab and to its left [m/s] of a blade that goes where it points at a time [s].

        The direction is that to which it will have turned after ``lead`` [s], the lag of the axes' velocity loops.
        """
        heading = self.now
        if len(self._moments) > 1:
            (start, before), (end, heading) = self._moments[-2], self._moments[-1]
            heading += (heading - before) * (min(time, end) + lead - end) / max(end - start, 1e-9)
        return speed * math.cos(heading), speed * math.sin(heading)
