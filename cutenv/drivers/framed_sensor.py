"""Six-axis force sensor on a serial port, with frames by header and CRC."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

from cutenv.rig.devices import driver_bases
from cutenv.rig.devices.driver_bases import StreamedSensor
from cutenv.rig.devices.driver_registry import Mounting
from cutenv.rig.devices.loop import Clock
from cutenv.rig.devices.reading_stream import SEQUENCES, Zero
from cutenv.rig.devices.serial.ports import open_port, write_line
from cutenv.rig.errors import RigError


def crc_table(polynomial: int) -> tuple[int, ...]:
    """Return the table of a 16-bit CRC, lowest bit first, by reversed polynomial."""
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (polynomial if byte & 1 else 0)
        table.append(byte)
    return tuple(table)


def crc16(data: bytes, table: tuple[int, ...]) -> int:
    """Return the CRC of a table, which begins with 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc


class FrameError(ValueError):
    """Error for bytes that are no sound frame. The message names the fault."""


class SensorFrame(NamedTuple):
    """Reading in a frame.

    Six counts, status (0: healthy), and the sensor's own time [us], -1 where it sends none.
    """

    counts: tuple[int, int, int, int, int, int]
    status: int
    stamp: int = -1


class FrameFormat(NamedTuple):
    """Format of frames.

    First bytes, size, and the function that parses a frame or raises :class:`FrameError`.
    """

    header: bytes
    size: int
    parse: Callable[[bytes], SensorFrame]


class FrameReader:
    """Reader that cuts a stream into frames.

    A CRC of 16 bits lets one of 65 536 random frames pass. After anything unsound a frame is therefore believed only if
    it begins where another sound one has ended; that other is left out, as lost.
    """

    def __init__(self, form: FrameFormat) -> None:
        self._form = form
        self._rest = b""
        self._in_step = False
        self._skipped = 0  # [bytes] since the last frame that was believed
        self._missed = 0

    def take(self, read: bytes) -> Iterator[tuple[SensorFrame, int] | FrameError]:
        """Yield frames with the number missed before, or faults.

        A fault is yielded once for a run of them. Before the first frame nothing is called a fault: the stream may be
        joined anywhere.
        """
        self._rest += read
        form = self._form
        while len(self._rest) >= form.size:
            try:
                frame = form.parse(self._rest[: form.size])
            except FrameError as error:
                if self._in_step:
                    yield error
                self._in_step = False
                self._skip()
                continue
            self._rest = self._rest[form.size :]
            if self._in_step:
                missed, self._missed = self._missed, 0
                yield frame, missed
            else:
                self._missed += 1 + round(self._skipped / form.size)
                self._in_step, self._skipped = True, 0

    def _skip(self) -> None:
        """Drop bytes up to the next possible frame."""
        place = self._rest.find(self._form.header, 1)
        if place < 0:
            place = len(self._rest) - len(self._form.header) + 1
        self._rest = self._rest[place:]
        self._skipped += place


_READ = 0.1  # [s] for which an answer is awaited at a time
_WRITE = 0.2  # [s] for the port to take a request
_STAMPS = 2**32  # times of a sensor are counted modulo this [us]


