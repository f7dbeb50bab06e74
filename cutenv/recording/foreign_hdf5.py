"""HDF5 of other programs: any groups and names, units in attributes, tables of pandas, episodes of robomimic."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.recording.array_names import named_arrays
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
            content = _content(h5py, file)
    except Exception as error:  # HDF5 raises errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no HDF5 file, or a damaged one ({reason}). Take the file again.") from None
    return table_of_arrays(path, named_arrays(content), "HDF5", names)


def _content(h5py: Any, group: Any) -> dict[str, Any]:
    """Return what a group holds, by name, as :func:`cutenv.recording.array_names.named_arrays` takes it."""
    content = _numbers_among(group.attrs)
    if "axis0" in group and any(name.endswith("_values") for name in group):
        return content | _frame(group)
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # another file's, or one that would be read twice
        item = group[name]
        if isinstance(item, h5py.Group):
            content[name] = _content(h5py, item)
        elif isinstance(item, h5py.Dataset) and not (item.is_virtual or item.external) and item.nbytes < _MOST_BYTES:
            content |= {f"{name}.{key}": value for key, value in _numbers_among(item.attrs).items()}
            content |= _dataset(h5py, item, name)
    return content


def _dataset(h5py: Any, item: Any, name: str) -> dict[str, Any]:
    unit = next((_text(item.attrs[key]) for key in _UNITS if isinstance(item.attrs.get(key), str | bytes)), "")
    lists = {key: _texts(item.attrs[key]) for key in item.attrs if key in (*_UNITS, *_NAMES)}
    labels = next((lists[key] for key in _NAMES if key in lists), ())
    units = next((lists[key] for key in _UNITS if len(lists.get(key, ())) > 1), ())
    parts = [item.dtype[part].base for part in item.dtype.names or ()] or [item.dtype]
    if all(part.kind in "fiub" or (part.kind == "S" and item.dtype.names) for part in parts):
        return {name: NamedArray(name, item[()], unit=unit, names=labels, units=units)}
    if h5py.check_string_dtype(item.dtype) is not None and item.ndim <= 1:
        return {name: np.array(item.asstr()[()], dtype=str).reshape(-1).tolist()}
    return {}


def _frame(group: Any) -> dict[str, Any]:
    """Return the columns of a table of pandas, ``to_hdf`` with ``format="fixed"``: blocks of columns of one kind."""
    found: dict[str, Any] = {}
    for name in group:
        if name.endswith("_values"):
            values = group[name][()]
            labels = _texts(group[name.replace("_values", "_items")][()])
            found |= {label: values[:, k] for k, label in enumerate(labels)}
    if "axis1" in group and group["axis1"].dtype.kind in "fiu":
        found["index"] = group["axis1"][()]
    return found


def _numbers_among(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes that are one number: one of them may be the rate."""
    return {
        name: np.asarray(value)
        for name, value in attributes.items()
        if np.size(value) == 1 and np.asarray(value).dtype.kind in "fiu"
    }


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(map(_text, np.asarray(value).reshape(-1).tolist())) if np.size(value) > 1 else (_text(value),)


def _text(value: Any) -> str:
    value = value.reshape(-1)[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
