"""Functions that save and load traces, in the format that the suffix names."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from cutenv._base.atomic_file import atomic_write
from cutenv._base.validation import one_of
from cutenv.recording import csv_file, hdf5_file, parquet_file
from cutenv.recording.provenance import check_operator
from cutenv.recording.record_errors import RecordError
from cutenv.recording.table import ALONG_CUT, CutTable, traces_of
from cutenv.trace import Trace


@dataclass(frozen=True, kw_only=True)
class _Format:
    """Writer and reader of a kind of file."""

    name: str
    write: Callable[[Sequence[Trace], Path], None]
    read: Callable[[Path], list[CutTable]]


_CSV = _Format(name="CSV", write=csv_file.write, read=csv_file.read)
_PARQUET = _Format(name="Parquet", write=parquet_file.write, read=parquet_file.read)
_HDF5 = _Format(name="HDF5", write=hdf5_file.write, read=hdf5_file.read)
_FORMATS: Mapping[str, _Format] = MappingProxyType({".csv": _CSV, ".parquet": _PARQUET, ".h5": _HDF5, ".hdf5": _HDF5})

_BEGINNINGS = {
    b"PAR1": "Parquet",
    b"\x89HDF\r\n\x1a\n": "HDF5",
    b"PK\x03\x04": "a zip file or a spreadsheet",
    b"\x1f\x8b": "a gzip file",
    b"\xff\xfe": "text in UTF-16",
    b"\xfe\xff": "text in UTF-16",
}
"""First bytes of other kinds of file."""


def save(traces: Trace | Iterable[Trace], path: str | os.PathLike[str]) -> None:
    """Write one cut or several to one file, so that :func:`load` restores them to the last bit.

    The file is written as a whole or not at all: an interruption leaves the earlier file.

    Parameters
    ----------
    traces : Trace, or iterable of Trace
        At least one.
    path : path
        Its suffix is the format: ``.csv``, ``.parquet``, ``.h5`` or ``.hdf5``.

    Raises
    ------
    TypeError
        If anything but traces is given.
    ValueError
        If there is no trace, or its metadata name an operator who is not anonymous
        (:class:`cutenv.recording.Provenance`).
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
    chosen = _format_of(path)
    with atomic_write(path) as part:
        chosen.write(kept, part)


def load(path: str | os.PathLike[str], *, force: str | None = None) -> list[Trace]:
    """Read every cut of a file.

    Units are in the headers (:data:`cutenv.recording.UNITS`) and are converted to SI. A file from another program needs
    only its row of headers; a column ``cut`` separates several cuts, and its number is kept in the metadata.

    Parameters
    ----------
    path : path
        Its suffix is the format: ``.csv``, ``.parquet``, ``.h5`` or ``.hdf5``.
    force : {"norm", "x", "y", "z", "-x", "-y", "-z"}, optional
        Computation of the force along the cut from components (``force_x_N``, ...). It is positive against forward
        motion: choose the axis along the cut, and the minus if the sensor's sign is reversed. By default the metadata's
        ``force_along_cut``, else the norm; a norm has no sign, so that friction on the way back looks like cutting, and
        nothing that needs a return stroke can be computed from it. A force without an axis is used as it is.

    Returns
    -------
    list of Trace
        Cuts in the order of the file. If the force is from components, the metadata ``force_along_cut`` state how. For
        a record that was interrupted (:class:`cutenv.recording.AppendingRecord`), ``truncated`` is true, and all
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
    chosen = _format_of(path)
    try:
        _check_beginning(path, chosen.name)
        tables = chosen.read(path)
    except (FileNotFoundError, PermissionError, IsADirectoryError, RecordError):
        raise
    except (OSError, ValueError) as error:
        raise RecordError(path, str(error)) from None
    traces = []
    for table in tables:
        try:
            traces += traces_of(table, force)
        except ValueError as error:
            raise RecordError(path, f"{table.name}{error}") from None
    return traces


def load_one(path: str | os.PathLike[str], *, force: str | None = None) -> Trace:
    """Read the cut of a file that holds one; parameters and errors as in :func:`load`.

    Raises
    ------
    RecordError
        Also if the file holds several cuts.
    """
    traces = load(path, force=force)
    if len(traces) != 1:
        raise RecordError(path, f"it holds {len(traces)} cuts. Read them with load() and choose one.")
    return traces[0]


def _format_of(path: Path) -> _Format:
    if path.suffix.lower() not in _FORMATS:
        known = ", ".join(_FORMATS)
        raise RecordError(path, f"its suffix {path.suffix!r} is no format of a record. Use one of {known}.")
    return _FORMATS[path.suffix.lower()]


def _check_beginning(path: Path, name: str) -> None:
    """Raise an error for an empty file, or one whose content is not what its suffix promises."""
    with path.open("rb") as file:
        beginning = file.read(max(map(len, _BEGINNINGS)))
    if not beginning:
        raise RecordError(path, "it is empty. Record or copy it again.")
    for known, what in _BEGINNINGS.items():
        if beginning.startswith(known) and what != name:
            raise RecordError(
                path, f"it is no {name} but {what}. Give it the suffix of what it is, or save it as CSV in UTF-8."
            )
