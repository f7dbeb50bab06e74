"""Checks of the height axis, as of the blade's motion along the cut; a blade that cannot be raised is a fault."""

from __future__ import annotations

import math
from collections import deque

from cutenv.rig.config.settings import HeightAxis
from cutenv.rig.devices.samples import MotionSample
from cutenv.rig.safety.following_monitor import NOMINAL_LAG, FollowingMonitor
from cutenv.rig.safety.motion_history import CREEP, FASTER, JITTER, LONG, OUTWARD, SAMPLES, elapsed, rests
from cutenv.rig.safety.stop_causes import Breach, Cause

_SLOW = 3e-4  # [m/s] expected speed below which the axis may stand still: it lowers the blade by tenths of a millimetre
_UNMOVED = 5e-6  # [m] within which it counts as standing


class HeightMonitor:
    """Monitor that checks every sample of the height axis against its limits and against the command.

    Parameters
    ----------
    axis : HeightAxis
        The axis with its limits.
    sync : float
        Time between samples [s].
    """

    def __init__(self, axis: HeightAxis, sync: float) -> None:
        self._axis, self._sync = axis, sync
        self._samples: deque[MotionSample] = deque(maxlen=LONG)
        self._following = FollowingMonitor(
            lag=NOMINAL_LAG, acceleration=axis.acceleration, sync=sync, slow=_SLOW, unmoved=_UNMOVED
        )
        self._returning: tuple[float, float] | None = None  # [m] allowed range while returning inside

    @property
    def beyond(self) -> str | None:
        """Height of a blade beyond an end of its vertical travel, as a text; None if it is inside."""
        axis = self._axis
        if not self._samples or axis.lowest <= self._samples[-1].position <= axis.highest:
            return None
        there = 1e3 * self._samples[-1].position
        return f"blade at a height of {there:.2f} mm, outside {1e3 * axis.lowest:g} to {1e3 * axis.highest:g} mm"

    @property
    def standing(self) -> bool:
        """True if the axis is at rest, as far as its samples show."""
        return rests(self._samples)

    def note(self, sample: MotionSample) -> None:
        """Store a sample."""
        self._samples.append(sample)

    def restart(self) -> None:
        """Clear the history: the axis is expected at rest, and inside its limits."""
        self._returning = None
        self._following.restart()

    def let_return(self) -> None:
        """Allow a blade beyond an end of its vertical travel to creep back, but never further out."""
        self._returning = (-math.inf, math.inf)
        self._draw_in()

    def _draw_in(self) -> None:
        if self._returning is not None and self._samples:
            (low, high), height = self._returning, self._samples[-1].position
            if height > self._axis.highest:
                self._returning = low, min(high, height + OUTWARD)
            elif height < self._axis.lowest:
                self._returning = max(low, height - OUTWARD), high
            else:
                self._returning = None

    def check(self, sample: MotionSample, command: float, *, follows: bool) -> Breach | None:
        """Check the newest sample against ``command`` [m/s], upwards; return the breach found, or None."""
        axis, samples = self._axis, self._samples
        stuck, off = self._following.watch(sample, command) if follows else (False, 0.0)
        travelled = (sample.position - samples[0].position) / elapsed(samples, len(samples), self._sync)
        acceleration = (sample.speed - samples[-min(SAMPLES, len(samples))].speed) / elapsed(
            samples, SAMPLES, self._sync
        )
        fastest = max(sample.speed, travelled / JITTER, key=abs)
        if self._returning is not None:
            low, high = self._returning
            if not low <= sample.position <= high:
                return Breach(Cause.HEIGHT, f"{self.beyond or 'the blade'}: it was to return inside, but moves outward")
            if abs(fastest) > FASTER * CREEP:
                return Breach(Cause.SPEED, f"{100 * fastest:.2f} cm/s upwards while returning, at {1e3 * CREEP:g} mm/s")
            self._draw_in()
        elif self.beyond is not None:
            return Breach(Cause.HEIGHT, self.beyond)
        if abs(fastest) > axis.fastest:
            return Breach(Cause.SPEED, f"{100 * fastest:+.2f} cm/s upwards, beyond {100 * axis.fastest:g} cm/s")
        if abs(acceleration) > axis.most_acceleration:
            beyond = f"beyond {axis.most_acceleration:g} m/s2"
            return Breach(Cause.ACCELERATION, f"{acceleration:+.2f} m/s2 upwards, {beyond}")
        if stuck and command > 0.0:
            return Breach(Cause.NOT_RAISED, f"commanded upwards at {1e3 * command:.1f} mm/s, but the encoder stands")
        if stuck:
            return Breach(Cause.STUCK, f"commanded downwards at {-1e3 * command:.1f} mm/s, but the encoder stands")
        if abs(off) > axis.following:
            cause = Cause.NOT_RAISED if command > 0.0 > off else Cause.FOLLOWING
            return Breach(cause, f"the blade is {1e3 * off:+.2f} mm above where it should be")
        return None
