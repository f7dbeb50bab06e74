"""Checks of an axis that moves in a straight line, from each of its samples and the few before it."""

from __future__ import annotations

import math
from collections import deque

from cutenv.rig.config.settings import Reach
from cutenv.rig.devices.samples import MotionSample
from cutenv.rig.safety.following_monitor import FollowingMonitor
from cutenv.rig.safety.motion_history import CREEP, FASTER, JITTER, LONG, OUTWARD, SAMPLES, elapsed, rests
from cutenv.rig.safety.stop_causes import Breach, Cause


class LinearMonitor:
    """Monitor that checks every sample of one axis against its limits and against the command.

    Parameters
    ----------
    limits : Reach
        Limits of the axis.
    following : FollowingMonitor
        Model of its velocity loop.
    sync : float
        Time between samples [s].
    outside : Cause
        Cause of a stop beyond an end of travel.
    place, way : str
        Words for its place and direction.
    """

    def __init__(
        self, limits: Reach, following: FollowingMonitor, sync: float, *, outside: Cause = Cause.TRAVEL,
        place: str = "blade at", way: str = "",
    ) -> None:  # fmt: skip
        self._limits, self._following, self._sync = limits, following, sync
        self._outside, self._place, self._way = outside, place, way
        self._samples: deque[MotionSample] = deque(maxlen=LONG)
        self._returning: tuple[float, float] | None = None  # [m] allowed range while returning inside

    @property
    def beyond(self) -> str | None:
        """Place of a blade beyond an end of this axis's travel, as a text; None if it is inside."""
        limits = self._limits
        if not self._samples or limits.low <= self._samples[-1].position <= limits.high:
            return None
        there, low, high = (1e3 * each for each in (self._samples[-1].position, limits.low, limits.high))
        return f"{self._place} {there:.2f} mm, outside {low:g} to {high:g} mm"

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
        """Allow a blade beyond an end of its travel to creep back, but never further out, until it is inside."""
        self._returning = (-math.inf, math.inf)
        self._draw_in()

    def _draw_in(self) -> None:
        """Narrow the allowed range to the position reached; once the blade is inside, restore the usual limits."""
        if self._returning is not None and self._samples:
            (low, high), position = self._returning, self._samples[-1].position
            if position > self._limits.high:
                self._returning = low, min(high, position + OUTWARD)
            elif position < self._limits.low:
                self._returning = max(low, position - OUTWARD), high
            else:
                self._returning = None

    def check(self, sample: MotionSample, command: float, *, follows: bool) -> Breach | None:
        """Check the newest sample against ``command`` [m/s]; return the breach found, or None.

        ``follows`` is False for a replayed cut, which follows no command.
        """
        limits, samples = self._limits, self._samples
        stuck, off = self._following.watch(sample, command) if follows else (False, 0.0)
        travelled = (sample.position - samples[0].position) / elapsed(samples, len(samples), self._sync)
        recent = samples[-min(SAMPLES, len(samples))]
        acceleration = (sample.speed - recent.speed) / elapsed(samples, SAMPLES, self._sync)
        fastest = max(sample.speed, travelled / JITTER, key=abs)
        if self._returning is not None:
            low, high = self._returning
            if not low <= sample.position <= high:
                where = self.beyond or "the blade"
                return Breach(self._outside, f"{where}: it was to return inside, but moves outward")
            if abs(fastest) > FASTER * CREEP:
                told = f"while returning, at {1e3 * CREEP:g} mm/s"
                return Breach(Cause.SPEED, f"{100 * fastest:.2f} cm/s{self._way} {told}")
            self._draw_in()
        elif (beyond := self.beyond) is not None:
            return Breach(self._outside, beyond)
        if abs(fastest) > limits.speed:
            return Breach(Cause.SPEED, f"{100 * fastest:+.2f} cm/s{self._way}, beyond {100 * limits.speed:g} cm/s")
        if abs(acceleration) > limits.acceleration:
            beyond = f"beyond {limits.acceleration:g} m/s2"
            return Breach(Cause.ACCELERATION, f"{acceleration:+.2f} m/s2{self._way}, {beyond}")
        if stuck:
            return self._stuck(command)
        return self._astray(off, command) if abs(off) > limits.following else None

    def _stuck(self, command: float) -> Breach:
        """Return the breach of an axis whose encoder stands though it was commanded to move [m/s]."""
        return Breach(Cause.STUCK, f"commanded to move at {100 * command:.2f} cm/s, but the encoder stands")

    def _astray(self, off: float, command: float) -> Breach:
        """Return the breach of an axis that is ``off`` [m] from where its commands should have brought it."""
        return Breach(Cause.FOLLOWING, f"{1e3 * off:+.2f} mm from where the blade should be")


class HeightMonitor(LinearMonitor):
    """Monitor of the height axis; commands are upwards, and a blade that cannot be raised is a fault."""

    def _stuck(self, command: float) -> Breach:
        if command > 0.0:
            return Breach(Cause.NOT_RAISED, f"commanded upwards at {1e3 * command:.1f} mm/s, but the encoder stands")
        return Breach(Cause.STUCK, f"commanded downwards at {-1e3 * command:.1f} mm/s, but the encoder stands")

    def _astray(self, off: float, command: float) -> Breach:
        cause = Cause.NOT_RAISED if command > 0.0 > off else Cause.FOLLOWING
        return Breach(cause, f"the blade is {1e3 * off:+.2f} mm above where it should be")
