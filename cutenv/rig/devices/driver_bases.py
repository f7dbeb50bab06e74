"""Bases of drivers: an axis with latch, a sensor with tare."""

from __future__ import annotations

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from cutenv._base.validation import in_range
from cutenv.rig.config.settings import Axis
from cutenv.rig.devices.loop import READ_EVERY, Clock, Repeating
from cutenv.rig.devices.protocols import DriveState, Event, ForceListener, ForceSample, Latch, MotionListener
from cutenv.rig.devices.reading_stream import ReadingMean, ReadingStream, Zero
from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

STATE_LIMIT = 1.0  # time for a device to change its state [s]


class AxisDriver(ABC):
    """Axis that reports its state; a :class:`~cutenv.rig.devices.protocols.MotionDriver`.

    After :meth:`quick_stop` nothing that could give the device power or speed is sent until the latch is reset, because
    on some a command would start the blade again. ``clock`` dates reports without a time of their own.
    """

    device: ClassVar[str]  # word for the device in messages
    silence: ClassVar[str]  # words in the log for what :meth:`withhold_heartbeat` does
    report_limit: ClassVar[float]  # time for a report to arrive [s]

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
        """Find and identify the device, verify its set-up, await reports."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Leave bus or port; never raises."""

    @abstractmethod
    def _rest(self) -> None:
        """Bring the axis to rest without power, before leaving."""

    @abstractmethod
    def _switch_on(self) -> None:
        """Switch the power on, at rest."""

    @abstractmethod
    def _send_speed(self, target: float) -> None:
        """Send a checked speed of :meth:`_target` by :meth:`_energise`."""

    @abstractmethod
    def _send_stop(self, *, for_good: bool = False) -> None:
        """Send a quick stop, from any thread, without waiting."""

    def _fall_silent(self) -> None:
        """End what else than a sign of life keeps the device's own watchdog from stopping it; by default nothing."""
        return

    @abstractmethod
    def _condition(self) -> str:
        """Describe the state of the device."""

    # Life cycle

    def open(self, listener: MotionListener) -> None:
        """Connect, check who answers, write and verify the set-up."""
        if self._listener is not None:
            raise RigError(f"{self.name}: it is open already; close it first.")
        self._listener = listener
        self._may_move, self._error, self._lost = False, "", None
        self.latch.restore(self.name)
        try:
            self._connect()
        except BaseException:
            self._leave()
            raise

    def close(self) -> None:
        """Leave the axis at rest unpowered, free the port; never raises, may be repeated."""
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
        """Switch the power on, at rest. Clears no fault: see :meth:`clear`."""
        self._fresh()
        self._switch_on()
        with self._changed:
            self._may_move = self._state is DriveState.ENABLED and not self.latch.closed
        if not self._may_move:
            raise RigError(f"{self.name}: stopped while it was powered on{self._error}; clear it first.")

    def command(self, speed: float) -> None:
        """Send a target speed [m/s or rad/s], without waiting."""
        target = self._target(speed)
        if not self._may_move or self._state is not DriveState.ENABLED:
            raise RigError(f"{self.name}: {self._lost or f'not enabled, {self._condition()}'}.")
        self._send_speed(target)

    def _target(self, speed: float) -> float:
        """Return a speed [m/s] once it is checked."""
        top = self._settings.speed
        return in_range(f"{self.name} speed", speed, -top, top, "m/s", "The top speed is in the rig's file.")

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Send a quick stop at once, from any thread and state.

        It does not wait. With ``for_good`` no command ends the stop before rest, and the device then has no power.
        Raise RigError if bus or port does not take it, or the axis was never opened.
        """
        self.latch.happens(Event.STOP)
        self._may_move = False
        self._send_stop(for_good=for_good)

    def withhold_heartbeat(self, why: str) -> None:
        """End this computer's sign of life until a reset: the device's own watchdog then stops it."""
        self.latch.withhold(self.name)
        self._may_move = False
        _log.warning("%s: %s: %s", self.name, why, self.silence)
        self._fall_silent()

    def _energise(self, send: Callable[[], None]) -> None:
        """Send what may start the blade, but never after another thread's quick stop."""
        if self.latch.closed:
            raise RigError(f"{self.name}: stopped; clear it first.")
        send()
        if self.latch.closed:  # stopped between the two lines above: the quick stop has to be the last
            self._send_stop()
            raise RigError(f"{self.name}: stopped; clear it first.")

    # Reports

    def lost(self, why: str, time: float) -> None:
        """Take the report of a device lost since ``time`` [s]; only the first counts."""
        with self._changed:
            first, self._lost = self._lost is None, self._lost or why
            self._may_move = False
            self._changed.notify_all()
        if first and self._listener is not None:
            self._listener.broken(self.name, why, time)

    # Waiting

    def _wait(self, come: Callable[[], bool], limit: float) -> bool:
        """Wait until ``come()``; return whether it did; RigError if lost."""
        self._clock.wait_for(lambda: come() or self._lost is not None, limit, self._changed)
        if self._lost is not None:
            raise RigError(f"{self.name}: {self._lost}.")
        return come()

    def _await(self, come: Callable[[], bool], what: str, limit: float = STATE_LIMIT) -> None:
        if not self._wait(come, limit):
            raise RigError(f"{self.name}: the {self.device} does not {what} within {limit:.1f} s{self._late()}")

    def _late(self) -> str:
        """Return the end of a message about a late device."""
        return "."

    def _await_rest(self, rests: Callable[[], bool]) -> None:
        settings = self._settings
        stopping = settings.speed / min(settings.quick_stop, settings.acceleration) + self.report_limit
        self._await(rests, "come to rest", stopping)

    def _fresh(self) -> None:
        """Wait for a new report, which reflects the last command."""
        self._check_open()
        seen = self._reports
        self._await(lambda: self._reports > seen + 1, "report its state", self.report_limit)

    def _check_open(self) -> None:
        if self._listener is None:
            raise RigError(f"{self.name}: not open.")


