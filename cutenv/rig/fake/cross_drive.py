"""Drive of a fake rig across the cut: a velocity loop with lag and acceleration limit, as that along the cut."""

from __future__ import annotations

import math

from cutenv.cutting.dtypes import TICK
from cutenv.rig.config.axes import CrossAxis
from cutenv.rig.safety.following_monitor import NOMINAL_LAG


class CrossDrive:
    """Height, or place to the side, of a blade in air, a millisecond at a time.

    Attributes
    ----------
    place, speed : float
        Place of the blade [m] and its speed [m/s], upwards or to the left.
    """

    def __init__(self, axis: CrossAxis, *, place: float = 0.0) -> None:
        self.place, self.speed = place, 0.0
        self._acceleration, self._quick_stop = axis.acceleration, axis.quick_stop
        self._gain = -math.expm1(-TICK / NOMINAL_LAG)

    def step(self, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Advance by a millisecond under a commanded speed [m/s]; a quick stop brakes at its own rate."""
        if blocked:
            self.speed = 0.0
            return
        reach = (self._quick_stop if stopping else self._acceleration) * TICK
        change = -self.speed if stopping else (speed - self.speed) * self._gain
        before = self.speed
        self.speed += min(max(change, -reach), reach)
        if speed == 0.0 and abs(self.speed) < 1e-5:
            self.speed = 0.0
        self.place += 0.5 * (before + self.speed) * TICK