class FramedProtocol(Protocol):
    """Protocol of one maker's sensor.

    Its frames, and how their stream begins and ends.
    """

    name: str  # name of the sensor, for messages
    baud: int  # baud rate
    form: FrameFormat  # format of the frames
    newtons: float  # force of a count [N]
    newton_metres: float  # torque of a count [N m]

    def begin(self, line: SensorLine, rate: float) -> dict[str, float | str]:
        """Identify the sensor and start its stream at ``rate`` [Hz].

        Return what it says about itself.

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
    """Open port of a sensor, for requests before the stream. ``port`` is such as ``/dev/serial/by-id/usb-...``."""

    def __init__(self, port: str, baud: int, clock: Clock) -> None:
        self.port, self._clock = port, clock
        self._line: Any = open_port(port, baud, read_limit=_READ)
        with contextlib.suppress(
            Exception
        ):  # adapters of FTDI keep bytes for 16 ms otherwise; others have no such mode
            self._line.set_low_latency_mode(True)

    def send(self, data: bytes) -> None:
        """Send a request; raise RigError if the port refuses."""
        try:
            write_line(self._line, data, _WRITE)
        except OSError as error:
            raise RigError(f"the sensor at {self.port} cannot be reached: {error}") from None

    def more(self, least: int = 1) -> bytes:
        """Return what has arrived; wait a tenth of a second for ``least`` bytes."""
        try:
            return bytes(self._line.read(max(self._line.in_waiting, least)))
        except Exception as error:  # pyserial and the system raise many kinds
            raise RigError(f"the sensor at {self.port} cannot be read any more: {error}") from None

    def answer(self, wanted: bytes, limit: float, beyond: int = 0) -> bytes | None:
        """Return the answer beginning with ``wanted``, None after ``limit`` [s].

        It has ``beyond`` bytes after that. Whatever comes before it is passed over.
        """
        ends, heard = self._clock.now() + limit, b""
        while self._clock.now() < ends:
            heard += self.more()
            place = heard.find(wanted)
            if place >= 0 and len(heard) >= place + len(wanted) + beyond:
                return heard[place : place + len(wanted) + beyond]
        return None

    def quiet(self, limit: float) -> bool:
        """Discard input until 0.1 s of silence; return False after ``limit`` [s]."""
        ends = self._clock.now() + limit
        while self._clock.now() < ends:
            if not self.more():
                return True
        return False

    def close(self) -> None:
        """Close the port; never raises."""
        with contextlib.suppress(Exception):  # the device is gone
            self._line.close()


class FramedSensor(StreamedSensor):
    """Force sensor of six components that streams frames of counts.

    The options of ``mounting`` have the ``port``; ``rate_error`` is the greatest relative error of the rate.
    """

    def __init__(self, mounting: Mounting, protocol: FramedProtocol, *, rate_error: float) -> None:
        self.name = protocol.name
        self._port: str = mounting.options.port
        self._protocol = protocol
        self._line: SensorLine | None = None
        self._told: dict[str, float | str] = {}
        super().__init__(mounting.clock, mounting.settings.rate, rate_error=rate_error)

    def _connect(self) -> None:
        line = self._line = SensorLine(self._port, self._protocol.baud, self._clock)
        self._told = self._protocol.begin(line, self.rate)
        reader = FrameReader(self._protocol.form)
        self._start(lambda: self._receive(line, reader))
        if not self._comes(driver_bases.FIRST_READING):
            why = self._broken or f"no reading came within {driver_bases.FIRST_READING:g} s"
            raise RigError(f"The {self.name} at {self._port} does not read: {why}.")

    def about(self) -> dict[str, float | str]:
        """Return the sensor's own report, with counts of readings and faults."""
        told: dict[str, float | str] = {"port": self._port, "rate_Hz": self.rate, **self._told}
        told |= {"received_readings": self._received, "lost_readings": self._lost}
        return told | {"damaged_frames": self._damaged}

    def _disconnect(self) -> None:
        self._stop()
        line, self._line = self._line, None
        if line is None:
            return
        with contextlib.suppress(RigError):  # the cable is out: nothing streams then
            self._protocol.end(line)
        line.close()

    def _begin_again(self) -> None:
        super()._begin_again()
        self._damaged = 0
        self._number, self._stamp = 0, -1

    @property
    def _scales(self) -> Zero:
        return (self._protocol.newtons,) * 3 + (self._protocol.newton_metres,) * 3

    def _meaning(self, status: int) -> str:
        return self._protocol.meaning(status)

    def _receive(self, line: SensorLine, reader: FrameReader) -> None:
        """Pass on the frames that have arrived."""
        try:
            read = line.more(0)
        except RigError as error:
            self._stop()
            self.garbled(str(error), self._clock.now())
            self._note(str(error))
            return
        now = self._clock.now()
        for found in reader.take(read):
            if isinstance(found, FrameError):
                self._damaged += 1
                self.garbled(str(found), now)
            else:
                self._pass_on(*found, now)

    def _pass_on(self, frame: SensorFrame, missed: int, now: float) -> None:
        """Pass on a frame, numbered by sensor time or missed frames."""
        steps = 1 + missed if self._received else 1
        if frame.stamp >= 0 and self._stamp >= 0:
            steps = round((frame.stamp - self._stamp) % _STAMPS * 1e-6 * self.rate)
        self._stamp = frame.stamp
        self._number = (self._number + steps) % SEQUENCES
        self._take(self._number, now, frame.counts, frame.status)

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        self.garbled(f"a reading at {self._stamp} us of the sensor's time does not follow the last", now)
