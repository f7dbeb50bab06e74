"""Checks of the motion, from each sample of an axis and the few before it."""

from __future__ import annotations

import math
from collections import deque

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.samples import DriveState, MotionSample
from cutenv.rig.safety.following_monitor import NOMINAL_LAG, FollowingMonitor
from cutenv.rig.safety.height_monitor import HeightMonitor
from cutenv.rig.safety.motion_history import CREEP, FASTER, JITTER, LONG, OUTWARD, SAMPLES, elapsed, rests
from cutenv.rig.safety.sample_rate_monitor import SURPLUS, SampleRateMonitor
from cutenv.rig.safety.stop_causes import Breach, Cause

_ASTRAY = math.radians(10.0)  # [rad] allowed error of a hinge: its lag is not identified


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
        self._blade: deque[MotionSample] = deque(maxlen=LONG)
        self._height = None if settings.height is None else HeightMonitor(settings.height, settings.bus.sync)
        self._cadences: dict[str, SampleRateMonitor] = {}
        identified, sync = settings.identified, settings.bus.sync
        self._following = FollowingMonitor(
            lag=identified.motor_lag or NOMINAL_LAG,
            acceleration=identified.acceleration or settings.blade.acceleration,
            sync=sync, slow=0.001, unmoved=5e-6,
        )  # fmt: skip
        hinge = settings.blade if settings.angle is None else settings.angle
        self._turning = FollowingMonitor(
            lag=NOMINAL_LAG, acceleration=hinge.acceleration, sync=sync, slow=math.radians(1.0),
            unmoved=math.radians(0.005),
        )  # fmt: skip
        self._follows = follows
        self._returning: tuple[float, float] | None = None  # [m] allowed range while returning inside

    @property
    def beyond(self) -> str | None:
        """Position of a blade beyond an end of its travel, as a text; None if it is inside."""
        blade, limits = self.newest.get("blade"), self._limits
        if blade is None or limits.low <= blade.position <= limits.high:
            return None if self._height is None else self._height.beyond
        return f"blade at {1e3 * blade.position:.2f} mm, outside {1e3 * limits.low:g} to {1e3 * limits.high:g} mm"

    def let_return(self) -> None:
        """Allow a blade beyond an end of its travel to creep back, but never further out, until it is inside."""
        self._returning = (-math.inf, math.inf)
        self._draw_in()
        if self._height is not None:
            self._height.let_return()

    def _draw_in(self) -> None:
        """Narrow the allowed range to the position reached; once the blade is inside, restore the usual limits."""
        if self._returning is not None:
            (low, high), position = self._returning, self.newest["blade"].position
            if position > self._limits.high:
                self._returning = low, min(high, position + OUTWARD)
            elif position < self._limits.low:
                self._returning = max(low, position - OUTWARD), high
            else:
                self._returning = None

    def restart(self) -> None:
        """Clear the history: the axes are expected at rest, and inside their limits."""
        self._returning = None
        self._following.restart()
        self._turning.restart()
        if self._height is not None:
            self._height.restart()

    @property
    def standing(self) -> bool:
        """True if the blade is at rest along the cut and in its height, as far as the samples show."""
        return rests(self._blade) and (self._height is None or self._height.standing)

    def note(self, axis: str, sample: MotionSample) -> None:
        """Store a sample of an axis, and count it."""
        self.newest[axis] = sample
        self._cadences.setdefault(axis, SampleRateMonitor(self._sync)).count(sample.time)
        if axis == "blade":
            self._blade.append(sample)
        elif axis == "height" and self._height is not None:
            self._height.note(sample)

    def check(self, axis: str, command: float) -> Breach | None:
        """Check the newest sample of an axis against ``command`` [m/s or rad/s]; return the breach found, or None."""
        sample = self.newest[axis]
        if not (math.isfinite(sample.position) and math.isfinite(sample.speed)):
            return Breach(Cause.NOT_A_NUMBER, f"the {axis} axis reads position {sample.position}, speed {sample.speed}")
        if sample.state is not DriveState.ENABLED:
            return Breach(Cause.DRIVE, f'the {axis} drive went to "{sample.state.value}" by itself')
        if (surplus := self._cadences[axis].surplus) >= SURPLUS:
            more = f"{surplus:.0f} samples of the {axis} axis more than SYNCs"
            return Breach(Cause.MOTION_DOUBLED, f"{more}: does the bus double them, or does another master send SYNC?")
        if axis == "blade":
            return self._judge_blade(sample, command)
        if axis == "height" and self._height is not None:
            return self._height.check(sample, command, follows=self._follows)
        return self._judge_hinge(sample, command)

    def _judge_hinge(self, sample: MotionSample, command: float) -> Breach | None:
        stuck, off = self._turning.watch(sample, command) if self._follows else (False, 0.0)
        if not self._limits.angle_low <= sample.position <= self._limits.angle_high:
            return Breach(Cause.ANGLE, f"{math.degrees(sample.position):.1f} degrees, outside its limits")
        if stuck:
            told = f"{math.degrees(command):.0f} degrees a second"
            return Breach(Cause.STUCK, f"the hinge was commanded to turn at {told}, but its encoder stands")
        if abs(off) > _ASTRAY:
            return Breach(Cause.FOLLOWING, f"the hinge is {math.degrees(off):+.0f} degrees from where it should be")
        return None

    def _judge_blade(self, sample: MotionSample, command: float) -> Breach | None:
        limits = self._limits
        stuck, off = self._following.watch(sample, command) if self._follows else (False, 0.0)
        first = self._blade[0]
        travelled = (sample.position - first.position) / elapsed(self._blade, len(self._blade), self._sync)
        recent = self._blade[-min(SAMPLES, len(self._blade))]
        acceleration = (sample.speed - recent.speed) / elapsed(self._blade, SAMPLES, self._sync)
        fastest = max(sample.speed, travelled / JITTER, key=abs)
        if self._returning is not None:
            low, high = self._returning
            if not low <= sample.position <= high:
                return Breach(Cause.TRAVEL, f"{self.beyond or 'the blade'}: it was to return inside, but moves outward")
            if abs(fastest) > FASTER * CREEP:
                return Breach(Cause.SPEED, f"{100 * fastest:.2f} cm/s while returning, at {1e3 * CREEP:g} mm/s")
            self._draw_in()
        elif not limits.low <= sample.position <= limits.high:
            return Breach(Cause.TRAVEL, f"{self.beyond}")
        if abs(fastest) > limits.speed:
            return Breach(Cause.SPEED, f"{100 * fastest:.2f} cm/s beyond {100 * limits.speed:g} cm/s")
        if abs(acceleration) > limits.acceleration:
            return Breach(Cause.ACCELERATION, f"{acceleration:.2f} m/s2 beyond {limits.acceleration:g} m/s2")
        if stuck:
            return Breach(Cause.STUCK, f"commanded to move at {100 * command:.2f} cm/s, but the encoder stands")
        if abs(off) > limits.following:
            return Breach(Cause.FOLLOWING, f"{1e3 * off:+.2f} mm from where the blade should be")
        return None
