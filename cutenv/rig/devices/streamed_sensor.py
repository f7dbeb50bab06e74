"""Base of the force sensors that stream: opening and closing in order, the place of each reading, and tare."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.drivers import ForceListener
from cutenv.rig.devices.reading_stream import ReadingMean, ReadingStream, Zero
from cutenv.rig.devices.samples import ForceSample
from cutenv.rig.errors import RigError

FIRST_READING = 2.0
"""Time within which the first reading must arrive [s]."""

Counts = tuple[int, int, int, int, int, int]
"""Counts of forces and torques of one reading."""


class StreamedSensor(ABC):
    """Force sensor that streams readings, as a :class:`cutenv.rig.devices.drivers.ForceDriver`.

    Times of the readings are those of their arrival. A sensor that falls silent is not started again, because it may
    have been switched off and on, which loses its zero: close, open and tare it.

    Parameters
    ----------
    clock : Clock
        Clock of the rig.
    rate : float
        Rate of the readings [Hz].
    rate_error : float
        Greatest relative error of that rate.
    axes : str
        Axes of force that it measures.
    """

    name: str
    """Name of the sensor, for messages."""
    join_limit: ClassVar[float] = 1.0
    """Time for the receiving thread to end [s]."""

    def __init__(self, clock: Clock, rate: float, *, rate_error: float, axes: str = "xyz") -> None:
        self.rate, self.rate_error, self.axes = rate, rate_error, axes
        self._clock = clock
        self._listener: ForceListener | None = None
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
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
        """Find the sensor, start its stream, and wait for the first reading."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Stop the stream and leave the port; never raises."""

    @property
    @abstractmethod
    def _scales(self) -> Zero:
        """Force [N] and torque [N m] of one count of each component."""

    @abstractmethod
    def _meaning(self, status: int) -> str:
        """Return the text of a status."""

    # Life cycle

    def open(self, listener: ForceListener) -> None:
        """Connect, start the stream, and wait for the first reading.

        Raises
        ------
        RigError
            If it is open already, no such sensor answers, or no reading comes in time.
        """
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
        """Stop the stream and leave the port; never raises, and may be called twice."""
        if self._listener is not None:
            self._listener = None
            self._disconnect()

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of the next ``samples`` readings as zero, of torques too, while nothing touches the blade.

        Returns
        -------
        tuple of 3 float
            Force subtracted from now on [N], relative to the sensor's own zero: two tares show its drift.

        Raises
        ------
        RigError
            If it is not open, or readings stop, report an error, or vary by more than 0.1 N; the zero is unchanged.
        """
        mean = ReadingMean(samples)
        if self._listener is None:
            raise RigError(f"The {self.name} is not open.")
        if self._thread is threading.current_thread():
            raise RigError("A tare waits for readings, and cannot be taken while one is being passed on.")
        with self._taring:
            self._mean = mean
            try:
                self._zero = mean.awaited(self.rate, max(self._scales[:3]), self._meaning)
            finally:
                self._mean = None
        x, y, z, *_ = self._loads(self._zero)
        return x, y, z

    def _loads(self, counts: Zero) -> Zero:
        """Return forces [N] and torques [N m] of counts, less no zero."""
        fx, fy, fz, tx, ty, tz = (count * scale for count, scale in zip(counts, self._scales, strict=True))
        return fx, fy, fz, tx, ty, tz

    # Readings

    def _start(self, receive: Callable[[threading.Event], None]) -> None:
        """Call ``receive`` in a thread of its own, with the event that ends it."""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=receive, args=(self._closing,), name="force sensor", daemon=True)
        self._thread.start()

    def _stop(self) -> None:
        """End that thread."""
        thread, self._thread = self._thread, None
        self._closing.set()
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=self.join_limit)

    def _comes(self, limit: float) -> bool:
        """Wait until a reading has come, or cannot come; return whether one has."""
        with self._changed:  # in the machine's time, which a sensor keeps whatever the rig's clock is
            self._changed.wait_for(lambda: self._received > 0 or bool(self._broken), limit)
        return self._received > 0

    def _take(self, number: int, now: float, counts: Counts, status: int, loads: Zero | None = None) -> bool:
        """Pass on a reading in order; return whether it was passed on.

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
        self._follows(number, now)
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

    def _follows(self, number: int, now: float) -> None:
        """Take note of a reading in order, before it is passed on; by default nothing."""
        return

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        """Report a reading that does not follow the last one; ``late``: the same or a later one has come before."""
        self.garbled(f"reading {number} does not follow {self._stream.last}", now)

    def garbled(self, why: str, time: float) -> None:
        """Pass on the news of something that is no valid reading."""
        if (listener := self._listener) is not None:
            listener.garbled(why, time)

    def _note(self, broken: str = "") -> None:
        """Wake those who wait: a reading has come, or the stream is ``broken``."""
        with self._changed:
            self._broken = broken
            self._changed.notify_all()
