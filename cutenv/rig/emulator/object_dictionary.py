"""Object dictionary of an EPOS4: every object that the rig's master uses, with type, range and default."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

VENDOR, PRODUCT = 0xFB, 0x63500000  # maxon motor; EPOS4 50/15
RPM, MILLI_RPM = 0x00B44700, 0xFDB44700  # SI units of velocity (60A9)
_TYPES = {"u8": "<B", "u16": "<H", "u32": "<I", "i8": "<b", "i16": "<h", "i32": "<i"}
_RANGES = {
    name: (0, 2 ** (8 * struct.calcsize(form)) - 1)
    if name[0] == "u"
    else (-(2 ** (8 * struct.calcsize(form) - 1)), 2 ** (8 * struct.calcsize(form) - 1) - 1)
    for name, form in _TYPES.items()
}


class Abort(IntEnum):
    """Reason for refusing an SDO transfer (CiA 301)."""

    TOGGLE = 0x05030000
    COMMAND = 0x05040001
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH = 0x06040042
    LENGTH = 0x06070010
    NO_SUBINDEX = 0x06090011
    VALUE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    DEVICE_STATE = 0x08000022


class SdoAbort(Exception):
    """Refusal of an access, with the SDO abort code."""

    def __init__(self, code: Abort) -> None:
        super().__init__(code.name)
        self.code = code


@dataclass(frozen=True)
class ObjectEntry:
    """Sub-object: a number (``type`` "u8" to "i32"), or a text ("text").

    ``low`` and ``high`` limit the values that may be written, ``choices`` lists them; ``mappable`` names the PDOs ("R"
    received, "T" transmitted) that it may be mapped to.
    """

    index: int
    sub: int
    name: str
    type: str = "u32"
    access: Literal["ro", "rw", "wo"] = "rw"
    default: int | str = 0
    low: int | None = None
    high: int | None = None
    choices: tuple[int, ...] = ()
    mappable: str = ""

    @property
    def bits(self) -> int:
        """Length in a PDO [bit]."""
        return 8 * struct.calcsize(_TYPES[self.type])

    def check(self, value: int) -> None:
        """Raise Refused for a value out of range."""
        low, high = _RANGES[self.type]
        if value > (high if self.high is None else self.high):
            raise SdoAbort(Abort.TOO_HIGH)
        if value < (low if self.low is None else self.low):
            raise SdoAbort(Abort.TOO_LOW)
        if self.choices and value not in self.choices:
            raise SdoAbort(Abort.VALUE)


class ObjectDictionary:
    """Objects of one node, with their values.

    Parameters
    ----------
    entries : iterable of Entry
        Entries of the dictionary.
    written : callable, optional
        Called as ``written(entry, value)`` before a master's value is stored; raises :class:`SdoAbort` to refuse it.
    """

    def __init__(
        self, entries: Iterator[ObjectEntry], written: Callable[[ObjectEntry, int], None] = lambda entry, value: None
    ) -> None:
        self.entries = {(entry.index, entry.sub): entry for entry in entries}
        self._indices = {index for index, _ in self.entries}
        self._written = written
        self._values: dict[tuple[int, int], int | str] = {place: e.default for place, e in self.entries.items()}
        self.keep()

    def keep(self) -> None:
        """Store the present values as those after power on."""
        self._kept = dict(self._values)

    def restore(self) -> None:
        """Restore every stored value, as after power on."""
        self._values = dict(self._kept)

    def entry(self, index: int, sub: int) -> ObjectEntry:
        """Return the sub-object; raises :class:`SdoAbort` if there is none."""
        if (found := self.entries.get((index, sub))) is None:
            raise SdoAbort(Abort.NO_SUBINDEX if index in self._indices else Abort.NO_OBJECT)
        return found

    def __getitem__(self, place: tuple[int, int] | int) -> int:
        """Return the number; a plain index means sub-index 0."""
        value = self._values[(place, 0) if isinstance(place, int) else place]
        assert isinstance(value, int)
        return value

    def __setitem__(self, place: tuple[int, int] | int, value: int) -> None:
        """Set a value from the drive itself, limited to the range of its type."""
        where = (place, 0) if isinstance(place, int) else place
        low, high = _RANGES[self.entries[where].type]
        self._values[where] = min(max(value, low), high)

    def read(self, index: int, sub: int) -> bytes:
        """Return the bytes that an SDO client reads."""
        entry = self.entry(index, sub)
        if entry.access == "wo":
            raise SdoAbort(Abort.WRITE_ONLY)
        return self.packed(entry)

    def packed(self, entry: ObjectEntry) -> bytes:
        """Return the value in its form on the bus."""
        value = self._values[entry.index, entry.sub]
        return value.encode() if isinstance(value, str) else struct.pack(_TYPES[entry.type], value)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Write the bytes from an SDO client or an RPDO."""
        entry = self.entry(index, sub)
        if entry.access == "ro":
            raise SdoAbort(Abort.READ_ONLY)
        if entry.type not in _TYPES or len(data) != struct.calcsize(_TYPES[entry.type]):
            raise SdoAbort(Abort.LENGTH)
        value: int = struct.unpack(_TYPES[entry.type], data)[0]
        entry.check(value)
        self._written(entry, value)
        if index != 0x1010:  # a store command has no value
            self._values[index, sub] = value


