"""Spine of a rig.

Its drivers, and the safety that judges all that they report. The loop that calls both is the clock's,
:class:`cutenv.rig.devices.loop.SystemClock`.

All that has to work for the blade to be stopped is here and below (``safety``, ``devices``, ``config``). On hardware,
and on an emulated rig, it runs in a process of its own, :mod:`cutenv.rig.spine_process`. The policy's program reaches
it by :mod:`cutenv.rig.remote_spine`, and cannot hold it up.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.driver_registry import Mounting, mounted
from cutenv.rig.devices.loop import Attempt, Clock, Repeating
from cutenv.rig.devices.protocols import ForceDriver, ForceSample, MotionDriver, MotionSample, Observer, ZeroedByHand
from cutenv.rig.errors import RigError
from cutenv.rig.safety.monitors import ForceReadings
from cutenv.rig.safety.stop_causes import STOP_PERIOD, WATCH, Cause
from cutenv.rig.safety.supervisor import Supervisor

_SAME_RATE = 0.02  # relative difference allowed between the sensor's rate and the file's
_LOCKED_WITHIN = 0.5  # [s] for the last zero speed to be on the bus
CLOSED_WITHIN = 8.0  # time for a driver to close [s]: to bring its axis to rest, and to switch its power off
_log = logging.getLogger(__name__)


class Receiver(Observer, Protocol):
    """Receiver of what drivers have reported, once it is judged.

    Called in the loop, or in a thread of theirs, and must never wait.
    """

    def garbled(self, why: str, time: float) -> None:
        """Take the report of a packet that is not a valid reading, at ``time`` [s]."""
        ...


class Spine:
    """Drivers of a rig, under a :class:`~cutenv.rig.safety.supervisor.Supervisor`.

    ``axes``: drivers of the blade, first, and of angle, height and side where it has them; without one of the angle it
    is set by hand, and angle commands are ignored; ``follows``: False for a replayed cut only.
    """

    gone = False  # False: it lives as long as this process

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        axes: Sequence[MotionDriver],
        sensor: ForceDriver,
        *,
        follows: bool = True,
    ) -> None:
        self.settings, self.clock = settings, clock
        self.axes, self.sensor = tuple(axes), sensor
        self._gain = settings.calibration.gain
        readings = ForceReadings(sensor.rate, sensor.rate_error, sensor.axes)
        # safety monitor; it has to be released before any motion
        self.supervisor = Supervisor(settings, clock, self.axes, readings, follows=follows)
        # actions that the loop repeats: the watchdog, the repeated quick stops, the look at the parent process
        self.timers: list[Repeating] = []
        self._receiver: Receiver | None = None
        self._parent = os.getppid()

    def open(self, receiver: Receiver) -> None:
        """Connect to drives and sensor; nothing moves.

        The drives come first: another program that uses the rig is noticed on their bus before its sensor is taken
        away. Raise RigError if a device is missing or not as expected; none stays open.
        """
        self._receiver, self._parent = receiver, os.getppid()
        try:
            for axis in self.axes:
                axis.open(self)
            self.sensor.open(self)
            self._check_rate()
        except BaseException:
            self.close()
            raise
        self.clock.failed = self._failed
        self.timers = [
            self.clock.every(WATCH, self.supervisor.watch, "rig watchdog"),
            self.clock.every(STOP_PERIOD, self.supervisor.resend_stop, "rig quick stops"),
            self.clock.every(WATCH, self._watch_parent, "rig parent watch"),
        ]

    def hear(self) -> None:
        """Do nothing: whatever drivers report is received at once."""

    def _check_rate(self) -> None:
        """Raise RigError for a sensor at another rate than in the file: force limits count readings."""
        rate, wanted = self.sensor.rate, self.settings.sensor.rate
        if abs(rate / wanted - 1.0) > max(_SAME_RATE, self.sensor.rate_error):
            raise RigError(
                f"the force sensor sends {rate:g} readings a second, but the rig's file has {wanted:g}. Set the rate "
                "in the sensor (a Net F/T: the RDT output rate on its page), or rate_Hz under [sensor] in the file."
            )

    def _watch_parent(self, now: float) -> None:
        if os.getppid() != self._parent:
            self.supervisor.trip(Cause.ORPHANED, f"the process {self._parent}, which started this one, has ended", now)

    def close(self) -> None:
        """Stop any motion and close drives and sensor; never raises for a rig that is gone."""
        if not self.supervisor.standing:
            self.supervisor.trip(Cause.OPERATOR, "the rig is being closed")
        Attempt(self.supervisor.lock, "rig lock").ends(_LOCKED_WITHIN)
        closes: dict[str, Callable[[], None]] = {axis.name: axis.close for axis in self.axes}
        for name, close in (closes | {"sensor": self.sensor.close}).items():
            closing = Attempt(close, f"rig close {name}")  # one that fails or hangs keeps no other open
            if not closing.ends(CLOSED_WITHIN) or closing.error is not None:
                _log.warning("the %s was not closed in order: %s", name, closing.error or "its driver does not return")
        while self.timers:
            self.timers.pop().stop()
        self.supervisor.unwatched()

    def power(self) -> None:
        """Switch the drives on, at rest; :meth:`Supervisor.release` then allows commands."""
        for axis in self.axes:
            axis.enable()

    def switch_off(self) -> None:
        """Switch off the power of drives at rest; their samples continue."""
        self.supervisor.lock()
        for axis in self.axes:
            axis.disable()

    @property
    def rate(self) -> float:
        """Readings of the force sensor per second [Hz]."""
        return self.sensor.rate

    @property
    def rate_error(self) -> float:
        """Greatest relative error of the force sensor's rate [1]."""
        return self.sensor.rate_error

    @property
    def counts_steps(self) -> bool:
        """True if the blade's drive counts the steps that it sends, and does not see whether the blade moves."""
        return isinstance(self.axes[0], ZeroedByHand)

    def set_zero(self) -> None:
        """Take the blade's present position, without power, as zero: it stands at the clamp."""
        blade = self.axes[0]
        if not isinstance(blade, ZeroedByHand):
            raise RigError(
                f"the drive of {self.settings.name!r} keeps its own zero: home it with its maker's tool, at the clamp."
            )
        blade.set_zero()

    def drive_limits(self) -> dict[str, dict[str, float]]:
        """Return the limits that each drive reports, by axis."""
        return {axis.name: axis.limits() for axis in self.axes}

    def about(self) -> dict[str, dict[str, float | str]]:
        """Return the data that drives and sensor report about themselves, by name."""
        return {axis.name: axis.about() for axis in self.axes} | {"sensor": self.sensor.about()}

    def tare(self) -> tuple[float, float, float]:
        """Take the present force as zero; return it [N], relative to the sensor's own zero."""
        return self.sensor.tare(tare_readings(self.sensor.rate))

    # Reports of the drivers go to the supervisor first. Whatever time they give, that of their arrival here counts; and
    # a report that cannot be judged, for any reason, is a fault, and ends neither loop nor driver's thread.

    def _failed(self, why: str) -> None:
        self.supervisor.trip(Cause.EXCEPTION, why)

    def _judged(self, what: str, judge: Callable[..., None], *report: Any) -> None:
        try:
            judge(*report)
        except Exception as error:
            self._failed(f"{what} cannot be judged: {type(error).__name__}: {error}")

    def force(self, sample: ForceSample) -> None:
        """Take a reading of the force sensor."""
        self._judged("a reading of the sensor", self._take_force, sample)

    def _take_force(self, sample: ForceSample) -> None:
        sample = ForceSample(self.clock.now(), *sample[1:])
        if self._gain != 1.0:
            (x, y, z), (a, b, c), gain = sample.force, sample.torque, self._gain
            sample = sample._replace(force=(gain * x, gain * y, gain * z), torque=(gain * a, gain * b, gain * c))
        self.supervisor.force(sample)
        if self._receiver is not None:
            self._receiver.force(sample)

    def garbled(self, why: str, time: float) -> None:
        """Take the report of a packet that is not a valid reading."""
        if self._receiver is not None:
            self._receiver.garbled(why, self.clock.now())

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Take a sample of an axis."""
        self._judged(f"a sample of the {axis} axis", self._take_motion, axis, sample)

    def _take_motion(self, axis: str, sample: MotionSample) -> None:
        sample = MotionSample(self.clock.now(), *sample[1:])
        self.supervisor.motion(axis, sample)
        if self._receiver is not None:
            self._receiver.motion(axis, sample)

    def alive(self, axis: str, time: float) -> None:
        """Take a heartbeat of a drive."""
        self._judged(f"a heartbeat of the {axis} axis", self._take_heartbeat, axis, self.clock.now())

    def _take_heartbeat(self, axis: str, now: float) -> None:
        self.supervisor.alive(axis, now)
        if self._receiver is not None:
            self._receiver.alive(axis, now)

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """Take an error report of a drive."""
        self._judged(f"an error of the {axis} axis", self.supervisor.emergency, axis, code, meaning, self.clock.now())

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Take the report that another master commands a drive."""
        self._judged(f"a command to the {axis} axis", self.supervisor.foreign, axis, what, self.clock.now())

    def broken(self, axis: str, why: str, time: float) -> None:
        """Take the report that a drive can no longer be reached."""
        self._judged(f"the loss of the {axis} axis", self.supervisor.broken, axis, why, self.clock.now())


def tare_readings(rate: float) -> int:
    """Return how many readings a tare takes at ``rate`` [Hz]: those of a second, 20 to 200."""
    return min(max(round(rate), 20), 200)


def mounted_spine(settings: RigSettings, clock: Clock) -> Spine:
    """Make the spine of a rig from the drivers that its file names, without connecting to it."""
    shared = dict[Any, Any]()

    def made(role: str) -> Any:
        return mounted(Mounting(role=role, rig=settings, clock=clock, shared=shared))

    return Spine(settings, clock, [made(role) for role in settings.axes], made("sensor"))
