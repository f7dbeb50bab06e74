"""Base of the axis drivers: opening and closing in order, the latch around every frame that could move, and waiting."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from cutenv._base.validation import in_range
from cutenv.rig.config.axes import Axis
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.drivers import MotionListener
from cutenv.rig.devices.latch import Event, Latch
from cutenv.rig.devices.samples import DriveState
from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

STATE_LIMIT = 1.0
"""Time for a device to change its state [s]."""


class AxisDriver(ABC):
    """Axis on a device that reports its state by itself; a :class:`~cutenv.rig.devices.drivers.MotionDriver`.

    After :meth:`quick_stop` nothing that could give the device power or speed is sent until the latch is reset, because
    on some a command would start the blade again.

    Parameters
    ----------
    name : str
        Name of the axis.
    settings : Axis
        Settings of the axis.
    clock : Clock
        Clock that dates reports without a time of their own.
    """

    device: ClassVar[str]
    """Word for the device in messages."""
    silence: ClassVar[str]
    """Words in the log for what :meth:`withhold_heartbeat` does."""
    report_limit: ClassVar[float]
    """Time for a report to arrive [s]."""

    def __init__(self, name: str, settings: Axis, clock: Clock) -> None:
        self.name = name
        self.latch = Latch()  # until a supervisor replaces it by the shared one
        self._settings, self._clock = settings, clock
        self._listener: MotionListener | None = None
        self._changed = threading.Condition()  # guards what is below; held for moments only
        self._state = DriveState.NOT_READY
        self._reports = 0
        self._may_move = False
        self._error = ""
        self._lost: str | None = None

    # Parts that differ from device to device

    @abstractmethod
    def _connect(self) -> None:
        """Find the device, check who answers, write and verify the set-up, and wait for its reports."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Leave bus or port; never raises."""

    @abstractmethod
    def _rest(self) -> None:
        """Bring the axis to rest without power, as the last act before leaving."""

    @abstractmethod
    def _switch_on(self) -> None:
        """Switch the power on, at rest."""

    @abstractmethod
    def _send_speed(self, target: float) -> None:
        """Send a checked speed, in the unit of :meth:`_target`, by :meth:`_energise`."""

    @abstractmethod
    def _send_stop(self, *, for_good: bool = False) -> None:
        """Send a quick stop, from any thread, without waiting."""

    @abstractmethod
    def _fall_silent(self) -> None:
        """End what keeps the device's own watchdog from stopping it."""

    @abstractmethod
    def _condition(self) -> str:
        """Describe the state of the device."""

    # Life cycle

    def open(self, listener: MotionListener) -> None:
        """Connect, check who answers, write and verify the set-up; samples arrive from now on, nothing moves.

        Raises
        ------
        RigError
            If it is open already, bus or port is missing or taken, no device or a wrong one answers, or its set-up is
            not that of the rig's file.
        """
        if self._listener is not None:
            raise RigError(f"{self.name}: it is open already; close it first.")
        self._listener = listener
        self._may_move, self._error, self._lost = False, "", None
        try:
            self._connect()
        except BaseException:
            self._leave()
            raise

    def close(self) -> None:
        """Leave the axis at rest without power, and leave bus or port; never raises, and may be called twice."""
        if self._listener is None:
            return
        try:
            self._rest()
        except Exception as error:  # a lost device or any other error: leave it anyway
            _log.warning("%s: not closed in order: %s", self.name, error, exc_info=not isinstance(error, RigError))
        finally:
            self._leave()

    def _leave(self) -> None:
        self._may_move = False
        self._disconnect()
        self._listener = None

    # Commands

    def enable(self) -> None:
        """Switch the power on, at rest. Clears no fault: see :meth:`clear`.

        Raises
        ------
        RigError
            If it was stopped, is in fault, does not know where the blade is, or does not power on in time.
        """
        self._fresh()
        self._switch_on()
        with self._changed:
            self._may_move = self._state is DriveState.ENABLED and not self.latch.closed
        if not self._may_move:
            raise RigError(f"{self.name}: stopped while it was powered on{self._error}; clear it first.")

    def command(self, speed: float) -> None:
        """Send a target speed [m/s or rad/s], without waiting for an answer.

        Raises
        ------
        TypeError, ValueError
            If the speed is not a number, or beyond the axis's top speed.
        RigError
            If the axis is not enabled, was stopped, or bus or line is broken.
        """
        target = self._target(speed)
        if not self._may_move or self._state is not DriveState.ENABLED:
            raise RigError(f"{self.name}: {self._lost or f'not enabled, {self._condition()}'}.")
        self._send_speed(target)

    def _target(self, speed: float) -> float:
        """Return a speed [m/s] once it is checked."""
        top = self._settings.speed
        return in_range(f"{self.name} speed", speed, -top, top, "m/s", "The top speed is in the rig's file.")

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Send a quick stop: at once, from any thread, without waiting, in any state.

        With ``for_good`` no command ends the stop before rest, and the device then has no power.

        Raises
        ------
        RigError
            If bus or port does not take it, or the axis was never opened.
        """
        self.latch.happens(Event.STOP)
        self._may_move = False
        self._send_stop(for_good=for_good)

    def withhold_heartbeat(self, why: str) -> None:
        """End this computer's sign of life until :meth:`clear`: the device's own watchdog then stops it."""
        self.latch.happens(Event.STOP)
        self._may_move = False
        _log.warning("%s: %s: %s", self.name, why, self.silence)
        self._fall_silent()

    def _energise(self, send: Callable[[], None]) -> None:
        """Send what may start the blade, but never after a quick stop from another thread."""
        if self.latch.closed:
            raise RigError(f"{self.name}: stopped; clear it first.")
        send()
        if self.latch.closed:  # stopped between the two lines above: the quick stop has to be the last
            self._send_stop()
            raise RigError(f"{self.name}: stopped; clear it first.")

    # Reports

    def lost(self, why: str, time: float) -> None:
        """Take the report that the device cannot be reached since ``time`` [s]; pass on only the first."""
        with self._changed:
            first, self._lost = self._lost is None, self._lost or why
            self._may_move = False
            self._changed.notify_all()
        if first and self._listener is not None:
            self._listener.broken(self.name, why, time)

    # Waiting

    def _wait(self, come: Callable[[], bool], limit: float) -> bool:
        """Wait until ``come()`` is true and return whether it is; raise RigError if the device cannot be reached."""
        self._clock.wait_for(lambda: come() or self._lost is not None, limit, self._changed)
        if self._lost is not None:
            raise RigError(f"{self.name}: {self._lost}.")
        return come()

    def _await(self, come: Callable[[], bool], what: str, limit: float = STATE_LIMIT) -> None:
        if not self._wait(come, limit):
            raise RigError(f"{self.name}: the {self.device} does not {what} within {limit:.1f} s{self._late()}")

    def _late(self) -> str:
        """Return the end of the message about a device that does not do in time what it was asked to."""
        return "."

    def _await_rest(self, rests: Callable[[], bool]) -> None:
        settings = self._settings
        stopping = settings.speed / min(settings.quick_stop, settings.acceleration) + self.report_limit
        self._await(rests, "come to rest", stopping)

    def _fresh(self) -> None:
        """Wait for a report younger than now, because an older one does not reflect the last command."""
        self._check_open()
        seen = self._reports
        self._await(lambda: self._reports > seen + 1, "report its state", self.report_limit)

    def _check_open(self) -> None:
        if self._listener is None:
            raise RigError(f"{self.name}: not open.")