def epos4(node: int) -> Iterator[ObjectEntry]:
    """Yield the objects of an EPOS4 50/15 at node ``node``; defaults from its device file, to be confirmed."""
    yield from _communication(node)
    for number in range(1, 5):
        yield from _process_data(node, number)
    yield from _manufacturer(node)
    yield from _drive()


def _communication(node: int) -> Iterator[ObjectEntry]:
    yield ObjectEntry(0x1000, 0, "device type", access="ro", default=0x00020192)
    yield ObjectEntry(0x1001, 0, "error register", "u8", "ro", mappable="T")
    yield ObjectEntry(0x1003, 0, "errors in history", "u8", high=0)
    for sub in range(1, 6):
        yield ObjectEntry(0x1003, sub, "error", access="ro")
    yield ObjectEntry(0x1005, 0, "COB-ID of SYNC", default=0x80, low=0x80, high=0x80)
    yield ObjectEntry(0x1008, 0, "device name", "text", "ro", "EPOS4")
    yield ObjectEntry(0x100A, 0, "software version", "text", "ro", "0170h (emulated)")
    yield ObjectEntry(0x1010, 0, "highest sub-index", "u8", "ro", 1)
    yield ObjectEntry(0x1010, 1, "store all parameters", default=1)
    yield ObjectEntry(0x1014, 0, "COB-ID of emergencies", access="ro", default=0x80 + node)
    yield ObjectEntry(0x1016, 0, "highest sub-index", "u8", "ro", 1)
    yield ObjectEntry(0x1016, 1, "consumer heartbeat", high=0x7FFFFF)
    yield ObjectEntry(0x1017, 0, "producer heartbeat [ms]", "u16")
    yield ObjectEntry(0x1018, 0, "highest sub-index", "u8", "ro", 4)
    for sub, (name, value) in enumerate(
        [("vendor", VENDOR), ("product", PRODUCT), ("revision", 0x01700000), ("serial number", 0x1000 + node)], start=1
    ):
        yield ObjectEntry(0x1018, sub, name, access="ro", default=value)
    yield ObjectEntry(0x1200, 0, "highest sub-index", "u8", "ro", 2)
    yield ObjectEntry(0x1200, 1, "SDO from the client", access="ro", default=0x600 + node)
    yield ObjectEntry(0x1200, 2, "SDO to the client", access="ro", default=0x580 + node)


def _process_data(node: int, number: int) -> Iterator[ObjectEntry]:
    places: tuple[tuple[int, int, int, tuple[int, ...]], ...] = (
        (0x1400, 0x1600, 0x200, (0x60400010,)),
        (0x1800, 0x1A00, 0x40000180, (0x60410010,)),
    )
    for settings, mapping, base, objects in places:
        settings, mapping, base = settings + number - 1, mapping + number - 1, base + 0x100 * (number - 1)
        valid = 0 if number == 1 else 0x80000000
        sends = base & 0x40000000
        yield ObjectEntry(settings, 0, "highest sub-index", "u8", "ro", 5 if sends else 2)
        yield ObjectEntry(settings, 1, "COB-ID", default=valid | base + node)
        yield ObjectEntry(settings, 2, "transmission type", "u8", default=255, choices=(*range(241), 254, 255))
        if sends:
            yield ObjectEntry(settings, 3, "inhibit time [0.1 ms]", "u16", default=10)
            yield ObjectEntry(settings, 5, "event timer [ms]", "u16")
        mapped = objects if number == 1 else ()
        yield ObjectEntry(mapping, 0, "mapped objects", "u8", default=len(mapped), high=8)
        for sub in range(1, 9):
            yield ObjectEntry(mapping, sub, "mapped object", default=mapped[sub - 1] if sub <= len(mapped) else 0)


def _manufacturer(node: int) -> Iterator[ObjectEntry]:
    yield ObjectEntry(0x2000, 0, "node number", "u8", "ro", node)
    yield ObjectEntry(0x3000, 0, "highest sub-index", "u8", "ro", 5)
    for sub in range(1, 6):
        yield ObjectEntry(0x3000, sub, "axis configuration")
    yield ObjectEntry(0x3001, 0, "highest sub-index", "u8", "ro", 5)
    yield ObjectEntry(0x3001, 1, "nominal current [mA]", default=2720)
    yield ObjectEntry(0x3001, 2, "output current limit [mA]", default=5440, high=30000)
    yield ObjectEntry(0x3001, 3, "pole pairs", "u8", default=1, low=1)
    yield ObjectEntry(0x3001, 4, "thermal time constant [0.1 s]", "u16", default=40)
    yield ObjectEntry(0x3001, 5, "torque constant [uN m/A]", default=20000)
    yield ObjectEntry(0x3003, 0, "highest sub-index", "u8", "ro", 3)
    yield ObjectEntry(0x3003, 1, "gear numerator", default=1, low=1)
    yield ObjectEntry(0x3003, 2, "gear denominator", default=1, low=1)
    yield ObjectEntry(0x3003, 3, "fastest input speed [rpm]", default=100000)
    yield ObjectEntry(0x3010, 0, "highest sub-index", "u8", "ro", 2)
    yield ObjectEntry(0x3010, 1, "encoder pulses", default=500, low=16, high=2500000)
    yield ObjectEntry(0x3010, 2, "encoder type", "u16", default=1)


