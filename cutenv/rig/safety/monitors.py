"""Checks of force and motion, from each sample and the few before."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

from cutenv.rig.config.settings import HeightAxis, Identified, Reach, RigSettings, SafetyLimits
from cutenv.rig.devices.protocols import DriveState, ForceSample, MotionSample
from cutenv.rig.devices.reading_stream import LEAK, SEQUENCES, SampleClock
from cutenv.rig.safety.stop_causes import STILL, SURPLUS, Breach, Cause, SampleRateMonitor, stuck_after

RISE_OVER = 0.010  # window over which a rise of force is measured, longer than noise lasts [s]
_LOSS_OVER = 0.100  # [s] window for the share of lost readings
_HARDER = 0.5  # [N] beyond the least vertical force since the blade is raised to be relieved, at which it is stopped


class ForceReadings(NamedTuple):
    """Readings that a force sensor sends."""

    rate: float  # rate of the readings [Hz]
    rate_error: float = LEAK  # greatest relative error of the rate [1]
    axes: str = "xyz"  # axes that the sensor measures; the others stand at 0


class ForceMonitor:
    """Monitor that checks every force reading against the limits.

    ``identified`` has the time that each force axis stays at one count through its own noise, ``height`` the limit of
    the vertical force.
    """

    def __init__(
        self,
        limits: SafetyLimits,
        readings: ForceReadings,
        identified: Identified | None = None,
        height: HeightAxis | None = None,
    ) -> None:
        self._limits, self._rate, self._height = limits, readings.rate, height
        self._leak = max(readings.rate_error, LEAK)
        self._live = ["xyz".index(axis) for axis in readings.axes]
        self._over = max(RISE_OVER, 1.0 / readings.rate)  # [s] a slow sensor's window is one period
        known = identified or Identified()
        still = (known.force_still_x, known.force_still_y, known.force_still_z)
        self._identified = tuple(each is not None for each in still)
        self._still = tuple(max(STILL if each is None else each, limits.frozen_force) for each in still)  # [s]
        self.newest: ForceSample | None = None  # last reading; None before the first
        self.restart()

    def restart(self) -> None:
        """Clear the history, except for the newest reading."""
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=max(round(RISE_OVER * self._rate), 1) + 1)
        self._losses: deque[int] = deque(maxlen=max(round(_LOSS_OVER * self._rate), 2))
        self._lost = 0
        self._equal = 0  # consecutive readings equal to the one before
        self._stood = [0, 0, 0]  # the same for each force axis, while the blade moves
        self._arrivals = SampleClock(self._rate, self._leak)
        self._relieved: float | None = None  # [N] least vertical force since the blade is raised to be relieved

    def adopt(self, limits: SafetyLimits) -> None:
        """Check against other limits from now on."""
        self._limits = limits

    @property
    def pressed(self) -> str | None:
        """Vertical force beyond its limit, from a blade that presses on the tissue, as a text; None if it is within."""
        height, newest = self._height, self.newest
        if height is None or newest is None or height.felt(newest.force) <= height.vertical_force:
            return None
        up = height.felt(newest.force)
        return f"the blade presses on the tissue with {up:.1f} N, {height.vertical_force:g} N allowed"

    def let_relieve(self) -> None:
        """Allow a vertical force that is beyond its limit now, as long as it falls, until it is within."""
        if self._height is not None and self.newest is not None and self.pressed is not None:
            self._relieved = self._height.felt(self.newest.force)

    @property
    def relieving(self) -> bool:
        """True while a blade is raised to be relieved."""
        return self._relieved is not None

    def _lifted_too_much(self, height: HeightAxis, force: tuple[float, float, float]) -> bool:
        up = height.felt(force)
        if self._relieved is not None:
            self._relieved = min(self._relieved, up)
            if self._relieved > 0.9 * height.vertical_force:  # less: readings that flicker about the limit
                return up > self._relieved + _HARDER
            self._relieved = None
        return not abs(up) <= height.vertical_force

    def check(self, sample: ForceSample, *, moving: bool = False) -> Breach | None:
        """Check a reading of a blade that is commanded to move or to rest; return the breach found, or None."""
        last, self.newest = self.newest, sample
        x, y, z = sample.force
        norm = math.hypot(x, y, z)
        self._forces.append(sample.force)
        read, before = sample.counts, None if last is None else last.counts
        self._equal = self._equal + 1 if read == before else 0
        for axis in self._live:
            same = before is not None and before[axis] == read[axis]
            self._stood[axis] = self._stood[axis] + moving if same else 0  # a pause of the blade does not reset it
        if len(self._losses) == self._losses.maxlen:
            self._lost -= self._losses[0]
        self._losses.append(sample.lost)
        self._lost += sample.lost
        lateness = self._arrivals.sensed(sample.sequence, sample.time)[1]

        limits = self._limits
        rise = _rise(self._forces[0], sample.force) if len(self._forces) == self._forces.maxlen else 0.0
        twist = math.hypot(*sample.torque)
        # One loss among the first few readings is not a large share.
        share = self._lost / max(self._lost + len(self._losses), _LOSS_OVER * self._rate)
        # Each comparison is written so that what is no number is a breach.
        if not (math.isfinite(norm) and math.isfinite(twist)):
            return Breach(Cause.NOT_A_NUMBER, f"the sensor reads {sample.force} N, {sample.torque} N m")
        if sample.status:
            return Breach(Cause.FORCE_STATUS, f"the sensor's status is 0x{sample.status:08X}")
        if last is not None and (sample.sequence - last.sequence - 1 - sample.lost) % SEQUENCES:
            counts = f"{sample.sequence} comes after {last.sequence}"
            return Breach(Cause.FORCE_STATUS, f"the sensor was restarted, its zero may be gone: reading {counts}")
        if not max(abs(x), abs(y), abs(z)) <= limits.force:
            return Breach(Cause.FORCE, f"{_newtons(sample)} beyond {limits.force:g} N in an axis")
        if (height := self._height) is not None and self._lifted_too_much(height, sample.force):
            up = f"{height.felt(sample.force):+.2f} N upwards"
            return Breach(Cause.VERTICAL_FORCE, f"{up}, beyond {height.vertical_force:g} N")
        if not norm <= limits.force_norm:
            return Breach(Cause.FORCE, f"{norm:.2f} N in all, beyond {limits.force_norm:g} N")
        if not twist <= limits.torque:
            return Breach(Cause.TORQUE, f"{twist:.2f} N m, beyond {limits.torque:g} N m")
        if not rise <= limits.force_rise * self._over:
            return Breach(Cause.FORCE_RISE, f"the force changed by {rise:.2f} N within {1e3 * self._over:g} ms")
        if self._equal >= limits.frozen_force * self._rate:
            return Breach(Cause.FORCE_FROZEN, f"{self._equal + 1} consecutive readings have the same counts")
        for number, still in enumerate(self._still):
            if self._stood[number] >= still * self._rate:
                return Breach(Cause.FORCE_AXIS, self._stands(number))
        if not share <= limits.lost_force:
            return Breach(Cause.FORCE_LOST, f"{share:.0%} of the last readings were lost")
        if not lateness <= limits.late_force:
            return Breach(Cause.FORCE_LATE, f"readings arrive {1e3 * lateness:.0f} ms later than before")
        return None

    def _stands(self, axis: int) -> str:
        """Describe an axis that stays at one count; a quiet sensor may do so if its noise was never identified."""
        text = f"the {'xyz'[axis]} force stays at one count for {1e3 * self._still[axis]:.0f} ms while the blade moves"
        if self._identified[axis]:
            return text
        return text + "; if the sensor works, measure its noise: cutenv rig identify --write"


def _rise(before: tuple[float, float, float], now: tuple[float, float, float]) -> float:
    """Return by how much a force has grown or turned [N]: its distance from every fall of the one before.

    A fall is no breach, because the force falls when a crack runs; one that swings to the other side is.
    """
    (x, y, z), (now_x, now_y, now_z) = before, now  # written out: it is asked at each reading
    squared = x * x + y * y + z * z
    along = x * now_x + y * now_y + z * now_z
    left = min(max(along / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return math.hypot(now_x - left * x, now_y - left * y, now_z - left * z)


def _newtons(sample: ForceSample) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in sample.force) + ") N"


REST_SPEED = 1e-4  # speed below which the blade counts as at rest [m/s]
SAMPLES = 3  # samples over which acceleration is measured, and standstill decided
LONG = 9  # samples over which speed is computed from position, whatever speed the drive reports
JITTER = 1.2  # factor on the limit for such a speed [1]: samples arrive unevenly
CREEP = 0.002  # greatest speed at which a blade returns from beyond an end of its travel [m/s]
# sum of the differences from the commanded way, from rest to rest, at which an axis that moves is stopped [m]
SUMMED = 0.005
# torque of a motor over its rated torque [1], at which it is stopped if it lasts for :data:`SAMPLES` samples
MOST_TORQUE = 2.5
FASTER = 2.0  # multiple of :data:`CREEP` from which the return is a breach [1]
OUTWARD = 2e-4  # distance outward from the innermost position reached, from which the return is a breach [m]


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
NOMINAL_LAG = 0.040  # lag of a velocity loop that has not been identified [s]


class FollowingMonitor:
    """Model of an axis's velocity loop (lag and acceleration limit), compared with its samples one by one.

    ``lag`` [s] and ``acceleration`` limit [m/s2 or rad/s2] are the axis's; ``sync``: time between samples [s];
    ``slow``: expected speed below which an axis may stand still [m/s or rad/s]; ``unmoved``: distance within which it
    counts as standing [m or rad].
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

        Return True if the encoder is stuck, and the distance of the axis from where it should be [m or rad], positive:
        too far. Differences in motion are forgotten; from the place where it came to rest they are not.
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

    ``sync``: time between samples [s]; ``outside``: cause of a stop beyond an end of travel; ``place``, ``way``: words
    for its place and direction.
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
        """Check the newest sample against ``command`` [m/s].

        Return the breach found, or None.

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
    """Monitor of the height axis.

    Commands are upwards, and a blade that cannot be raised is a fault.
    """

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

    ``follows``: True if the blade follows commands; False for a replayed cut.
    """

    def __init__(self, settings: RigSettings, *, follows: bool) -> None:
        self._limits, self._sync = settings.limits, settings.bus.sync
        self.newest: dict[str, MotionSample] = {}  # last sample of each axis
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