FIRST_READING = 2.0  # time within which the first reading must arrive [s]

Counts = tuple[int, int, int, int, int, int]  # counts of forces and torques of one reading


class StreamedSensor(ABC):
    """Force sensor that streams readings, as a :class:`cutenv.rig.devices.protocols.ForceDriver`.

    Times of the readings are those of their arrival. A sensor that falls silent is not started again, because it may
    have been switched off and on, which loses its zero: close, open and tare it. ``rate`` is that of the readings [Hz],
    ``rate_error`` its greatest relative error, ``axes`` are the forces that it measures.
    """

    name: str  # name of the sensor, for messages

    def __init__(self, clock: Clock, rate: float, *, rate_error: float, axes: str = "xyz") -> None:
        self.rate, self.rate_error, self.axes = rate, rate_error, axes
        self._clock = clock
        self._listener: ForceListener | None = None
        self._receiving: Repeating | None = None
        self._changed = threading.Condition()
        self._taring = threading.Lock()
        self._mean: ReadingMean | None = None  # while a tare is taken
        self._begin_again()

    def _begin_again(self) -> None:
        """Forget readings and zero."""
        self._zero: Zero = (0.0,) * 6  # [counts]
        self._received = self._lost = 0
        self._broken = ""
        self._stream = ReadingStream(self.rate)

    # Parts that differ from sensor to sensor

    @abstractmethod
    def _connect(self) -> None:
        """Find the sensor, start its stream, await a reading."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Stop the stream and leave the port; never raises."""

    @property
    @abstractmethod
    def _scales(self) -> Zero:
        """Force [N] and torque [N m] of one count, by component."""

    @abstractmethod
    def _meaning(self, status: int) -> str:
        """Return the text of a status."""

    # Life cycle

    def open(self, listener: ForceListener) -> None:
        """Connect, start the stream, and wait for the first reading."""
        if self._listener is not None:
            raise RigError(f"The {self.name} is open already: close it first.")
        self._begin_again()
        self._listener = listener
        try:
            self._connect()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop the stream and free the port; never raises, may be repeated."""
        if self._listener is not None:
            self._listener = None
            self._disconnect()

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of the next ``samples`` readings as zero, torques too.

        Meanwhile nothing may touch the blade. Return the force subtracted from now on [N], relative to the sensor's own
        zero: two tares show its drift. Raise RigError if it is not open, or readings stop, report an error, or vary by
        more than 0.1 N; the zero is unchanged.
        """
        mean = ReadingMean(samples)
        if self._listener is None:
            raise RigError(f"The {self.name} is not open.")
        with self._taring:
            self._mean = mean
            try:
                self._zero = mean.awaited(self.rate, max(self._scales[:3]), self._meaning)
            finally:
                self._mean = None
        x, y, z, *_ = self._loads(self._zero)
        return x, y, z

    def _loads(self, counts: Zero) -> Zero:
        """Return untared forces [N] and torques [N m] of counts."""
        fx, fy, fz, tx, ty, tz = (count * scale for count, scale in zip(counts, self._scales, strict=True))
        return fx, fy, fz, tx, ty, tz

    # Readings

    def _start(self, receive: Callable[[], None]) -> None:
        """Have the loop call ``receive``, which passes on what has arrived, and never waits."""
        self._receiving = self._clock.every(READ_EVERY, lambda now: receive(), self.name)

    def _stop(self) -> None:
        """End the repeated call of ``receive``."""
        receiving, self._receiving = self._receiving, None
        if receiving is not None:
            receiving.stop()

    def _comes(self, limit: float) -> bool:
        """Wait for a reading or a failure; return whether a reading came."""
        self._clock.wait_for(lambda: self._received > 0 or bool(self._broken), limit, self._changed)
        return self._received > 0

    def _take(self, number: int, now: float, counts: Counts, status: int, loads: Zero | None = None) -> bool:
        """Pass on a reading in order; return whether it was.

        ``loads`` are its forces and torques less the zero, of a sensor that converts many at once.
        """
        lost, listener = self._stream.place(number, now), self._listener
        if listener is None:
            return False
        if lost < 0:
            self._misplaced(number, now, late=lost == ReadingStream.OLD)
            return False
        self._received += 1
        self._lost += lost
        if loads is None:
            (a, b, c, d, e, f), zero = counts, self._zero
            loads = self._loads((a - zero[0], b - zero[1], c - zero[2], d - zero[3], e - zero[4], f - zero[5]))
        sample = ForceSample(now, loads[:3], counts, status, number, lost, loads[3:])
        if (mean := self._mean) is not None:
            mean.add(sample)
        listener.force(sample)
        if self._received == 1:
            self._note()
        return True

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        """Report a reading out of order; ``late`` if old or repeated."""
        self.garbled(f"reading {number} does not follow {self._stream.last}", now)

    def garbled(self, why: str, time: float) -> None:
        """Pass on the report of an invalid reading."""
        if (listener := self._listener) is not None:
            listener.garbled(why, time)

    def _note(self, broken: str = "") -> None:
        """Wake waiting threads after a reading or a ``broken`` stream."""
        with self._changed:
            self._broken = broken
            self._changed.notify_all()
