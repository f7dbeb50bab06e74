"""SDO server of a node: expedited and segmented transfers of one object at a time (CiA 301)."""

from __future__ import annotations

import struct

from cutenv.rig.emulator.object_dictionary import Abort, ObjectDictionary, SdoAbort

_HEAD = struct.Struct("<BHB")
_LONGEST = 256  # bytes of a segmented download: no object is longer
_TOGGLE = 0x10


class SdoServer:
    """Server that answers the eight bytes of a request with eight bytes."""

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._place = (0, 0)
        self._upload: bytes | None = None  # rest to be sent
        self._download: bytearray | None = None
        self._toggle = 0

    def answer(self, request: bytes) -> bytes | None:
        """Return the answer, or None if the standard demands none (an abort, or too few bytes)."""
        if len(request) != 8:
            return None
        specifier = request[0] >> 5
        if specifier == 4:  # the client has aborted
            self._upload = self._download = None
            return None
        try:
            match specifier:
                case 1:
                    return self._begin_download(request)
                case 0:
                    return self._go_on_download(request)
                case 2:
                    return self._begin_upload(request)
                case 3:
                    return self._go_on_upload(request)
                case 5 if request[0] & 0x03 == 0:  # a block upload may be answered by an ordinary one
                    return self._begin_upload(request)
                case _:
                    self._place = _HEAD.unpack_from(request)[1:]
                    raise SdoAbort(Abort.COMMAND)
        except SdoAbort as refused:
            self._upload = self._download = None
            return struct.pack("<BHBI", 0x80, *self._place, refused.code)

    def _begin_download(self, request: bytes) -> bytes:
        head, *place = _HEAD.unpack_from(request)
        self._place = place[0], place[1]
        self._upload = self._download = None
        if head & 0x02:  # expedited
            size = 4 - (head >> 2 & 0x03) if head & 0x01 else self._size()
            self._dictionary.write(*self._place, request[4 : 4 + size])
        else:
            if self._dictionary.entry(*self._place).access == "ro":
                raise SdoAbort(Abort.READ_ONLY)
            self._download, self._toggle = bytearray(), 0
        return _HEAD.pack(0x60, *self._place) + bytes(4)

    def _size(self) -> int:
        """Return the size of an object whose transfer does not state it [byte]."""
        entry = self._dictionary.entry(*self._place)
        return 4 if entry.type == "text" else entry.bits // 8

    def _go_on_download(self, request: bytes) -> bytes:
        if self._download is None:
            raise SdoAbort(Abort.COMMAND)
        toggle = self._toggled(request)
        self._download += request[1 : 8 - (request[0] >> 1 & 0x07)]
        if len(self._download) > _LONGEST:
            raise SdoAbort(Abort.LENGTH)
        if request[0] & 0x01:  # the last
            data, self._download = bytes(self._download), None
            self._dictionary.write(*self._place, data)
        return bytes([0x20 | toggle]) + bytes(7)

    def _begin_upload(self, request: bytes) -> bytes:
        _, *place = _HEAD.unpack_from(request)
        self._place = place[0], place[1]
        self._upload = self._download = None
        data = self._dictionary.read(*self._place)
        if 0 < len(data) <= 4:
            return _HEAD.pack(0x43 | (4 - len(data)) << 2, *self._place) + data.ljust(4, b"\0")
        self._upload, self._toggle = data, 0
        return _HEAD.pack(0x41, *self._place) + struct.pack("<I", len(data))

    def _go_on_upload(self, request: bytes) -> bytes:
        if self._upload is None:
            raise SdoAbort(Abort.COMMAND)
        toggle = self._toggled(request)
        part, rest = self._upload[:7], self._upload[7:]
        self._upload = rest or None
        return bytes([toggle | (7 - len(part)) << 1 | (not rest)]) + part.ljust(7, b"\0")

    def _toggled(self, request: bytes) -> int:
        toggle = request[0] & _TOGGLE
        if toggle != self._toggle:
            raise SdoAbort(Abort.TOGGLE)
        self._toggle ^= _TOGGLE
        return toggle
