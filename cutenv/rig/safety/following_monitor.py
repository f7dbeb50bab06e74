"""Expected motion of an axis under its commands, to detect one that stands still, slips or runs away."""

from __future__ import annotations

import math

from cutenv.rig.devices.samples import MotionSample
from cutenv.rig.safety.stop_causes import stuck_after

_MEMORY = 0.5  # [s] time constant with which a difference is forgotten: lag and acceleration are not known exactly
NOMINAL_LAG = 0.040
"""Lag of a velocity loop that has not been identified [s]."""


class FollowingMonitor:
    """Model of an axis's velocity loop (lag and acceleration limit), compared with its samples one by one.

    Parameters
    ----------
    lag, acceleration : float
        Lag [s] and acceleration limit [m/s2 or rad/s2] of the axis.
    sync : float
        Time between samples [s].
    slow : float
        Expected speed below which an axis may stand still [m/s or rad/s].
    unmoved : float
        Distance within which it counts as standing [m or rad].
    """

    def __init__(self, *, lag: float, acceleration: float, sync: float, slow: float, unmoved: float) -> None:
        self._lag, self._acceleration, self._sync = lag, acceleration, sync
        self._slow, self._unmoved = slow, unmoved
        self.restart()

    def restart(self) -> None:
        """Start again with the next sample."""
        self._last: MotionSample | None = None
        self._expected = 0.0
        self._off = 0.0
        self._stood_at = 0.0
        self._moving = 0.0

    def watch(self, sample: MotionSample, command: float) -> tuple[bool, float]:
        """Compare a sample with the motion expected from ``command`` [m/s or rad/s].

        Returns
        -------
        tuple of bool, float
            True if the encoder is stuck, and the distance of the axis from where it should be [m or rad], positive: too
            far.
        """
        last, self._last = self._last, sample
        if last is None:
            self._expected, self._stood_at = sample.speed, sample.position
            return False, 0.0
        # Samples are a SYNC apart, whenever they arrive: a stalled computer gets several at once.
        dt = max(sample.time - last.time, self._sync)
        change = (command - self._expected) * (1.0 - math.exp(-dt / self._lag))
        reach = self._acceleration * dt
        before, self._expected = self._expected, self._expected + min(max(change, -reach), reach)
        should = 0.5 * (before + self._expected) * dt
        self._off = (self._off + sample.position - last.position - should) * math.exp(-dt / _MEMORY)

        should_move = min(abs(command), abs(self._expected)) > self._slow  # commanded to rest, it may rest sooner
        if abs(sample.position - self._stood_at) > self._unmoved or not should_move:
            self._stood_at, self._moving = sample.position, 0.0
        else:
            self._moving += dt
        return self._moving > stuck_after(self._sync) - 0.5 * self._sync, self._off
