"""Six-axis force sensor that streams frames over a serial port: reader thread, order of readings, tare."""

from __future__ import annotations

import contextlib
import threading
from typing import Any, Protocol

from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.driver_registry import Mounting
from cutenv.rig.devices.drivers import ForceListener
from cutenv.rig.devices.reading_stream import ReadingMean, ReadingStream, Zero
from cutenv.rig.devices.sample_clock import SEQUENCES
from cutenv.rig.devices.samples import ForceSample
from cutenv.rig.devices.serial.frame_reader import FrameError, FrameFormat, FrameReader, SensorFrame
from cutenv.rig.devices.serial.ports import open_port, write_line
from cutenv.rig.errors import RigError

_FIRST_READING = 2.0  # [s] within which the first one must arrive
_READ = 0.1  # [s] after which the reader checks whether it has to end
_WRITE = 0.2  # [s] for the port to take a request
_STAMPS = 2**32  # times of a sensor are counted modulo this [us]
_NO_ZERO: Zero = (0.0,) * 6


class FramedProtocol(Protocol):
    """Protocol of one maker's sensor: its frames, and how their stream begins and ends."""

    name: str
    """Name of the sensor, for messages."""
    baud: int
    """Baud rate."""
    form: FrameFormat
    """Format of the frames."""
    newtons: float
    """Force of a count [N]."""
    newton_metres: float
    """Torque of a count [N m]."""

    def begin(self, line: SensorLine, rate: float) -> dict[str, float | str]:
        """Identify the sensor and start its stream at ``rate`` [Hz]; return what it says about itself.

        Raises RigError, with the cure, if it does not answer.
        """
        ...

    def end(self, line: SensorLine) -> None:
        """Stop the stream, where the sensor can."""
        ...

    def meaning(self, status: int) -> str:
        """Return the text of a status."""
        ...


class SensorLine:
    """Open port of a sensor, for requests and their answers before the stream.

    Parameters
    ----------
    port : str
        Device, such as ``/dev/serial/by-id/usb-...``.
    baud : int
        Baud rate.
    clock : Clock
        Clock of the rig.
    """

    def __init__(self, port: str, baud: int, clock: Clock) -> None:
        self.port, self._clock = port, clock
        self._line: Any = open_port(port, baud, read_limit=_READ)
        with contextlib.suppress(
            Exception
        ):  # adapters of FTDI keep bytes for 16 ms otherwise; others have no such mode
            self._line.set_low_latency_mode(True)

    def send(self, data: bytes) -> None:
        """Send a request; raises RigError if the port does not take it."""
        try:
            write_line(self._line, data, _WRITE)
        except OSError as error:
            raise RigError(f"the sensor at {self.port} cannot be reached: {error}") from None

    def more(self) -> bytes:
        """Wait for bytes for a tenth of a second, and return those that came."""
        try:
            return bytes(self._line.read(max(self._line.in_waiting, 1)))
        except Exception as error:  # pyserial and the system raise many kinds
            raise RigError(f"the sensor at {self.port} cannot be read any more: {error}") from None

    def answer(self, wanted: bytes, limit: float, beyond: int = 0) -> bytes | None:
        """Return the answer that begins with ``wanted``, with ``beyond`` bytes after that, or None after ``limit`` [s].

        Whatever comes before it is passed over.
        """
        ends, heard = self._clock.now() + limit, b""
        while self._clock.now() < ends:
            heard += self.more()
            place = heard.find(wanted)
            if place >= 0 and len(heard) >= place + len(wanted) + beyond:
                return heard[place : place + len(wanted) + beyond]
        return None

    def quiet(self, limit: float) -> bool:
        """Return whether nothing came for a tenth of a second, within ``limit`` [s]; what came is passed over."""
        ends = self._clock.now() + limit
        while self._clock.now() < ends:
            if not self.more():
                return True
        return False

    def close(self) -> None:
        """Close the port; never raises."""
        with contextlib.suppress(Exception):  # the device is gone
            self._line.close()


