"""Check of an HDF5 file's global heaps before libhdf5 reads them: it loops for ever in a damaged one."""

from __future__ import annotations

import mmap
from pathlib import Path

_SIGNATURE = b"GCOL\x01\x00\x00\x00"  # a global heap collection, version 1
_HEADER = 16  # bytes in the header of a collection, and of each object


def check_integrity(path: Path) -> None:
    """Raise an error for a file with a heap in which an object points outside, or to itself.

    Text of variable length, which other programs use for attributes, is stored in heaps without a checksum. A length of
    zero makes the library read the same place for ever. The files of :func:`cutenv.recording.save` have no heaps.

    Raises
    ------
    ValueError
        If a heap is damaged.

    Notes
    -----
    HDF5 File Format Specification 3.0, section III.E: each object is an index (0 for free space), a count, 4 reserved
    bytes, and the length of the data that follows, padded to a multiple of 8; free space includes its header.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.find(_SIGNATURE)
        while start >= 0:
            if not _leads_to_its_end(content, start):
                raise ValueError("it is a damaged HDF5 file: its text is not to be read. Take the file again.")
            start = content.find(_SIGNATURE, start + 1)


def _leads_to_its_end(content: mmap.mmap, start: int) -> bool:
    end = start + int.from_bytes(content[start + 8 : start + 16], "little")
    if end > len(content):
        return False
    place = start + _HEADER
    while place + _HEADER <= end:
        length = int.from_bytes(content[place + 8 : place + 16], "little")
        is_free = content[place : place + 2] == b"\x00\x00"
        taken = length if is_free else _HEADER + (length + 7) // 8 * 8
        if taken < _HEADER:
            return False
        place += taken
    return place <= end
