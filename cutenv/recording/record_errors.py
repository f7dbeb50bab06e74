"""Error that every reader of records raises for a bad file, such as one of another kind."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""First bytes of text in UTF-16."""

_BEGINNINGS = {
    b"PAR1": "Parquet",
    b"\x89HDF\r\n\x1a\n": "HDF5",
    b"\x89MCAP0\r\n": "MCAP",
    b"#ROSBAG V": "a bag of ROS 1",
    b"SQLite format 3\x00": "a bag of ROS 2 in SQLite, or another SQLite file",
    b"PK\x03\x04": "a zip file or a spreadsheet",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook",
    b"\x1f\x8b": "a gzip file (unpack it first)",
    b"TDSm": "a LabVIEW TDMS file (export it as text)",
    **dict.fromkeys(UTF_16, "text in UTF-16"),
}


class RecordError(ValueError):
    """Error for a file that is not a record, or is damaged: it names the file, the place, the reason and the cure.

    Parameters
    ----------
    path : path
        Path of the file.
    reason : str
        Place, reason and cure, in the reader's words.

    Attributes
    ----------
    path : Path
        Path of the file.
    reason : str
        Reason as given.
    """

    def __init__(self, path: str | os.PathLike[str], reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = Path(path)
        self.reason = reason

    def __reduce__(self) -> tuple[type[RecordError], tuple[Path, str]]:
        return type(self), (self.path, self.reason)  # by its own arguments, so that it can be pickled between processes


def check_beginning(path: Path, content: bytes, name: str, allowed: Collection[bytes] = ()) -> None:
    """Raise RecordError for an empty file, or one that begins as another format than ``name`` and the allowed do."""
    if not content:
        raise RecordError(path, "it is empty. Record or copy it again.")
    for known, what in _BEGINNINGS.items():
        if content.startswith(known) and what != name and known not in allowed:
            raise RecordError(
                path, f"it is no {name} but {what}. Give it the suffix of what it is, or save it as CSV in UTF-8."
            )
