"""Object dictionary of an EPOS4: every object that the rig's master uses, with type, range and default."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from enum import IntEnum

from canopen import SdoAbortedError

from cutenv.rig.devices.canopen import objects as o
from cutenv.rig.devices.canopen.objects import Entry

_FASTEST = 2**32 - 1


class Abort(IntEnum):
    """Reason for refusing an SDO transfer (CiA 301)."""

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


def _range(entry: Entry) -> tuple[int, int]:
    """Return the least and the greatest number of an entry's kind."""
    signed = entry.kind.islower()
    return -(1 << entry.bits - 1) if signed else 0, (1 << entry.bits - signed) - 1


def _check(entry: Entry, value: int) -> None:
    """Raise SdoAbortedError for a value out of range."""
    low, high = _range(entry)
    if value > (high if entry.high is None else entry.high):
        raise SdoAbortedError(Abort.TOO_HIGH)
    if value < (low if entry.low is None else entry.low):
        raise SdoAbortedError(Abort.TOO_LOW)
    if entry.choices and value not in entry.choices:
        raise SdoAbortedError(Abort.VALUE)


class ObjectDictionary:
    """Objects of one node, with their values.

    canopen's SDO server reads and writes it by :meth:`get_data` and :meth:`set_data`, which have its names.

    Parameters
    ----------
    entries : iterable of Entry
        Entries of the dictionary.
    written : callable, optional
        Called as ``written(entry, value)`` before a master's value is stored; raises ``SdoAbortedError`` to refuse it.
    """

    object_dictionary = None  # of canopen's own kind, which its server keeps for a client's use

    def __init__(
        self, entries: Iterable[Entry], written: Callable[[Entry, int], None] = lambda entry, value: None
    ) -> None:
        self.entries = {(entry.index, entry.sub): entry for entry in entries}
        self._indices = {index for index, _ in self.entries}
        self._ranges = {place: _range(entry) for place, entry in self.entries.items()}
        self._written = written
        self._values: dict[tuple[int, int], int | str] = {place: e.default for place, e in self.entries.items()}
        self.keep()

    def keep(self) -> None:
        """Store the present values as those after power on."""
        self._kept = dict(self._values)

    def restore(self) -> None:
        """Restore every stored value, as after power on."""
        self._values = dict(self._kept)

    def entry(self, index: int, sub: int) -> Entry:
        """Return the sub-object; raises ``SdoAbortedError`` if there is none."""
        if (found := self.entries.get((index, sub))) is None:
            raise SdoAbortedError(Abort.NO_SUBINDEX if index in self._indices else Abort.NO_OBJECT)
        return found

    def __getitem__(self, place: tuple[int, int] | int) -> int:
        """Return the number; a plain index means sub-index 0."""
        value = self._values[(place, 0) if isinstance(place, int) else place]
        assert isinstance(value, int)
        return value

    def __setitem__(self, place: tuple[int, int] | int, value: int) -> None:
        """Set a value from the drive itself, limited to the range of its kind."""
        where = (place, 0) if isinstance(place, int) else place
        low, high = self._ranges[where]
        self._values[where] = min(max(value, low), high)

    def get_data(self, index: int, sub: int, check_readable: bool = False) -> bytes:
        """Return the value in its form on the bus."""
        kind, value = self.entry(index, sub).kind, self._values[index, sub]
        return value.encode() if isinstance(value, str) else struct.pack(f"<{kind}", value)

    def set_data(self, index: int, sub: int, data: bytes, check_writable: bool = True) -> None:
        """Write the bytes from an SDO client or an RPDO."""
        entry = self.entry(index, sub)
        if entry.access == "ro":
            raise SdoAbortedError(Abort.READ_ONLY)
        if 8 * len(data) != entry.bits:
            raise SdoAbortedError(Abort.LENGTH)
        value: int = struct.unpack(f"<{entry.kind}", data)[0]
        _check(entry, value)
        self._written(entry, value)
        if index != 0x1010:  # a store command has no value
            self._values[index, sub] = value


def epos4(node: int) -> list[Entry]:
    """Return the objects of an EPOS4 50/15 at node ``node``; defaults from its device file, to be confirmed."""
    entries = [*o.NAMED, *_process_data(node), *_others(node)]
    given = {(entry.index, entry.sub) for entry in entries}
    highest = {index: sub for index, sub in sorted(given)}
    return entries + [
        Entry(index, 0, "B", "highest sub-index", "ro", sub)
        for index, sub in highest.items()
        if (index, 0) not in given
    ]


