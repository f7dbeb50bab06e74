"""Files of other programs, by their suffix: what reads each of them into named columns."""

from __future__ import annotations

import dataclasses
import gzip
import shutil
import tempfile
import zlib
from collections.abc import Callable, Collection
from pathlib import Path

from cutenv.recording import (
    arrow_file,
    foreign_hdf5,
    matlab_file,
    numpy_file,
    ros_bag,
    spreadsheet,
    tdms_file,
    xdf_file,
)
from cutenv.recording.bag_messages import BAGS, is_bag
from cutenv.recording.csv_sniffer import sniff_table
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError

_Reader = Callable[[Path, Collection[str]], NamedColumns]
_READERS: dict[str, _Reader] = {
    **dict.fromkeys(BAGS, ros_bag.bag_table),
    **dict.fromkeys((".parquet", ".feather", ".arrow"), arrow_file.read),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), foreign_hdf5.read),
    ".mat": matlab_file.read,
    **dict.fromkeys((".npz", ".npy"), numpy_file.read),
    ".tdms": tdms_file.read,
    **dict.fromkeys((".xdf", ".xdfz"), xdf_file.read),
}
FOREIGN_SUFFIXES = (*_READERS, *spreadsheet.WORKBOOKS)
"""Suffixes of the formats that are no text."""
PACKED = ".gz"


def is_text(path: Path) -> bool:
    """Return whether a path is read as text: by its suffix, and the one that it has when unpacked."""
    return _reader(Path(path.stem) if path.suffix.lower() == PACKED else path) is None


def is_record_folder(path: Path) -> bool:
    """Return whether a folder is one record, and not a folder of records: a bag of ROS 2, or a data set of LeRobot."""
    return path.is_dir() and (is_bag(path) or arrow_file.is_lerobot(path))


def foreign_columns(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read the columns of a file of another program, also of one that is packed with gzip.

    Parameters
    ----------
    path : path
        Path of the file, or of a folder that is a record.
    names : collection of str
        Columns that are needed, that of the force first; it matters where series with clocks of their own are joined.

    Raises
    ------
    RecordError
        If it cannot be read: names place, reason and cure.
    OSError
        If it cannot be opened.
    ModuleNotFoundError
        If the format's library is not installed; names the pip command.
    """
    if path.suffix.lower() == PACKED and path.is_file():
        return _unpacked(path, names)
    reader = _reader(path)
    return sniff_table(path) if reader is None else reader(path, names)


def _reader(path: Path) -> _Reader | None:
    if path.is_dir():
        return ros_bag.bag_table if is_bag(path) else arrow_file.read if arrow_file.is_lerobot(path) else None
    if path.is_file() and spreadsheet.is_workbook(path):
        return spreadsheet.read
    return _READERS.get(path.suffix.lower())


def _unpacked(path: Path, names: Collection[str]) -> NamedColumns:
    with tempfile.TemporaryDirectory() as folder:
        inside = Path(folder) / path.stem
        try:
            with gzip.open(path) as packed, inside.open("wb") as file:
                shutil.copyfileobj(packed, file)
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            raise RecordError(path, f"it is no gzip file, or a damaged one ({error}). Take the file again.") from None
        try:
            return dataclasses.replace(foreign_columns(inside, names), path=path)
        except RecordError as error:
            raise RecordError(path, error.reason) from None
