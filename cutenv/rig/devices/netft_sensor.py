"""Driver of a Net F/T force sensor, and its packets (RDT).

It reads the sensor's settings page, streams readings over UDP, and tares them. RDT is a request of 8 bytes
and a record of 36, in network byte order.

Source: ATI Industrial Automation, Network Force/Torque Sensor System, document 9620-05-NET FT, "UDP interface using
RDT"; bits of the status: Ethernet Axia, document 9610-05, table 4.7.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from enum import IntEnum
from http.client import HTTPException
from typing import NamedTuple, NoReturn

from cutenv._base.validation import in_range
from cutenv.rig.config.settings import SensorSettings
from cutenv.rig.devices.driver_bases import FIRST_READING, StreamedSensor
from cutenv.rig.devices.loop import AT_ONCE, Attempt, Clock
from cutenv.rig.devices.reading_stream import LEAK, SEQUENCES, Zero
from cutenv.rig.errors import RigError

PORT = 49152  # UDP port of a sensor as delivered
PACKET_HEADER = 0x1234  # first two bytes of every request

_REQUEST = struct.Struct("!HHI")
_PACKET = struct.Struct("!IIIiiiiii")
PACKET_SIZE = _PACKET.size


class PacketError(ValueError):
    """Error for bytes that are not a packet of this protocol. The message gives the reason."""


class RdtCommand(IntEnum):
    """Command to a sensor."""

    STOP = 0x0000
    START = 0x0002
    RESET_LATCH = 0x0041
    BIAS = 0x0042


class SensorStatus(IntEnum):
    """Bits of the status of an Ethernet Axia.

    A healthy sensor sends 0.

    On the older Net Box the bits 31 and 16 have the same meaning, others differ: see its manual.
    """

    ERROR = 1 << 31
    OUT_OF_RANGE = 1 << 30
    CALIBRATION = 1 << 29
    SIMULATED = 1 << 28
    GAGE_OUT_OF_RANGE = 1 << 27
    MONITOR_CONDITION = 1 << 16
    BUSY = 1 << 3
    BROKEN_GAGE = 1 << 2
    SUPPLY = 1 << 1
    TEMPERATURE = 1 << 0


_MEANINGS = {
    SensorStatus.ERROR: "error",
    SensorStatus.OUT_OF_RANGE: "force or torque out of range",
    SensorStatus.CALIBRATION: "wrong checksum of the calibration",
    SensorStatus.SIMULATED: "simulated error",
    SensorStatus.GAGE_OUT_OF_RANGE: "strain gage out of range",
    SensorStatus.MONITOR_CONDITION: "monitor condition latched",
    SensorStatus.BUSY: "busy",
    SensorStatus.BROKEN_GAGE: "strain gage broken",
    SensorStatus.SUPPLY: "supply voltage out of range",
    SensorStatus.TEMPERATURE: "temperature out of range",
}


class SensorPacket(NamedTuple):
    """Reading as sent."""

    sequence: int  # number of the record within its stream, modulo 2**32; a gap is a lost record
    sampled: int  # counter of the sensor's own, faster sampling, modulo 2**32
    status: int  # status bits, see :class:`SensorStatus`; 0 is healthy
    counts: tuple[int, int, int, int, int, int]  # Fx, Fy, Fz, Tx, Ty, Tz in counts


def request_bytes(command: RdtCommand, count: int = 0) -> bytes:
    """Return a request for ``count`` records, 0 for an endless stream.

    Raise ValueError if the count does not fit into 32 bits.
    """
    in_range("count", count, 0, SEQUENCES - 1, "1", "0 streams until it is stopped.")
    return _REQUEST.pack(PACKET_HEADER, command, count)


def parse_request(packet: bytes) -> tuple[RdtCommand, int]:
    """Parse a request into command and count.

    Raise PacketError if it is not 8 bytes, does not begin with 0x1234, or contains an unknown command.
    """
    if len(packet) != _REQUEST.size:
        raise PacketError(f"a request has {_REQUEST.size} bytes, this has {len(packet)}")
    header, command, count = _REQUEST.unpack(packet)
    if header != PACKET_HEADER:
        raise PacketError(f"a request begins with 0x{PACKET_HEADER:04X}, this with 0x{header:04X}")
    try:
        return RdtCommand(command), count
    except ValueError:
        raise PacketError(f"command 0x{command:04X} is not known") from None


def packet_bytes(record: SensorPacket) -> bytes:
    """Return the 36 bytes of a record; raise PacketError if a number does not fit into its 32 bits."""
    try:
        return _PACKET.pack(record.sequence, record.sampled, record.status, *record.counts)
    except struct.error as error:
        raise PacketError(f"{record} does not fit into a record: {error}") from None


def parse_packet(packet: bytes) -> SensorPacket:
    """Parse a record; any 36 bytes are one; raise PacketError if it is not 36 bytes."""
    if len(packet) != PACKET_SIZE:
        raise PacketError(f"a record has {PACKET_SIZE} bytes, this has {len(packet)}")
    numbers = _PACKET.unpack(packet)
    return SensorPacket(numbers[0], numbers[1], numbers[2], numbers[3:])


def status_meaning(status: int) -> str:
    """Return a status in words; model-dependent bits by number."""
    if not status:
        return "healthy"
    known = [meaning for bit, meaning in _MEANINGS.items() if status & bit]
    others = [str(bit) for bit in range(31, -1, -1) if status >> bit & 1 and 1 << bit not in _MEANINGS]
    if others:
        known.append(f"bits {', '.join(others)} (see the sensor's manual)")
    return f"0x{status:08X}: {', '.join(known)}"


SETTINGS_PATH = "/netftapi2.xml"
MAX_PAGE_BYTES = 1 << 20  # greatest size of a page [byte]; a real one has about 4000

_COUNTS = (1e-3, 1e12)  # least and greatest number of counts in a unit
_RATES = (1.0, 1e5)  # [Hz]

_POUND = 4.4482216152605  # [N], exact by definition
_INCH = 0.0254  # [m]
_FOOT = 0.3048  # [m]
_KILOGRAM = 9.80665  # [N], by the standard gravity

# Models spell them differently ("Nm", "N-m"): see _plain.
NEWTONS_PER_UNIT = {
    "n": 1.0,
    "kn": 1000.0,
    "lbf": _POUND,
    "klbf": 1000.0 * _POUND,
    "kg": _KILOGRAM,
    "kgf": _KILOGRAM,
    "g": _KILOGRAM / 1000.0,
    "gf": _KILOGRAM / 1000.0,
}
"""Newtons in each unit of force."""
TORQUE_UNITS = {
    "nm": 1.0,
    "nmm": 0.001,
    "knm": 1000.0,
    "lbfin": _POUND * _INCH,
    "lbfft": _POUND * _FOOT,
    "kgcm": _KILOGRAM / 100.0,
    "kgfcm": _KILOGRAM / 100.0,
}
"""Newton metres in each unit of torque."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """Configuration that the sensor reports."""

    newtons_per_count: float  # [N]
    newton_metres_per_count: float  # [N m]
    rate: float | None  # rate of the records [Hz]; None if the page does not contain it


def read_page(address: str, timeout: float = 3.0) -> Page:
    """Fetch the page from ``address`` (http://...) and read it.

    Raise RigError if it does not arrive within ``timeout`` [s], is too large, or lacks a necessary value.
    """
    if not address.startswith("http://"):
        raise RigError(f"sensor.page {address!r} must begin with http://, as http://192.168.1.1{SETTINGS_PATH} does.")
    text: list[bytes] = []
    # Apart, because urllib limits only each single wait: a byte now and then would keep it waiting for ever.
    asking = Attempt(lambda: text.append(_fetch(address, timeout)), "sensor's page")
    if not asking.ends(timeout):
        raise RigError(f"The force sensor's page {address} did not come within {timeout:g} s. {_CURE}")
    if asking.error is not None:
        raise RigError(asking.error)
    return parse_page(text[0], address)


def parse_page(text: bytes, address: str = "netftapi2.xml") -> Page:
    """Parse the page's XML; ``address`` is named in errors.

    Raise RigError if it is not XML, declares entities, or lacks a scale or a known unit.
    """
    try:
        root = ET.fromstring(text, parser=ET.XMLParser(target=_Tree(address)))
    except (ET.ParseError, LookupError, ValueError) as error:  # a wrong encoding is one of the latter two
        raise RigError(f"The force sensor's page {address} is not XML: {error}. Is it the sensor's address?") from None
    found: dict[str, str] = {}
    for element in root.iter():
        found.setdefault(element.tag.rpartition("}")[2].lower(), (element.text or "").strip())
    wanted = {"cfgcpf": "counts per force", "cfgcpt": "counts per torque", "scfgfu": "unit of force",
              "scfgtu": "unit of torque"}  # fmt: skip
    missing = [f"{name} ({meaning})" for name, meaning in wanted.items() if not found.get(name)]
    if missing:
        raise RigError(
            f"The force sensor's page {address} lacks {', '.join(missing)}. Nothing is assumed in their place: is it"
            " the page of a Net F/T or an Ethernet Axia?"
        )
    force = _number(found["cfgcpf"], "cfgcpf", *_COUNTS, address)
    torque = _number(found["cfgcpt"], "cfgcpt", *_COUNTS, address)
    return Page(
        newtons_per_count=_unit(found["scfgfu"], "scfgfu", NEWTONS_PER_UNIT, address) / force,
        newton_metres_per_count=_unit(found["scfgtu"], "scfgtu", TORQUE_UNITS, address) / torque,
        rate=_number(found["comrdtrate"], "comrdtrate", *_RATES, address) if found.get("comrdtrate") else None,
    )


_CURE = "Is the sensor powered and on this network, and sensor.address (or sensor.page) of the rig's file right?"


class _Tree(ET.TreeBuilder):
    """Tree builder that refuses a document type.

    Its entities can expand without limit or refer elsewhere.
    """

    def __init__(self, address: str) -> None:
        super().__init__()
        self._address = address

    def doctype(self, name: str, public: str | None, system: str | None) -> NoReturn:
        raise RigError(
            f"The force sensor's page {self._address} declares a document type, which a sensor's never does."
        )


def _fetch(address: str, timeout: float) -> bytes:
    # No proxies, no redirection: only the sensor itself may answer.
    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.HTTPHandler(),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.HTTPDefaultErrorHandler(),
    ):
        opener.add_handler(handler)
    try:
        with opener.open(address, timeout=timeout) as response:
            text: bytes = response.read(MAX_PAGE_BYTES + 1)
    except urllib.error.HTTPError as error:
        raise RigError(f"The force sensor's page {address} is refused: {error}. Is the path {SETTINGS_PATH}?") from None
    except (OSError, HTTPException, ValueError) as error:  # ValueError: an address like http://:x
        raise RigError(f"The force sensor's page {address} cannot be read: {error}. {_CURE}") from None
    if len(text) > MAX_PAGE_BYTES:
        raise RigError(
            f"The force sensor's page {address} has more than {MAX_PAGE_BYTES} bytes, which is not a sensor's."
        )
    return text


def _number(text: str, name: str, low: float, high: float, address: str) -> float:
    try:
        return in_range(name, float(text), low, high, "1")
    except ValueError:
        raise RigError(
            f"The force sensor's page {address} has {name} = {text[:40]!r}, which must be {low:g} to {high:g}."
        ) from None


def _unit(text: str, name: str, units: dict[str, float], address: str) -> float:
    try:
        return units[_plain(text)]
    except KeyError:
        raise RigError(
            f"The force sensor's page {address} has {name} = {text[:40]!r}, a unit that is not known. Choose another"
            f" on its configuration page, such as {'N' if units is NEWTONS_PER_UNIT else 'N-m'}."
        ) from None


def _plain(unit: str) -> str:
    return "".join(letter for letter in unit.lower() if letter.isalpha())


_ASK_AGAIN = 0.5  # parts of a tare


class Counters(NamedTuple):
    """Counts of packets since the sensor was opened."""

    received: int = 0  # readings that were passed on
    lost: int = 0  # readings missing between them, including those that came too late
    reordered: int = 0  # readings dropped because the same or a later one had arrived
    garbled: int = 0  # packets of the sensor that were not records, or did not fit into the stream
    foreign: int = 0  # packets from other addresses


class NetftSensor(StreamedSensor):
    """A Net F/T or Ethernet Axia.

    ``rate`` [Hz] is from the sensor's page once it is open, before that from the settings.
    """

    name = "force sensor"

    def __init__(self, settings: SensorSettings, clock: Clock) -> None:
        self.page: Page | None = None  # configuration that the sensor reports, once it was opened
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
        """Return the sensor's own report and counts of packets."""
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
        """Request a stream; return whether a reading arrived."""
        self._address = (socket.gethostbyname(self._settings.address), self._settings.port)
        opened = self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setblocking(False)
        opened.bind((self._own_address(), 0))  # a port of our own; packets from elsewhere are dropped
        self._start(lambda: self._receive(opened))
        for _ in range(round(FIRST_READING / _ASK_AGAIN)):
            opened.sendto(request_bytes(RdtCommand.START), self._address)
            if self._comes(_ASK_AGAIN):
                return True
        return False

    def _own_address(self) -> str:
        """Return this computer's address on the sensor's network."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(self._address)  # sends nothing
            return str(probe.getsockname()[0])

    def _receive(self, opened: socket.socket) -> None:
        """Pass on the packets that have arrived."""
        sensor, clock = self._address, self._clock
        for _ in range(AT_ONCE):
            try:
                packet, sender = opened.recvfrom(2048)
            except BlockingIOError:
                return
            except ConnectionError:  # some systems report here that no sensor listens there: readings are missed
                continue
            except OSError as error:
                self.garbled(f"the network broke down: {error}", clock.now())
                self._stop()
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

    def _misplaced(self, number: int, now: float, *, late: bool) -> None:
        if late:
            self._reordered += 1
            return
        self._garbled += 1
        self.garbled(f"sequence {number} does not follow {self._stream.last}: a restart?", now)
