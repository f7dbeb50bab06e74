"""Where the blade should be for what it was told: a blade that stands, slips or runs away is found out."""

from __future__ import annotations

import math

from cutenv.rig.causes import STUCK_AFTER
from cutenv.rig.samples import MotionSample
from cutenv.rig.settings import RigSettings

_MEMORY = 0.5  # [s] after which a difference is forgotten: lag and acceleration are not known to the last digit
_NOMINAL_LAG = 0.040  # [s], where none has been identified
_SLOW = 0.001  # [m/s], expected, below which a standing blade is no wonder
_UNMOVED = 5e-6  # [m]


class Following:
    """Follows the axis with a model of its velocity loop (lag and acceleration limit), sample by sample."""

    def __init__(self, settings: RigSettings) -> None:
        identified = settings.identified
        self._lag = identified.motor_lag or _NOMINAL_LAG
        self._acceleration = identified.acceleration or settings.blade.acceleration
        self._sync = settings.bus.sync
        self.restart()

    def restart(self) -> None:
        """Begin anew with the next sample."""
        self._last: MotionSample | None = None
        self._expected = 0.0
        self._off = 0.0
        self._stood_at = 0.0
        self._moving = 0.0

    def watch(self, sample: MotionSample, command: float) -> tuple[bool, float]:
        """Compare a sample with what the ``command`` [m/s] lets expect.

        Returns
        -------
        tuple of bool, float
            Whether the encoder is stuck, and how far the blade is from where it should be [m], positive: too far.
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

        if abs(sample.position - self._stood_at) > _UNMOVED or abs(self._expected) < _SLOW:
            self._stood_at, self._moving = sample.position, 0.0
        else:
            self._moving += dt
        return self._moving > STUCK_AFTER - 0.5 * self._sync, self._off