class FramedSensor:
    """Force sensor that streams frames, as a :class:`cutenv.rig.devices.drivers.ForceDriver`.

    Six components; counts are the sensor's. A sensor that falls silent is not started again: close, open and tare it.

    Parameters
    ----------
    mounting : Mounting
        Place on the rig; its options have the ``port``.
    protocol : FramedProtocol
        The maker's protocol.
    rate_error : float
        Greatest relative error of the rate.
    """

    def __init__(self, mounting: Mounting, protocol: FramedProtocol, *, rate_error: float) -> None:
        self.rate: float = mounting.settings.rate
        self.axes, self.rate_error = "xyz", rate_error
        self._port: str = mounting.options.port
        self._clock, self._protocol = mounting.clock, protocol
        self._line: SensorLine | None = None
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._changed = threading.Condition()
        self._taring = threading.Lock()
        self._mean: ReadingMean | None = None
        self._told: dict[str, float | str] = {}
        self._begin_again()

    def open(self, listener: ForceListener) -> None:
        """Connect, start the stream, and wait for the first reading.

        Raises
        ------
        RigError
            If it is open already, the port is missing, no such sensor answers, or no reading comes.
        """
        if self._line is not None:
            raise RigError(f"The {self._protocol.name} is open already: close it first.")
        self._begin_again()
        line = self._line = SensorLine(self._port, self._protocol.baud, self._clock)
        try:
            self._told = self._protocol.begin(line, self.rate)
            self._closing = threading.Event()
            self._thread = threading.Thread(
                target=self._receive, args=(line, self._closing, listener), name="force sensor", daemon=True
            )
            self._thread.start()
            self._clock.wait_for(lambda: self._received > 0 or bool(self._broken), _FIRST_READING, self._changed)
            if not self._received:
                why = self._broken or f"no reading came within {_FIRST_READING:g} s"
                raise RigError(f"The {self._protocol.name} at {self._port} does not read: {why}.")
        except BaseException:
            self.close()
            raise

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of the next ``samples`` readings as zero, of torques too, while nothing touches the blade.

        Returns
        -------
        tuple of 3 float
            Force subtracted from now on [N], relative to the sensor's own zero.

        Raises
        ------
        RigError
            If it is not open, or readings stop, report an error, or vary by more than 0.1 N; the zero is unchanged.
        """
        if self._line is None:
            raise RigError(f"The {self._protocol.name} is not open.")
        mean = ReadingMean(samples)
        with self._taring:
            self._mean = mean
            try:
                self._zero = mean.awaited(self.rate, self._protocol.newtons, self._protocol.meaning)
            finally:
                self._mean = None
        x, y, z = (count * self._protocol.newtons for count in self._zero[:3])
        return x, y, z

    def about(self) -> dict[str, float | str]:
        """Return what the sensor says about itself, and the counts of readings and faults."""
        told: dict[str, float | str] = {"port": self._port, "rate_Hz": self.rate, **self._told}
        told |= {"received_readings": self._received, "lost_readings": self._lost}
        return told | {"damaged_frames": self._damaged}

    def close(self) -> None:
        """Stop the stream and close the port; never raises, and may be called twice."""
        line, thread, self._line, self._thread = self._line, self._thread, None, None
        if line is None:
            return
        self._closing.set()
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=1.0)
        with contextlib.suppress(RigError):  # the cable is out: nothing streams then
            self._protocol.end(line)
        line.close()

    def _begin_again(self) -> None:
        self._zero = _NO_ZERO  # [counts]
        self._received = self._lost = self._damaged = 0
        self._number, self._stamp = 0, -1
        self._broken = ""
        self._stream = ReadingStream(self.rate)

    def _receive(self, line: SensorLine, closing: threading.Event, listener: ForceListener) -> None:
        reader = FrameReader(self._protocol.form)
        while not closing.is_set():
            try:
                read = line.more()
            except RigError as error:
                if not closing.is_set():
                    listener.garbled(str(error), self._clock.now())
                    self._note(str(error))
                return
            now = self._clock.now()
            for found in reader.take(read):
                if isinstance(found, FrameError):
                    self._damaged += 1
                    listener.garbled(str(found), now)
                else:
                    self._pass_on(*found, now, listener)

    def _pass_on(self, frame: SensorFrame, missed: int, now: float, listener: ForceListener) -> None:
        lost = self._lost_before(frame, missed, now)
        if lost < 0:
            listener.garbled(f"a reading at {frame.stamp} us of the sensor's time does not follow the last", now)
            return
        self._received += 1
        self._lost += lost
        counts, zero, scale, turning = frame.counts, self._zero, self._protocol.newtons, self._protocol.newton_metres
        force = (counts[0] - zero[0]) * scale, (counts[1] - zero[1]) * scale, (counts[2] - zero[2]) * scale
        torque = (counts[3] - zero[3]) * turning, (counts[4] - zero[4]) * turning, (counts[5] - zero[5]) * turning
        sample = ForceSample(now, force, counts, frame.status, self._number, lost, torque)
        if (mean := self._mean) is not None:
            mean.add(sample)
        listener.force(sample)
        if self._received == 1:
            self._note()

    def _lost_before(self, frame: SensorFrame, missed: int, now: float) -> int:
        """Return how many readings were lost before this one, and number it; less than 0: it does not follow."""
        steps = 1 + missed if self._received else 1
        if frame.stamp >= 0 and self._stamp >= 0:
            steps = round((frame.stamp - self._stamp) % _STAMPS * 1e-6 * self.rate)
        self._stamp = frame.stamp
        self._number = (self._number + steps) % SEQUENCES
        return self._stream.place(self._number, now)

    def _note(self, broken: str = "") -> None:
        with self._changed:
            self._broken = broken
            self._changed.notify_all()
