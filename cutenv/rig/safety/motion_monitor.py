"""Checks of the motion, from each sample of an axis and the few before it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

from cutenv.rig.config.settings import Reach, RigSettings
from cutenv.rig.devices.samples import DriveState, MotionSample
from cutenv.rig.safety.following_monitor import NOMINAL_LAG, FollowingMonitor
from cutenv.rig.safety.linear_monitor import HeightMonitor, LinearMonitor
from cutenv.rig.safety.sample_rate_monitor import SURPLUS, SampleRateMonitor
from cutenv.rig.safety.stop_causes import Breach, Cause

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
        if not (math.isfinite(sample.position) and math.isfinite(sample.speed)):
            return Breach(Cause.NOT_A_NUMBER, f"the {axis} axis reads position {sample.position}, speed {sample.speed}")
        if sample.state is not DriveState.ENABLED:
            return Breach(Cause.DRIVE, f'the {axis} drive went to "{sample.state.value}" by itself')
        if (surplus := self._cadences[axis].surplus) >= SURPLUS:
            more = f"{surplus:.0f} samples of the {axis} axis more than SYNCs"
            return Breach(Cause.MOTION_DOUBLED, f"{more}: does the bus double them, or does another master send SYNC?")
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
        if abs(off) > _ASTRAY:
            return Breach(Cause.FOLLOWING, f"the hinge is {math.degrees(off):+.0f} degrees from where it should be")
        return None
