"""Driver of a Net F/T: it streams readings over UDP in a thread, passes them on in order, and tares them."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import NamedTuple

from cutenv.rig.config.settings import SensorSettings
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.netft.packets import (
    PacketError,
    RdtCommand,
    parse_packet,
    request_bytes,
    status_meaning,
)
from cutenv.rig.devices.netft.settings_page import SETTINGS_PATH, Page, read_page
from cutenv.rig.devices.reading_stream import Zero
from cutenv.rig.devices.sample_clock import LEAK, SampleClock
from cutenv.rig.devices.streamed_sensor import FIRST_READING, StreamedSensor
from cutenv.rig.errors import RigError

_POLL = 0.1  # [s] after which the thread checks whether it has to end
_ASK_AGAIN = 0.5  # parts of a tare


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


class NetftSensor(StreamedSensor):
    """A Net F/T or Ethernet Axia.

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

    name, join_limit = "force sensor", 10 * _POLL

    def __init__(self, settings: SensorSettings, clock: Clock) -> None:
        self.page: Page | None = None
        self.lateness = 0.0
        self._settings = settings
        self._socket: socket.socket | None = None
        self._address = (settings.address, settings.port)
        super().__init__(clock, settings.rate, rate_error=LEAK)

    @property
    def counters(self) -> Counters:
        """Counts of packets so far."""
        return Counters(self._received, self._lost, self._reordered, self._garbled, self._foreign)

    def _connect(self) -> None:
        host, port = self._settings.address, self._settings.port
        self.page = read_page(self._settings.page or f"http://{host}{SETTINGS_PATH}")
        self.rate = self.page.rate or self._settings.rate
        self._begin_again()
        try:
            if self._streams():
                return
        except OSError as error:
            raise RigError(
                f"The force sensor at {host}:{port} cannot be reached: {error}. Check sensor.address."
            ) from None
        counters = self.counters
        raise RigError(
            f"No reading came from the force sensor at {host}:{port} within {FIRST_READING:g} s ({counters.garbled}"
            f" packets were no readings, {counters.foreign} came from elsewhere), though its page answers. Check that"
            " RDT is enabled on its communications page, that sensor.port is right, that the firewall lets UDP in, and"
            " that no other program streams: the sensor serves one."
        )

    def _begin_again(self) -> None:
        super()._begin_again()
        self._arrivals = SampleClock(self.rate)
        self._reordered = self._garbled = self._foreign = 0

    @property
    def _scales(self) -> Zero:
        # Never use the sensor's own bias (0x42): it is not confirmed, affects every other program, is lost without
        # notice at the next restart, and hides the drift from the recorded counts.
        assert self.page is not None
        return (self.page.newtons_per_count,) * 3 + (self.page.newton_metres_per_count,) * 3

    def _meaning(self, status: int) -> str:
        return status_meaning(status)

    def about(self) -> dict[str, float | str]:
        """Return the data that the open sensor reports about itself, and the counts of packets."""
        told: dict[str, float | str] = {"address": "{}:{}".format(*self._address), "rate_Hz": self.rate}
        if self.page is not None:
            told["counts_per_N"] = 1.0 / self.page.newtons_per_count
            told["counts_per_Nm"] = 1.0 / self.page.newton_metres_per_count
        return told | {f"{name}_packets": count for name, count in self.counters._asdict().items()}

    def _disconnect(self) -> None:
        self._stop()
        opened, self._socket = self._socket, None
        if opened is None:
            return
        with contextlib.suppress(OSError):  # the network is gone: nothing streams then
            opened.sendto(request_bytes(RdtCommand.STOP), self._address)
        opened.close()

    def _streams(self) -> bool:
        """Request a stream until the first reading arrives; return whether one did."""
        self._address = (socket.gethostbyname(self._settings.address), self._settings.port)
        opened = self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.settimeout(_POLL)
        opened.bind((self._own_address(), 0))  # a port of our own; packets from elsewhere are dropped
        self._start(lambda closing: self._receive(opened, closing))
        for _ in range(round(FIRST_READING / _ASK_AGAIN)):
            opened.sendto(request_bytes(RdtCommand.START), self._address)
            if self._comes(_ASK_AGAIN):
                return True
        return False

    def _own_address(self) -> str:
        """Return this computer's address on the sensor's network; nothing listens on other networks."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(self._address)  # sends nothing
            return str(probe.getsockname()[0])

    def _receive(self, opened: socket.socket, closing: threading.Event) -> None:
        sensor, clock = self._address, self._clock
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
                    self.garbled(f"the network broke down: {error}", clock.now())
                return
            now = clock.now()
            if sender != sensor:
                self._foreign += 1
                self.garbled(f"a packet of {len(packet)} bytes from {sender[0]}:{sender[1]}", now)
                continue
            try:
                record = parse_packet(packet)
            except PacketError as error:
                self._garbled += 1
                self.garbled(str(error), now)
                continue
            self._take(record.sequence, now, record.counts, record.status)

    def _follows(self, number: int, now: float) -> None:
        self.lateness = self._arrivals.sensed(number, now)[1]

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        if late:
            self._reordered += 1
            return
        self._garbled += 1
        self.garbled(f"sequence {number} does not follow {self._stream.last}: a restart?", now)
