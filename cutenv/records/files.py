"""Saving and loading of traces in the suffix's format."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from cutenv._base.output import atomic_write
from cutenv._base.validation import one_of
from cutenv.records import csv_file, hdf5_file, mcap_file, parquet_file
from cutenv.records.provenance import check_operator
from cutenv.records.schema import RecordError, check_beginning
from cutenv.records.table import ALONG_CUT, CutTable, traces_of
from cutenv.sim.trace import Trace


class _Format(NamedTuple):
    """Name, writer and reader of a kind of file."""

    name: str
    write: Callable[[Sequence[Trace], Path], None]
    read: Callable[[Path], list[CutTable]]


_HDF5 = _Format("HDF5", hdf5_file.write, hdf5_file.read)
FORMATS = {
    ".csv": _Format("CSV", csv_file.write, csv_file.read),
    ".parquet": _Format("Parquet", parquet_file.write, parquet_file.read),
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mcap": _Format("MCAP", mcap_file.write, mcap_file.read),
}
"""Formats of a record by their suffixes."""


def save(traces: Trace | Iterable[Trace], path: str | os.PathLike[str]) -> None:
    """Write one or several cuts to a file without loss.

    The file is written as a whole or not at all: an interruption leaves the earlier file.

    Parameters
    ----------
    path : path
        Its suffix is the format: ``.csv``, ``.parquet``, ``.h5``, ``.hdf5`` or ``.mcap``.

    Raises
    ------
    TypeError
        If anything but traces is given.
    ValueError
        If there is no trace, or its metadata name an operator who is not anonymous
        (:class:`cutenv.records.Provenance`).
    RecordError
        For another suffix.
    ModuleNotFoundError
        If the format's library is not installed; names the pip command.
    OSError
        If the file cannot be written.
    """
    kept = [traces] if isinstance(traces, Trace) else list(traces)
    for number, trace in enumerate(kept):
        if not isinstance(trace, Trace):
            raise TypeError(f"traces[{number}] is a {type(trace).__name__}; save takes a Trace or several.")
        if "operator" in trace.metadata:
            check_operator(trace.metadata["operator"])
    if not kept:
        raise ValueError("there is no trace to save. Give one or more.")
    path = Path(path)
    chosen = format_of(path)
    with atomic_write(path) as part:
        chosen.write(kept, part)


def load(path: str | os.PathLike[str], *, force: str | None = None) -> list[Trace]:
    """Read every cut of a file.

    Units are in the headers (:data:`cutenv.records.UNITS`) and are converted to SI. A file from another program needs
    only its row of headers; a column ``cut`` separates several cuts, and its number is kept in the metadata.

    Parameters
    ----------
    path : path
        Its suffix is the format: ``.csv``, ``.parquet``, ``.h5``, ``.hdf5`` or ``.mcap``.
    force : {"norm", "x", "y", "z", "-x", "-y", "-z"}, optional
        Computation of the force along the cut from components (``force_x_N``, ...). It is positive against forward
        motion: choose the axis along the cut, and the minus if the sensor's sign is reversed. By default the metadata's
        ``force_along_cut``, else the norm; a norm has no sign, so that friction on the way back looks like cutting, and
        nothing that needs a return stroke can be computed from it. A force without an axis is used as it is.

    Returns
    -------
    list of Trace
        Cuts in the order of the file. If the force is from components, the metadata ``force_along_cut`` state how. For
        a record that was interrupted (:class:`cutenv.records.AppendingRecord`), ``truncated`` is true, and all
        complete lines are there.

    Raises
    ------
    RecordError
        If the file is not a record, or is damaged: incomplete, columns missing or unknown, a cell that is not a number,
        NaN, time that does not increase, values out of range. Names the line, or the row, and the cure.
    FileNotFoundError, PermissionError, IsADirectoryError
        If there is no file that can be read.
    ModuleNotFoundError
        If the format's library is not installed; names the pip command.
    ValueError
        If `force` is not one of those above.

    Notes
    -----
    Saved files carry checksums in Parquet and HDF5, but only the number of rows in CSV: there, a digit changed into
    another is not noticed. Most damage of HDF5 files from other programs is noticed too, but these have no checksums,
    and the library may hang or crash on one of them: open a file that you do not trust in a separate process, and save
    it again.
    """
    if force is not None:
        one_of("force", force, ALONG_CUT)
    path = Path(path)
    traces = []
    for table in tables_in(path):
        try:
            traces += traces_of(table, force)
        except ValueError as error:
            raise RecordError(path, f"{table.name}{error}") from None
    return traces


def tables_in(path: Path) -> list[CutTable]:
    """Return a file's columns before any check; raises as :func:`load`."""
    chosen = format_of(path)
    try:
        with path.open("rb") as file:
            check_beginning(path, file.read(16), chosen.name)
        return chosen.read(path)
    except (FileNotFoundError, PermissionError, IsADirectoryError, RecordError):
        raise
    except (OSError, ValueError) as error:
        raise RecordError(path, str(error)) from None


def load_one(path: str | os.PathLike[str], *, force: str | None = None) -> Trace:
    """Read the cut of a file that holds one; parameters and errors as in :func:`load`."""
    traces = load(path, force=force)
    if len(traces) != 1:
        raise RecordError(path, f"it holds {len(traces)} cuts. Read them with load() and choose one.")
    return traces[0]


def format_of(path: Path) -> _Format:
    """Return the format of a suffix; RecordError for one that is no record's."""
    if path.suffix.lower() not in FORMATS:
        known = ", ".join(FORMATS)
        raise RecordError(path, f"its suffix {path.suffix!r} is no format of a record. Use one of {known}.")
    return FORMATS[path.suffix.lower()]
