"""Records as HDF5.

A group for each cut, a dataset with its unit for each field, metadata as JSON.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.imports import optional_import
from cutenv.records.schema import SCHEMA, check_schema, mapping_from_json, shortened, to_json, unit_of
from cutenv.records.table import CutTable, row_from_0
from cutenv.sim.trace import Trace

_VERSIONS = ("v110", "v110")  # oldest HDF5 that can read the file: 1.10, of 2016
_MOST_PACKED = 2000  # greatest ratio of compression: gzip's best is 1032, with shuffling
_HEAP = b"GCOL\x01\x00\x00\x00"  # signature of a global heap collection, version 1
_HEAP_HEADER = 16  # bytes in the header of a collection, and of each object


def write(traces: Sequence[Trace], path: Path) -> None:
    """Write a new file with checksums of numbers, names and tables.

    In files of HDF5 before 1.10, h5py's default, the tables have no checksum, and the library loops for ever if they
    are damaged. Text is of fixed length, because text of variable length is stored without a checksum.
    """
    h5py = optional_import("h5py", "h5py", "HDF5")
    with h5py.File(path, "w", libver=_VERSIONS) as file:
        file.attrs["schema"] = np.bytes_(SCHEMA)
        file.attrs["cuts"] = len(traces)
        for number, trace in enumerate(traces):
            group = file.create_group(f"cut_{number}")
            group.attrs["metadata"] = np.bytes_(to_json(trace.metadata))
            for name in trace.known:
                values = getattr(trace, name)
                kept = group.create_dataset(name, data=values, compression="gzip", shuffle=True, fletcher32=True)
                kept.attrs["unit"] = np.bytes_(unit_of(name, trace.force_unit).sign)


def read(path: Path) -> list[CutTable]:
    """Read a file as a table for each cut.

    A file from another program may use any names of groups, or have one cut's datasets at its root; a dataset without
    the attribute ``unit`` has the unit in its name. A ValueError names group and dataset at fault.
    """
    h5py = optional_import("h5py", "h5py", "HDF5")
    check_heaps(path)
    try:
        with h5py.File(path, "r") as file:
            cuts = _cuts(h5py, file)
            schema, announced = file.attrs.get("schema"), file.attrs.get("cuts")
    except _Refused:
        raise
    except Exception as error:  # HDF5 raises errors of any kind for a damaged file
        reason = shortened(str(error) or type(error).__name__)
        raise ValueError(f"it is no HDF5 file, or a damaged one ({reason}). Take the file again.") from None
    if schema is not None:
        check_schema(_text(schema))
        if not np.array_equal(announced, len(cuts)):
            raise ValueError(
                f"it announces {shortened(str(announced))} cuts and holds {len(cuts)}. Take the whole file again."
            )
    return [_table(cut, native=schema is not None) for cut in cuts]


class _Refused(ValueError):
    """Content of an intact file that is no record."""


class _Cut(NamedTuple):
    """Name and content of a group, unchecked."""

    name: str
    metadata: Any
    columns: dict[str, Array]


def _cuts(h5py: Any, file: Any) -> list[_Cut]:
    """Return the number arrays of every group or root, naturally sorted."""
    groups = [name for name in file if isinstance(_member(h5py, file, name), h5py.Group)]
    if groups and len(groups) < len(file):
        raise _Refused("it holds datasets beside groups. Put each cut into a group of its own.")
    cuts = []
    for name in sorted(groups, key=_natural) or [""]:
        group = file[name] if name else file
        columns: dict[str, Array] = {}
        for member in group:
            dataset = _member(h5py, group, member)
            unit = _text(dataset.attrs.get("unit", ""))
            header = f"{member}_{unit}" if unit else member
            if header in columns:
                raise _Refused(f"{name or 'it'} holds {header} twice, with the unit beside it and in its name.")
            columns[header] = _numbers(h5py, dataset)
        cuts.append(_Cut(name, group.attrs.get("metadata", "{}"), columns))
    return cuts


def _member(h5py: Any, group: Any, name: str) -> Any:
    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        raise _Refused(f"{shortened(name)} is a link, perhaps into another file. Copy into it what it points to.")
    return group[name]


def _numbers(h5py: Any, dataset: Any) -> Array:
    name = shortened(dataset.name)
    if not isinstance(dataset, h5py.Dataset):
        raise _Refused(f"{name} is no dataset. A group of a cut holds datasets only.")
    if dataset.dtype.kind not in "fiu":  # text, references, objects: never unpack them
        raise _Refused(f"{name} holds {dataset.dtype}, no numbers. Write it as float64.")
    if dataset.ndim != 1:
        raise _Refused(f"{name} has shape {dataset.shape}. Give one value per instant.")
    if dataset.is_virtual or dataset.external:
        raise _Refused(f"{name} lies in another file. Copy its values into this one.")
    if dataset.nbytes > _MOST_PACKED * Path(dataset.file.filename).stat().st_size:
        raise _Refused(f"{name} announces {dataset.shape[0]} values, more than the file can hold.")
    return np.asarray(dataset[()], dtype=np.float64)


def _table(cut: _Cut, *, native: bool) -> CutTable:
    """Return one cut as a table; errors name the group."""
    place = f"{cut.name}: " if cut.name else ""
    lengths = {header: len(values) for header, values in cut.columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{header} {length}" for header, length in lengths.items())
        raise ValueError(f"{place}the datasets have different lengths: {listed}. Give one value per instant.")
    try:
        if not isinstance(cut.metadata, str | bytes):
            raise ValueError(f"the attribute metadata holds {shortened(cut.metadata)}. Write JSON text.")
        shared = mapping_from_json("metadata", cut.metadata)
        return CutTable.of(
            list(cut.columns), list(cut.columns.values()), name=place, place=row_from_0, native=native, shared=shared
        )
    except ValueError as error:
        raise ValueError(f"{place}{error}") from None


def _text(attribute: object) -> str:
    """Return an attribute as text, however HDF5 stores it."""
    return attribute.decode("utf-8", "replace") if isinstance(attribute, bytes) else str(attribute)


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key for natural sorting of numbers."""
    parts = re.split(r"([0-9]+)", name)
    return [(int(part), "") if place % 2 else (-1, part) for place, part in enumerate(parts)]


def check_heaps(path: Path) -> None:
    """Raise ValueError for heaps with objects outside, or pointing to themselves.

    Text of variable length, which other programs use for attributes, is stored in heaps without a checksum. A length of
    zero makes libhdf5 (as late as 2.0) read the same place for ever. The files of :func:`write` have no heaps.
    HDF5 File Format Specification 3.0, section III.E: each object is an index (0 for free space), a count, 4 reserved
    bytes, and the length of the data that follows, padded to a multiple of 8; free space includes its header.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.find(_HEAP)
        while start >= 0:
            end = start + int.from_bytes(content[start + 8 : start + 16], "little")
            place = start + _HEAP_HEADER if end <= len(content) else end + 1
            while place + _HEAP_HEADER <= end:
                length = int.from_bytes(content[place + 8 : place + 16], "little")
                is_free = content[place : place + 2] == b"\x00\x00"
                taken = length if is_free else _HEAP_HEADER + (length + 7) // 8 * 8
                place += taken if taken >= _HEAP_HEADER else end
            if place > end:
                raise ValueError("it is a damaged HDF5 file: its text is not to be read. Take the file again.")
            start = content.find(_HEAP, start + 1)
