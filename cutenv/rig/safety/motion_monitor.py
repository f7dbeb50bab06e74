"""Checks of the motion, from each sample of an axis and the few before it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial

from cutenv.rig.config.settings import Reach, RigSettings
from cutenv.rig.devices.drivers import DriveState, MotionSample
from cutenv.rig.safety.stop_causes import SURPLUS, Breach, Cause, SampleRateMonitor, stuck_after

REST_SPEED = 1e-4
"""Speed below which the blade counts as at rest [m/s]."""
SAMPLES = 3
"""Samples over which acceleration is measured, and standstill decided."""
LONG = 9
"""Samples over which speed is computed from position, whatever speed the drive reports."""
JITTER = 1.2
"""Factor on the limit for such a speed [1]: samples arrive unevenly."""
CREEP = 0.002
"""Greatest speed at which a blade returns from beyond an end of its travel [m/s]."""
SUMMED = 0.005
"""Sum of the differences from the commanded way, from rest to rest, at which an axis that moves is stopped [m]."""
MOST_TORQUE = 2.5
"""Torque of a motor over its rated torque [1], at which it is stopped if it lasts for :data:`SAMPLES` samples."""
FASTER = 2.0
"""Multiple of :data:`CREEP` from which the return is a breach [1]."""
OUTWARD = 2e-4
"""Distance outward from the innermost position reached, from which the return is a breach [m]."""


def rests(samples: deque[MotionSample]) -> bool:
    """Return whether an axis is at rest, as far as its samples show."""
    last = list(samples)[-SAMPLES:]
    return len(last) == SAMPLES and all(abs(sample.speed) < REST_SPEED for sample in last)


def elapsed(samples: deque[MotionSample], count: int, sync: float) -> float:
    """Return the time from the first of the last ``count`` samples to the newest [s].

    A computer that stalled gets several samples at once; they count as one period ``sync`` [s] apart.
    """
    count = min(count, len(samples))
    return max(samples[-1].time - samples[-count].time, (count - 1) * sync, 1e-6)


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
        self._off = self._summed = 0.0
        self._rest_at: float | None = None
        self._stood_at = 0.0
        self._moving = 0.0

    def watch(self, sample: MotionSample, command: float) -> tuple[bool, float]:
        """Compare a sample with the motion expected from ``command`` [m/s or rad/s].

        Returns
        -------
        tuple of bool, float
            True if the encoder is stuck, and the distance of the axis from where it should be [m or rad], positive: too
            far. Differences in motion are forgotten; from the place where it came to rest they are not.
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
        moved = sample.position - last.position
        self._off = (self._off + moved - should) * math.exp(-dt / _MEMORY)
        # By the time that has passed: what arrives unevenly would add up where each sample counts a period at least.
        self._summed += moved - 0.5 * (before + self._expected) * (sample.time - last.time)
        if command != 0.0 or abs(self._expected) > 0.1 * self._slow:
            self._rest_at = None
        elif self._rest_at is None:
            self._rest_at, self._summed = sample.position, 0.0
        else:
            self._off = sample.position - self._rest_at

        should_move = min(abs(command), abs(self._expected)) > self._slow  # commanded to rest, it may rest sooner
        if abs(sample.position - self._stood_at) > self._unmoved or not should_move:
            self._stood_at, self._moving = sample.position, 0.0
        else:
            self._moving += dt
        return self._moving > stuck_after(self._sync) - 0.5 * self._sync, self._off

    @property
    def summed(self) -> float:
        """Sum of all that the axis has moved too far since it last rested [m or rad], which is not forgotten."""
        return self._summed


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

    def adopt(self, limits: Reach) -> None:
        """Check against other limits from now on."""
        self._limits = limits

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
        if not abs(fastest) <= limits.speed:
            return Breach(Cause.SPEED, f"{100 * fastest:+.2f} cm/s{self._way}, beyond {100 * limits.speed:g} cm/s")
        if not abs(acceleration) <= limits.acceleration:
            beyond = f"beyond {limits.acceleration:g} m/s2"
            return Breach(Cause.ACCELERATION, f"{acceleration:+.2f} m/s2{self._way}, {beyond}")
        if stuck:
            return self._stuck(command)
        if not abs(off) <= limits.following:
            return self._astray(off, command)
        summed = self._following.summed if follows else 0.0
        return None if abs(summed) <= max(SUMMED, limits.following) else self._astray(summed, command)

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


_SLOW_ACROSS = 3e-4  # [m/s] expected speed below which an axis across the cut may stand still
_UNMOVED = 5e-6  # [m] within which a straight axis counts as standing
_ASTRAY = math.radians(10.0)  # [rad] allowed error of a hinge: its lag is not identified


_ACROSS: Mapping[str, Callable[[Reach, FollowingMonitor, float], LinearMonitor]] = {
    "height": partial(HeightMonitor, outside=Cause.HEIGHT, place="blade at a height of", way=" upwards"),
    "side": partial(LinearMonitor, outside=Cause.SIDE, place="blade to the left by", way=" to the left"),
}


