"""Records as HDF5: a group for each cut, a dataset with its unit for each field, metadata as JSON."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.recording.columns import header_of
from cutenv.recording.hdf5_integrity import check_integrity
from cutenv.recording.optional_import import optional_import
from cutenv.recording.record_errors import RecordError
from cutenv.recording.schema import SCHEMA, check_schema, mapping_from_json, shortened, to_json
from cutenv.recording.table import CUT_COLUMN, CutTable, parsed_headers, row_from_0
from cutenv.trace import Trace

_VERSIONS = ("v110", "v110")  # oldest HDF5 that can read the file: 1.10, of 2016
_MOST_PACKED = 2000  # greatest ratio of compression: gzip's best is 1032, with shuffling


def write(traces: Sequence[Trace], path: Path) -> None:
    """Write a new file in which everything carries a checksum: numbers, names and the tables that locate them.

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
                _, _, unit = header_of(name, trace.force_unit).partition("_")
                values = getattr(trace, name)
                kept = group.create_dataset(name, data=values, compression="gzip", shuffle=True, fletcher32=True)
                kept.attrs["unit"] = np.bytes_(unit.replace("_", "/"))


def read(path: Path) -> list[CutTable]:
    """Read a file as a table for each cut.

    A file from another program may use any names of groups, or have one cut's datasets at its root; a dataset without
    the attribute ``unit`` has the unit in its name.

    Raises
    ------
    ValueError
        If it is not such a file; the message names group and dataset.
    """
    h5py = optional_import("h5py", "h5py", "HDF5")
    check_integrity(path)
    try:
        with h5py.File(path, "r") as file:
            cuts = _Reader(h5py, path).cuts(file)
            schema, announced = file.attrs.get("schema"), file.attrs.get("cuts")
    except RecordError:
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


@dataclass
class _Cut:
    """Content of a group, before it is checked."""

    name: str
    metadata: Any
    columns: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class _Reader:
    """Reader that takes arrays of numbers out of an open file, and refuses anything else."""

    h5py: Any
    path: Path

    def cuts(self, file: Any) -> list[_Cut]:
        """Return the content of every group, or of the root if the datasets are there; ``cut_10`` follows ``cut_9``."""
        groups = [name for name in file if isinstance(self._member(file, name), self.h5py.Group)]
        if not groups:
            return [self._cut(file, "")]
        if len(groups) < len(file):
            raise self._refusal("it holds datasets beside groups. Put each cut into a group of its own.")
        return [self._cut(file[name], name) for name in sorted(groups, key=_natural)]

    def _cut(self, group: Any, name: str) -> _Cut:
        cut = _Cut(name=name, metadata=group.attrs.get("metadata", "{}"))
        for member in group:
            dataset = self._member(group, member)
            unit = _text(dataset.attrs.get("unit", ""))
            header = f"{member}_{unit}" if unit else member
            if header in cut.columns:
                raise self._refusal(f"{name or 'it'} holds {header} twice, with the unit beside it and in its name.")
            cut.columns[header] = self._numbers(dataset)
        return cut

    def _member(self, group: Any, name: str) -> Any:
        if not isinstance(group.get(name, getlink=True), self.h5py.HardLink):
            raise self._refusal(
                f"{shortened(name)} is a link, perhaps into another file. Copy into it what it points to."
            )
        return group[name]

    def _numbers(self, dataset: Any) -> Array:
        name = shortened(dataset.name)
        if not isinstance(dataset, self.h5py.Dataset):
            raise self._refusal(f"{name} is no dataset. A group of a cut holds datasets only.")
        if dataset.dtype.kind not in "fiu":  # text, references, objects: never unpack them
            raise self._refusal(f"{name} holds {dataset.dtype}, no numbers. Write it as float64.")
        if dataset.ndim != 1:
            raise self._refusal(f"{name} has shape {dataset.shape}. Give one value per instant.")
        if dataset.is_virtual or dataset.external:
            raise self._refusal(f"{name} lies in another file. Copy its values into this one.")
        if dataset.nbytes > _MOST_PACKED * self.path.stat().st_size:
            raise self._refusal(f"{name} announces {dataset.shape[0]} values, more than the file can hold.")
        return np.asarray(dataset[()], dtype=np.float64)

    def _refusal(self, reason: str) -> RecordError:
        return RecordError(self.path, reason)


def _table(cut: _Cut, *, native: bool) -> CutTable:
    """Return one cut as a table; errors name the group."""
    place = f"{cut.name}: " if cut.name else ""
    lengths = {header: len(values) for header, values in cut.columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{header} {length}" for header, length in lengths.items())
        raise ValueError(f"{place}the datasets have different lengths: {listed}. Give one value per instant.")
    try:
        parsed_headers(list(cut.columns))
        if not isinstance(cut.metadata, str | bytes):
            raise ValueError(f"the attribute metadata holds {shortened(cut.metadata)}. Write JSON text.")
        shared = mapping_from_json("metadata", cut.metadata)
    except ValueError as error:
        raise ValueError(f"{place}{error}") from None
    numbers = cut.columns.pop(CUT_COLUMN, None)
    return CutTable(
        name=place,
        headers=tuple(cut.columns),
        values=tuple(cut.columns.values()),
        cut=numbers,
        place=row_from_0,
        native=native,
        shared=shared,
    )


def _text(attribute: object) -> str:
    """Return an attribute as text: HDF5 has several ways to store it."""
    return attribute.decode("utf-8", "replace") if isinstance(attribute, bytes) else str(attribute)


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a sorting key by which numbers count as numbers."""
    parts = re.split(r"([0-9]+)", name)
    return [(int(part), "") if place % 2 else (-1, part) for place, part in enumerate(parts)]
