"""Process data objects of a node: frames sent at a SYNC or a change, frames received, mapped as the master wrote."""

from __future__ import annotations

from dataclasses import dataclass

from canopen import SdoAbortedError

from cutenv.rig.devices.canopen.objects import PDO_UNUSED, Entry
from cutenv.rig.emulator.object_dictionary import Abort, ObjectDictionary

_IDENTIFIER = 0x7FF
_SYNCHRONOUS = 240  # greatest transmission type that depends on SYNC
Write = tuple[int, int, bytes]
"""Index, sub-index and new value of an object that a received frame writes."""


def _parts(mapped: int) -> tuple[int, int, int]:
    """Return index, sub-index and bits of a mapped object."""
    return mapped >> 16, mapped >> 8 & 0xFF, mapped & 0xFF


def check_mapping(dictionary: ObjectDictionary, entry: Entry, value: int) -> None:
    """Raise SdoAbortedError for a write to 1400, 1600, 1800, 1A00 or their successors that CiA 301 does not allow."""
    settings = entry.index & ~0x200
    sends = settings >= 0x1800
    valid = not dictionary[settings, 1] & PDO_UNUSED
    if entry.index == settings:
        if entry.sub == 1 and valid and not value & PDO_UNUSED and value != dictionary[settings, 1]:
            raise SdoAbortedError(Abort.DEVICE_STATE)
        return
    if valid or (entry.sub > 0 and dictionary[entry.index, 0] > 0):
        raise SdoAbortedError(Abort.DEVICE_STATE)  # first the COB-ID must be made invalid and the number of objects 0
    if entry.sub > 0:
        _check_mapped(dictionary, value, "T" if sends else "R")
        return
    bits = 0
    for sub in range(1, value + 1):
        _check_mapped(dictionary, dictionary[entry.index, sub], "T" if sends else "R")
        bits += dictionary[entry.index, sub] & 0xFF
    if bits > 64:
        raise SdoAbortedError(Abort.PDO_LENGTH)


def _check_mapped(dictionary: ObjectDictionary, mapped: int, way: str) -> None:
    if mapped == 0:
        return
    index, sub, bits = _parts(mapped)
    found = dictionary.entry(index, sub)
    if way not in found.mappable or bits != found.bits:
        raise SdoAbortedError(Abort.NOT_MAPPABLE)


@dataclass
class _Pdo:
    settings: int
    mapping: int
    syncs: int = 0  # since the last transmission
    pending: bytes | None = None  # received data, for use at the next SYNC
    last: bytes = b""
    last_sent: float = -1.0

    def cob(self, dictionary: ObjectDictionary) -> int | None:
        """Return the identifier; None if the PDO is not in use."""
        cob = dictionary[self.settings, 1]
        return None if cob & PDO_UNUSED else cob & _IDENTIFIER

    def places(self, dictionary: ObjectDictionary) -> list[tuple[int, int, int]]:
        return [_parts(dictionary[self.mapping, sub]) for sub in range(1, dictionary[self.mapping, 0] + 1)]


class ProcessData:
    """All PDOs of a node."""

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._received = [_Pdo(0x1400 + i, 0x1600 + i) for i in range(4)]
        self._sent = [_Pdo(0x1800 + i, 0x1A00 + i) for i in range(4)]

    def received(self, identifier: int, data: bytes) -> list[Write]:
        """Return the writes of a received frame; a synchronous RPDO's are kept for :meth:`synchronised`."""
        writes: list[Write] = []
        for pdo in self._received:
            if pdo.cob(self._dictionary) != identifier:
                continue
            if self._dictionary[pdo.settings, 2] <= _SYNCHRONOUS:
                pdo.pending = data
            else:
                writes += self._unpacked(pdo, data)
        return writes

    def synchronised(self) -> list[Write]:
        """Return the writes that have waited for this SYNC."""
        writes: list[Write] = []
        for pdo in self._received:
            if pdo.pending is not None:
                writes += self._unpacked(pdo, pdo.pending)
                pdo.pending = None
        return writes

    def due_at_sync(self) -> list[tuple[int, bytes]]:
        """Return identifier and data of the frames to send at a SYNC."""
        frames = []
        for pdo in self._sent:
            cob, kind = pdo.cob(self._dictionary), self._dictionary[pdo.settings, 2]
            if cob is None or kind > _SYNCHRONOUS:
                continue
            pdo.syncs += 1
            data = self._packed(pdo)
            if pdo.syncs >= kind if kind else data != pdo.last:
                pdo.syncs, pdo.last = 0, data
                frames.append((cob, data))
        return frames

    def due_by_event(self, now: float) -> list[tuple[int, bytes]]:
        """Return identifier and data of the frames to send because of a change or an event timer."""
        frames = []
        for pdo in self._sent:
            cob = pdo.cob(self._dictionary)
            if cob is None or self._dictionary[pdo.settings, 2] <= _SYNCHRONOUS:
                continue
            since = now - pdo.last_sent
            if since < 1e-4 * self._dictionary[pdo.settings, 3]:
                continue
            data, timer = self._packed(pdo), 1e-3 * self._dictionary[pdo.settings, 5]
            if data != pdo.last or 0.0 < timer <= since:
                pdo.last, pdo.last_sent = data, now
                frames.append((cob, data))
        return frames

    def _packed(self, pdo: _Pdo) -> bytes:
        dictionary = self._dictionary
        return b"".join(dictionary.get_data(index, sub) for index, sub, bits in pdo.places(dictionary) if bits)

    def _unpacked(self, pdo: _Pdo, data: bytes) -> list[Write]:
        places = pdo.places(self._dictionary)
        if len(data) < sum(bits for *_, bits in places) // 8:
            return []  # a frame that is too short is not used at all (CiA 301)
        writes: list[Write] = []
        at = 0
        for index, sub, bits in places:
            if bits:
                writes.append((index, sub, data[at : at + bits // 8]))
                at += bits // 8
        return writes
