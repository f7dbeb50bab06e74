"""Where an axis should be for what it was told: one that stands, slips or runs away is found out."""

from __future__ import annotations

import math

from cutenv.rig.causes import STUCK_AFTER
from cutenv.rig.samples import MotionSample

_MEMORY = 0.5  # [s] after which a difference is forgotten: lag and acceleration are not known to the last digit
NOMINAL_LAG = 0.040
"""Of a velocity loop where none has been identified [s]."""


class Following:
    """Follows an axis with a model of its velocity loop (lag and acceleration limit), sample by sample.

    Parameters
    ----------
    lag, acceleration : float
        Of the axis [s], [m/s2 or rad/s2].
    sync : float
        Between samples [s].
    slow : float
        Speed, expected, below which a standing axis is no wonder [m/s or rad/s].
    unmoved : float
        Way within which it counts as standing [m or rad].
    """

    def __init__(self, *, lag: float, acceleration: float, sync: float, slow: float, unmoved: float) -> None:
        self._lag, self._acceleration, self._sync = lag, acceleration, sync
        self._slow, self._unmoved = slow, unmoved
        self.restart()

    def restart(self) -> None:
        """Begin anew with the next sample."""
        self._last: MotionSample | None = None
        self._expected = 0.0
        self._off = 0.0
        self._stood_at = 0.0
        self._moving = 0.0

    def watch(self, sample: MotionSample, command: float) -> tuple[bool, float]:
        """Compare a sample with what the ``command`` [m/s or rad/s] lets expect.

        Returns
        -------
        tuple of bool, float
            Whether the encoder is stuck, and how far the axis is from where it should be, positive: too far.
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

        should_move = min(abs(command), abs(self._expected)) > self._slow  # told to rest, it may rest sooner
        if abs(sample.position - self._stood_at) > self._unmoved or not should_move:
            self._stood_at, self._moving = sample.position, 0.0
        else:
            self._moving += dt
        return self._moving > STUCK_AFTER - 0.5 * self._sync, self._off
