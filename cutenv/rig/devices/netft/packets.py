"""Packets of RDT: a request of 8 bytes, a record of 36; network byte order.

Source: ATI Industrial Automation, Network Force/Torque Sensor System, document 9620-05-NET FT, "UDP interface using
RDT"; bits of the status: Ethernet Axia, document 9610-05, table 4.7.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

from cutenv._base.validation import in_range
from cutenv.rig.devices.reading_stream import SEQUENCES

PORT = 49152
"""UDP port of a sensor as delivered."""
PACKET_HEADER = 0x1234
"""First two bytes of every request."""

_REQUEST = struct.Struct("!HHI")
_PACKET = struct.Struct("!IIIiiiiii")
PACKET_SIZE = _PACKET.size


class PacketError(ValueError):
    """Error for bytes that are not a packet of this protocol; the message gives the reason."""


class RdtCommand(IntEnum):
    """Command to a sensor."""

    STOP = 0x0000
    START = 0x0002
    RESET_LATCH = 0x0041
    BIAS = 0x0042


class SensorStatus(IntEnum):
    """Bits of the status of an Ethernet Axia; a healthy sensor sends 0.

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
    """Reading as sent.

    Attributes
    ----------
    sequence : int
        Number of the record within its stream, modulo 2**32; a gap is a lost record.
    sampled : int
        Counter of the sensor's own, faster sampling, modulo 2**32.
    status : int
        Status bits, see :class:`SensorStatus`; 0 is healthy.
    counts : tuple of 6 int
        Fx, Fy, Fz, Tx, Ty, Tz in counts.
    """

    sequence: int
    sampled: int
    status: int
    counts: tuple[int, int, int, int, int, int]


def request_bytes(command: RdtCommand, count: int = 0) -> bytes:
    """Return a request for ``count`` records, 0 for an endless stream.

    Raises
    ------
    ValueError
        If the count does not fit into 32 bits.
    """
    in_range("count", count, 0, SEQUENCES - 1, "1", "0 streams until it is stopped.")
    return _REQUEST.pack(PACKET_HEADER, command, count)


def parse_request(packet: bytes) -> tuple[RdtCommand, int]:
    """Parse a request into command and count.

    Raises
    ------
    PacketError
        If it is not 8 bytes, does not begin with 0x1234, or contains an unknown command.
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
    """Return the 36 bytes of a record.

    Raises
    ------
    PacketError
        If a number does not fit into its 32 bits.
    """
    try:
        return _PACKET.pack(record.sequence, record.sampled, record.status, *record.counts)
    except struct.error as error:
        raise PacketError(f"{record} does not fit into a record: {error}") from None


def parse_packet(packet: bytes) -> SensorPacket:
    """Parse a record; any 36 bytes are one.

    Raises
    ------
    PacketError
        If it is not 36 bytes.
    """
    if len(packet) != PACKET_SIZE:
        raise PacketError(f"a record has {PACKET_SIZE} bytes, this has {len(packet)}")
    numbers = _PACKET.unpack(packet)
    return SensorPacket(numbers[0], numbers[1], numbers[2], numbers[3:])


def status_meaning(status: int) -> str:
    """Return the meaning of a status in words; bits that differ between models are given by number."""
    if not status:
        return "healthy"
    known = [meaning for bit, meaning in _MEANINGS.items() if status & bit]
    others = [str(bit) for bit in range(31, -1, -1) if status >> bit & 1 and 1 << bit not in _MEANINGS]
    if others:
        known.append(f"bits {', '.join(others)} (see the sensor's manual)")
    return f"0x{status:08X}: {', '.join(known)}"