class MotionMonitor:
    """Monitor that checks every axis sample against the limits and against the command.

    Parameters
    ----------
    settings : RigSettings
        Limits, and the axes' properties that determine the expected motion.
    follows : bool
        True if the blade follows commands; False for a replayed cut.

    Attributes
    ----------
    newest : dict
        Last sample of each axis.
    """

    def __init__(self, settings: RigSettings, *, follows: bool) -> None:
        self._limits, self._sync = settings.limits, settings.bus.sync
        self.newest: dict[str, MotionSample] = {}
        self._cadences: dict[str, SampleRateMonitor] = {}
        self._strained: dict[str, int] = {}  # consecutive samples of a motor beyond its torque
        identified, reaches, sync = settings.identified, settings.reaches, settings.bus.sync
        following = FollowingMonitor(
            lag=identified.motor_lag or NOMINAL_LAG,
            acceleration=identified.acceleration or settings.blade.acceleration,
            sync=sync, slow=0.001, unmoved=_UNMOVED,
        )  # fmt: skip
        self._linear: dict[str, LinearMonitor] = {"blade": LinearMonitor(reaches["blade"], following, sync)}
        for name, axis in settings.cross_axes.items():
            across = FollowingMonitor(
                lag=NOMINAL_LAG, acceleration=axis.acceleration, sync=sync, slow=_SLOW_ACROSS, unmoved=_UNMOVED
            )
            self._linear[name] = _ACROSS[name](reaches[name], across, sync)
        hinge = settings.blade if settings.angle is None else settings.angle
        self._turning = FollowingMonitor(
            lag=NOMINAL_LAG, acceleration=hinge.acceleration, sync=sync, slow=math.radians(1.0),
            unmoved=math.radians(0.005),
        )  # fmt: skip
        self._follows = follows

    def adopt(self, settings: RigSettings) -> None:
        """Check against other limits from now on."""
        self._limits = settings.limits
        for name, reach in settings.reaches.items():
            self._linear[name].adopt(reach)

    @property
    def beyond(self) -> str | None:
        """Place of a blade beyond an end of its travel, as a text; None if it is inside."""
        return next((axis.beyond for axis in self._linear.values() if axis.beyond is not None), None)

    def let_return(self) -> None:
        """Allow a blade beyond an end of its travel to creep back, but never further out, until it is inside."""
        for axis in self._linear.values():
            axis.let_return()

    def restart(self) -> None:
        """Clear the history: the axes are expected at rest, and inside their limits."""
        self._turning.restart()
        for axis in self._linear.values():
            axis.restart()

    @property
    def standing(self) -> bool:
        """True if the blade is at rest along every straight axis, as far as the samples show."""
        return all(axis.standing for axis in self._linear.values())

    def note(self, axis: str, sample: MotionSample) -> None:
        """Store a sample of an axis, and count it."""
        self.newest[axis] = sample
        self._cadences.setdefault(axis, SampleRateMonitor(self._sync)).count(sample.time)
        if axis in self._linear:
            self._linear[axis].note(sample)

    def check(self, axis: str, command: float) -> Breach | None:
        """Check the newest sample of an axis against ``command`` [m/s or rad/s]; return the breach found, or None."""
        sample = self.newest[axis]
        if not all(map(math.isfinite, (sample.position, sample.speed, sample.torque))):
            read = f"position {sample.position}, speed {sample.speed}, torque {sample.torque}"
            return Breach(Cause.NOT_A_NUMBER, f"the {axis} axis reads {read}")
        if sample.state is not DriveState.ENABLED:
            return Breach(Cause.DRIVE, f'the {axis} drive went to "{sample.state.value}" by itself')
        if (surplus := self._cadences[axis].surplus) >= SURPLUS:
            more = f"{surplus:.0f} samples of the {axis} axis more than SYNCs"
            return Breach(Cause.MOTION_DOUBLED, f"{more}: does the bus double them, or does another master send SYNC?")
        strained = self._strained.get(axis, 0) + 1 if not abs(sample.torque) <= MOST_TORQUE else 0
        self._strained[axis] = strained
        if strained >= SAMPLES:
            return Breach(Cause.DRIVE, f"the {axis} motor is at {100 * sample.torque:+.0f} % of its rated torque")
        if axis in self._linear:
            return self._linear[axis].check(sample, command, follows=self._follows)
        return self._judge_hinge(sample, command)

    def _judge_hinge(self, sample: MotionSample, command: float) -> Breach | None:
        stuck, off = self._turning.watch(sample, command) if self._follows else (False, 0.0)
        if not self._limits.angle_low <= sample.position <= self._limits.angle_high:
            return Breach(Cause.ANGLE, f"{math.degrees(sample.position):.1f} degrees, outside its limits")
        if stuck:
            told = f"{math.degrees(command):.0f} degrees a second"
            return Breach(Cause.STUCK, f"the hinge was commanded to turn at {told}, but its encoder stands")
        if not abs(off) <= _ASTRAY:
            return Breach(Cause.FOLLOWING, f"the hinge is {math.degrees(off):+.0f} degrees from where it should be")
        return None
