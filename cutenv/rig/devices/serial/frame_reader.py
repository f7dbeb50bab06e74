"""Frames of a fixed size in a stream of bytes: found by header and CRC, and believed only in step with the last one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple


def crc_table(polynomial: int) -> tuple[int, ...]:
    """Return the table of a CRC of 16 bits that takes the lowest bit first, by its reversed polynomial."""
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
    """Error for bytes that are no sound frame; the message names the fault."""


class SensorFrame(NamedTuple):
    """Reading in a frame: six counts, status (0: healthy), and the sensor's own time [us], -1 where it sends none."""

    counts: tuple[int, int, int, int, int, int]
    status: int
    stamp: int = -1


class FrameFormat(NamedTuple):
    """Format of frames: first bytes, size, and the function that parses a frame or raises :class:`FrameError`."""

    header: bytes
    size: int
    parse: Callable[[bytes], SensorFrame]


class FrameReader:
    """Reader that cuts a stream into frames.

    A CRC of 16 bits lets one of 65 536 random frames pass. After anything unsound a frame is therefore believed only if
    it begins where another sound one has ended; that other is left out, as lost.

    Parameters
    ----------
    form : FrameFormat
        Format of the frames.
    """

    def __init__(self, form: FrameFormat) -> None:
        self._form = form
        self._rest = b""
        self._in_step = False
        self._skipped = 0  # [bytes] since the last frame that was believed
        self._missed = 0

    def take(self, read: bytes) -> Iterator[tuple[SensorFrame, int] | FrameError]:
        """Take bytes; yield each frame with the number of those missed before it, or the fault, once for a run of them.

        Before the first frame nothing is called a fault: the stream may be joined anywhere.
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
        """Leave out bytes up to the next that may begin a frame."""
        place = self._rest.find(self._form.header, 1)
        if place < 0:
            place = len(self._rest) - len(self._form.header) + 1
        self._rest = self._rest[place:]
        self._skipped += place