def _drive() -> Iterator[ObjectEntry]:
    fastest = 2**32 - 1
    yield ObjectEntry(0x6007, 0, "abort connection option", "i16", default=1, low=0, high=3)
    yield ObjectEntry(0x603F, 0, "error code", "u16", "ro", mappable="T")
    yield ObjectEntry(0x6040, 0, "controlword", "u16", mappable="RT")
    yield ObjectEntry(0x6041, 0, "statusword", "u16", "ro", mappable="T")
    yield ObjectEntry(0x605A, 0, "quick stop option", "i16", default=2, choices=(2, 6))
    yield ObjectEntry(0x605B, 0, "shutdown option", "i16", default=0, low=0, high=1)
    yield ObjectEntry(0x605C, 0, "disable operation option", "i16", default=1, low=0, high=1)
    yield ObjectEntry(0x605E, 0, "fault reaction option", "i16", default=2, low=-1, high=2)
    yield ObjectEntry(0x6060, 0, "mode", "i8", default=0, choices=(0, 3, 6, 9), mappable="RT")
    yield ObjectEntry(0x6061, 0, "mode displayed", "i8", "ro", mappable="T")
    yield ObjectEntry(0x6062, 0, "position demanded [increments]", "i32", "ro", mappable="T")
    yield ObjectEntry(0x6064, 0, "position [increments]", "i32", "ro", mappable="T")
    yield ObjectEntry(0x6065, 0, "following error window [increments]", default=2000)
    yield ObjectEntry(0x606B, 0, "velocity demanded", "i32", "ro", mappable="T")
    yield ObjectEntry(0x606C, 0, "velocity", "i32", "ro", mappable="T")
    yield ObjectEntry(0x606D, 0, "velocity window", "u16", default=50)
    yield ObjectEntry(0x6076, 0, "rated torque [uN m]", default=100000, low=1)
    yield ObjectEntry(0x6077, 0, "torque [per mille]", "i16", "ro", mappable="T")
    yield ObjectEntry(0x607C, 0, "home offset [increments]", "i32")
    yield ObjectEntry(0x607D, 0, "highest sub-index", "u8", "ro", 2)
    yield ObjectEntry(0x607D, 1, "lowest position [increments]", "i32", default=-(2**31))
    yield ObjectEntry(0x607D, 2, "highest position [increments]", "i32", default=2**31 - 1)
    yield ObjectEntry(0x607F, 0, "fastest profile velocity", default=50000)
    yield ObjectEntry(0x6080, 0, "fastest motor speed [rpm]", default=50000)
    yield ObjectEntry(0x6081, 0, "profile velocity", default=1000)
    yield ObjectEntry(0x6083, 0, "acceleration [rpm/s]", default=10000, low=1)
    yield ObjectEntry(0x6084, 0, "deceleration [rpm/s]", default=10000, low=1)
    yield ObjectEntry(0x6085, 0, "quick stop deceleration [rpm/s]", default=10000, low=1)
    yield ObjectEntry(0x6086, 0, "profile type", "i16", default=0, choices=(0,))
    yield ObjectEntry(0x6098, 0, "homing method", "i8", default=37, choices=(35, 37))
    yield ObjectEntry(0x60A9, 0, "unit of velocity", default=RPM, choices=(RPM, MILLI_RPM))
    yield ObjectEntry(0x60C2, 0, "highest sub-index", "u8", "ro", 2)
    yield ObjectEntry(0x60C2, 1, "interpolation time", "u8", default=1)
    yield ObjectEntry(0x60C2, 2, "interpolation time, power of ten", "i8", default=-3, low=-6, high=0)
    yield ObjectEntry(0x60C5, 0, "greatest acceleration [rpm/s]", default=fastest, low=1)
    yield ObjectEntry(0x60C6, 0, "greatest deceleration [rpm/s]", default=fastest, low=1)
    yield ObjectEntry(0x60F4, 0, "following error [increments]", "i32", "ro", mappable="T")
    yield ObjectEntry(0x60FD, 0, "digital inputs", access="ro", mappable="T")
    yield ObjectEntry(0x60FF, 0, "target velocity", "i32", mappable="RT")
    yield ObjectEntry(0x6502, 0, "supported modes", access="ro", default=0x124)
