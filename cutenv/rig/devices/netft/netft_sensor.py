"""Driver of a Net F/T: it streams readings over UDP in a thread, passes them on in order, and tares them."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import NamedTuple

from cutenv.rig.config.settings import SensorSettings
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.drivers import ForceListener
from cutenv.rig.devices.netft.packets import (
    PacketError,
    RdtCommand,
    SensorPacket,
    parse_packet,
    request_bytes,
    status_meaning,
)
from cutenv.rig.devices.netft.settings_page import PATH, Page, read_page
from cutenv.rig.devices.reading_stream import ReadingMean, ReadingStream, Zero
from cutenv.rig.devices.sample_clock import LEAK, SampleClock
from cutenv.rig.devices.samples import ForceSample
from cutenv.rig.errors import RigError

FIRST_READING = 2.0
"""Time within which the first reading must arrive [s]."""
_POLL = 0.1  # [s] after which the thread checks whether it has to end
_ASK_AGAIN = 0.5  # parts of a tare

Force = tuple[float, float, float]
_NO_ZERO: Zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Counters(NamedTuple):
    """Counts of packets since the sensor was opened.

    Attributes
    ----------
    received : int
        Readings that were passed on.
    lost : int
        Readings missing between them, including those that came too late.
    reordered : int
        Readings dropped because the same or a later one had arrived.
    garbled : int
        Packets of the sensor that were not records, or did not fit into the stream.
    foreign : int
        Packets from other addresses.
    """

    received: int = 0
    lost: int = 0
    reordered: int = 0
    garbled: int = 0
    foreign: int = 0


class NetftSensor:
    """A Net F/T or Ethernet Axia as a :class:`cutenv.rig.devices.drivers.ForceDriver`.

    Readings come from the thread "force sensor"; times are those of their arrival. A sensor that falls silent is not
    started again: it may have been switched off and on, which loses its zero. Close, open and tare it.

    Parameters
    ----------
    settings : Sensor
        Address of the sensor and other settings.
    clock : Clock
        Clock of the rig.

    Attributes
    ----------
    rate : float
        Rate of the readings [Hz]: from the sensor's page once it is open, before that from the settings.
    rate_error : float
        Greatest relative error of that rate.
    axes : str
        All of them.
    page : Page or None
        Configuration that the sensor reports, once it was opened.
    lateness : float
        Delay of the last reading beyond the least one [s]; see
        :class:`cutenv.rig.devices.sample_clock.SampleClock`.
    """

    def __init__(self, settings: SensorSettings, clock: Clock) -> None:
        self.rate = settings.rate
        self.axes, self.rate_error = "xyz", LEAK
        self.page: Page | None = None
        self.lateness = 0.0
        self._settings, self._clock = settings, clock
        self._socket: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._address = (settings.address, settings.port)
        self._closing = threading.Event()
        self._taring = threading.Lock()
        self._scale = self._torque_scale = 0.0  # [N], [N m] of a count
        self._zero = _NO_ZERO  # in counts
        self._mean: ReadingMean | None = None  # while a tare is taken
        self._received = self._lost = self._reordered = self._garbled = self._foreign = 0

    @property
    def counters(self) -> Counters:
        """Counts of packets so far."""
        return Counters(self._received, self._lost, self._reordered, self._garbled, self._foreign)

    def open(self, listener: ForceListener) -> None:
        """Read scales from the sensor's page, start streaming, and wait for the first reading.

        Raises
        ------
        RigError
            If it is open already, its page cannot be read, or no reading comes within ``FIRST_READING``.
        """
        if self._socket is not None:
            raise RigError("The force sensor is open already: close it first.")
        host, port = self._settings.address, self._settings.port
        self.page = read_page(self._settings.page or f"http://{host}{PATH}")
        self.rate = self.page.rate or self._settings.rate
        self._scale, self._torque_scale = self.page.newtons_per_count, self.page.newton_metres_per_count
        self._zero = _NO_ZERO
        self._received = self._lost = self._reordered = self._garbled = self._foreign = 0
        try:
            if self._begin(listener):
                return
        except OSError as error:
            self.close()
            raise RigError(
                f"The force sensor at {host}:{port} cannot be reached: {error}. Check sensor.address."
            ) from None
        except BaseException:
            self.close()
            raise
        counters = self.counters
        self.close()
        raise RigError(
            f"No reading came from the force sensor at {host}:{port} within {FIRST_READING:g} s ({counters.garbled}"
            f" packets were no readings, {counters.foreign} came from elsewhere), though its page answers. Check that"
            " RDT is enabled on its communications page, that sensor.port is right, that the firewall lets UDP in, and"
            " that no other program streams: the sensor serves one."
        )

    def tare(self, samples: int = 200) -> Force:
        """Take the mean of the next ``samples`` readings as zero, of torques too, while nothing touches the blade.

        Returns
        -------
        tuple of 3 float
            Force subtracted from now on [N], relative to the sensor's own zero: two tares show its drift.

        Raises
        ------
        RigError
            If the sensor is not open, or its readings stop, report an error, or vary by more than 0.1 N;
            the zero is then unchanged.
        """
        # Never use the sensor's own bias (0x42): it is not confirmed, affects every other program, is lost without
        # notice at the next restart, and hides the drift from the recorded counts.
        mean = self._mean_of(samples)
        self._zero = mean
        return self._newtons(mean)

    def about(self) -> dict[str, float | str]:
        """Return the data that the open sensor reports about itself, and the counts of packets."""
        told: dict[str, float | str] = {"address": "{}:{}".format(*self._address), "rate_Hz": self.rate}
        if self.page is not None:
            told["counts_per_N"] = 1.0 / self.page.newtons_per_count
            told["counts_per_Nm"] = 1.0 / self.page.newton_metres_per_count
        return told | {f"{name}_packets": count for name, count in self.counters._asdict().items()}

    def close(self) -> None:
        """Stop streaming; never raises, and may be called twice."""
        opened, thread, self._socket, self._thread = self._socket, self._thread, None, None
        if opened is None:
            return
        self._closing.set()
        with contextlib.suppress(OSError):  # the network is gone: nothing streams then
            opened.sendto(request_bytes(RdtCommand.STOP), self._address)
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=10 * _POLL)
        opened.close()

    def _begin(self, listener: ForceListener) -> bool:
        """Request a stream until the first reading arrives; return whether one did."""
        first, closing = threading.Event(), threading.Event()
        self._address, self._closing = (socket.gethostbyname(self._settings.address), self._settings.port), closing
        opened = self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.settimeout(_POLL)
        opened.bind((self._own_address(), 0))  # a port of our own; packets from elsewhere are dropped
        self._thread = threading.Thread(
            target=self._receive, args=(opened, closing, listener, first), name="force sensor", daemon=True
        )
        self._thread.start()
        for _ in range(round(FIRST_READING / _ASK_AGAIN)):
            opened.sendto(request_bytes(RdtCommand.START), self._address)
            if first.wait(_ASK_AGAIN):
                return True
        return False

    def _own_address(self) -> str:
        """Return this computer's address on the sensor's network; nothing listens on other networks."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(self._address)  # sends nothing
            return str(probe.getsockname()[0])

    def _newtons(self, counts: Zero) -> Force:
        return counts[0] * self._scale, counts[1] * self._scale, counts[2] * self._scale

    def _mean_of(self, samples: int) -> Zero:
        mean, thread = ReadingMean(samples), self._thread
        if thread is None:
            raise RigError("The force sensor is not open.")
        if thread is threading.current_thread():
            raise RigError("A tare waits for readings, and cannot be taken while one is being passed on.")
        with self._taring:
            self._mean = mean
            try:
                return mean.awaited(self.rate, self._scale, status_meaning)
            finally:
                self._mean = None

    def _receive(
        self, opened: socket.socket, closing: threading.Event, listener: ForceListener, first: threading.Event
    ) -> None:
        sensor, clock = self._address, self._clock
        stream, sample_clock = ReadingStream(self.rate), SampleClock(self.rate)
        while not closing.is_set():
            try:
                packet, sender = opened.recvfrom(2048)
            except TimeoutError:
                continue
            except (
                ConnectionError
            ):  # some systems report here that nobody listens there: the lack of readings is noticed
                continue
            except OSError as error:
                if not closing.is_set():
                    listener.garbled(f"the network broke down: {error}", clock.now())
                return
            now = clock.now()
            if sender != sensor:
                self._foreign += 1
                listener.garbled(f"a packet of {len(packet)} bytes from {sender[0]}:{sender[1]}", now)
                continue
            try:
                record = parse_packet(packet)
            except PacketError as error:
                self._garbled += 1
                listener.garbled(str(error), now)
                continue
            lost = stream.place(record.sequence, now)
            if lost == ReadingStream.OLD:
                self._reordered += 1
                continue
            if lost == ReadingStream.STRANGE:
                self._garbled += 1
                listener.garbled(f"sequence {record.sequence} does not follow {stream.last}: a restart?", now)
                continue
            self._received += 1
            self._lost += lost
            self.lateness = sample_clock.sensed(record.sequence, now)[1]
            if (mean := self._mean) is not None:
                mean.add(record)
            listener.force(self._sample(record, now, lost))
            first.set()

    def _sample(self, record: SensorPacket, now: float, lost: int) -> ForceSample:
        counts, zero, scale, turning = record.counts, self._zero, self._scale, self._torque_scale
        force = (counts[0] - zero[0]) * scale, (counts[1] - zero[1]) * scale, (counts[2] - zero[2]) * scale
        torque = (counts[3] - zero[3]) * turning, (counts[4] - zero[4]) * turning, (counts[5] - zero[5]) * turning
        return ForceSample(now, force, counts, record.status, record.sequence, lost, torque)