def _process_data(node: int) -> Iterator[Entry]:
    for number in range(4):
        for settings, mapping, cob, mapped in (
            (0x1400 + number, 0x1600 + number, 0x200, o.CONTROLWORD),
            (0x1800 + number, 0x1A00 + number, o.PDO_NO_REQUEST | 0x180, o.STATUSWORD),
        ):
            unused = o.PDO_UNUSED if number else 0
            yield Entry(settings, 1, "I", "COB-ID", default=unused | cob + 0x100 * number + node)
            yield Entry(settings, 2, "B", "transmission type", default=255, choices=(*range(241), 254, 255))
            if settings >= 0x1800:
                yield Entry(settings, 3, "H", "inhibit time [0.1 ms]", default=10)
                yield Entry(settings, 5, "H", "event timer [ms]")
            yield Entry(mapping, 0, "B", "mapped objects", default=0 if number else 1, high=8)
            for sub in range(1, 9):
                yield Entry(mapping, sub, "I", "mapped object", default=mapped.mapping if number < sub == 1 else 0)


def _others(node: int) -> Iterator[Entry]:
    yield Entry(0x1001, 0, "B", "error register", "ro", mappable="T")
    yield Entry(0x1003, 0, "B", "errors in history", high=0)
    for sub in range(1, 6):
        yield Entry(0x1003, sub, "I", "error", "ro")
        yield Entry(0x3000, sub, "I", "axis configuration")
    yield Entry(0x1005, 0, "I", "COB-ID of SYNC", default=0x80, low=0x80, high=0x80)
    yield Entry(0x1008, 0, "s", "device name", "ro", "EPOS4")
    yield Entry(0x100A, 0, "s", "software version", "ro", "0170h (emulated)")
    yield Entry(0x1010, 1, "I", "store all parameters", default=1)
    yield Entry(0x1014, 0, "I", "COB-ID of emergencies", "ro", 0x80 + node)
    yield Entry(0x1018, 2, "I", "product", "ro", 0x63500000)  # EPOS4 50/15
    yield Entry(0x1018, 3, "I", "revision", "ro", 0x01700000)
    yield Entry(0x1018, 4, "I", "serial number", "ro", 0x1000 + node)
    yield Entry(0x1200, 1, "I", "SDO from the client", "ro", 0x600 + node)
    yield Entry(0x1200, 2, "I", "SDO to the client", "ro", 0x580 + node)
    yield Entry(0x2000, 0, "B", "node number", "ro", node)
    yield Entry(0x3001, 1, "I", "nominal current [mA]", default=2720)
    yield Entry(0x3001, 3, "B", "pole pairs", default=1, low=1)
    yield Entry(0x3001, 4, "H", "thermal time constant [0.1 s]", default=40)
    yield Entry(0x3001, 5, "I", "torque constant [uN m/A]", default=20000)
    yield Entry(0x3003, 3, "I", "fastest input speed [rpm]", default=100000)
    yield Entry(0x3010, 2, "H", "encoder type", default=1)
    yield Entry(0x603F, 0, "H", "error code", "ro", mappable="T")
    yield Entry(0x605B, 0, "h", "shutdown option", default=0, low=0, high=1)
    yield Entry(0x605C, 0, "h", "disable operation option", default=1, low=0, high=1)
    yield Entry(0x6062, 0, "i", "position demanded [increments]", "ro", mappable="T")
    yield Entry(0x606B, 0, "i", "velocity demanded", "ro", mappable="T")
    yield Entry(0x606D, 0, "H", "velocity window", default=50)
    yield Entry(0x6076, 0, "I", "rated torque [uN m]", default=100000, low=1)
    yield Entry(0x607C, 0, "i", "home offset [increments]")
    yield Entry(0x6081, 0, "I", "profile velocity", default=1000)
    yield Entry(0x6086, 0, "h", "profile type", choices=(0,))
    yield Entry(0x6098, 0, "b", "homing method", default=37, choices=(35, 37))
    yield Entry(0x60C2, 1, "B", "interpolation time", default=1)
    yield Entry(0x60C2, 2, "b", "interpolation time, power of ten", default=-3, low=-6, high=0)
    yield Entry(0x60C5, 0, "I", "greatest acceleration [rpm/s]", default=_FASTEST, low=1)
    yield Entry(0x60C6, 0, "I", "greatest deceleration [rpm/s]", default=_FASTEST, low=1)
    yield Entry(0x60F4, 0, "i", "following error [increments]", "ro", mappable="T")
    yield Entry(0x60FD, 0, "I", "digital inputs", "ro", mappable="T")
    yield Entry(0x6502, 0, "I", "supported modes", "ro", 0x124)
