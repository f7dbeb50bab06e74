"""HDF5 of other programs: any groups and names, units in attributes, tables of pandas, episodes of robomimic."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.recording.array_tables import NamedArray, table_of_arrays
from cutenv.recording.hdf5_file import check_heaps
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError

_UNITS = ("unit", "units", "Unit", "Units", "UNIT")
_NAMES = ("columns", "names", "labels", "channels", "column_names", "channel_names", "fields")
_MOST_BYTES = 1 << 32  # of one dataset


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read an HDF5 file; a dataset is a column, or several, named by its place.

    Raises
    ------
    RecordError
        If it is no such file, or holds no numbers.
    ModuleNotFoundError
        If h5py is not installed; names the pip command.
    """
    h5py = optional_import("h5py", "h5py", "HDF5")
    try:
        check_heaps(path)
        with h5py.File(path, "r") as file:
            arrays = list(_arrays(h5py, file, ""))
    except Exception as error:  # HDF5 raises errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no HDF5 file, or a damaged one ({reason}). Take the file again.") from None
    return table_of_arrays(path, arrays, "HDF5", names)


def _arrays(h5py: Any, group: Any, before: str) -> Iterator[NamedArray]:
    yield from _numbers_among(group.attrs, before)
    if "axis0" in group and any(name.endswith("_values") for name in group):
        yield from _frame(group, before)
        return
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # another file's, or one that would be read twice
        item, place = group[name], f"{before}{name}"
        if isinstance(item, h5py.Group):
            yield from _arrays(h5py, item, f"{place}.")
        elif isinstance(item, h5py.Dataset) and not (item.is_virtual or item.external) and item.nbytes < _MOST_BYTES:
            yield from _dataset(h5py, item, place)


def _dataset(h5py: Any, item: Any, place: str) -> Iterator[NamedArray]:
    yield from _numbers_among(item.attrs, f"{place}.")
    unit = next((_text(item.attrs[key]) for key in _UNITS if isinstance(item.attrs.get(key), str | bytes)), "")
    lists = {key: _texts(item.attrs[key]) for key in item.attrs if key in (*_UNITS, *_NAMES)}
    labels = next((lists[key] for key in _NAMES if key in lists), ())
    units = next((lists[key] for key in _UNITS if len(lists.get(key, ())) > 1), ())
    parts = [item.dtype[name].base for name in item.dtype.names or ()] or [item.dtype]
    if all(part.kind in "fiub" or (part.kind == "S" and item.dtype.names) for part in parts):
        yield NamedArray(place, item[()], unit=unit, names=labels, units=units)
    elif h5py.check_string_dtype(item.dtype) is not None and item.ndim == 1:
        yield NamedArray(place, np.array(item.asstr()[()], dtype=str))


def _frame(group: Any, before: str) -> Iterator[NamedArray]:
    """Yield the columns of a table of pandas, ``to_hdf`` with ``format="fixed"``: blocks of columns of one kind."""
    for name in group:
        if name.endswith("_values"):
            values = group[name][()]
            for k, label in enumerate(_texts(group[name.replace("_values", "_items")][()])):
                yield NamedArray(f"{before}{label}", values[:, k])
    if "axis1" in group and group["axis1"].dtype.kind in "fiu":
        yield NamedArray(f"{before}index", group["axis1"][()])


def _numbers_among(attributes: Mapping[str, Any], before: str) -> Iterator[NamedArray]:
    """Yield attributes that are one number: one of them may be the rate."""
    for name, value in attributes.items():
        if np.size(value) == 1 and np.asarray(value).dtype.kind in "fiu":
            yield NamedArray(f"{before}{name}", np.asarray(value))


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(map(_text, np.asarray(value).reshape(-1).tolist())) if np.size(value) > 1 else (_text(value),)


def _text(value: Any) -> str:
    value = value.reshape(-1)[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
