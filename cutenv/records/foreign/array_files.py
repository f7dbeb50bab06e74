"""Named arrays of other programs: NumPy, MATLAB, HDF5.

MATLAB from version 5 to 7.3: variables, structures, cells; HDF5 with any groups and names. Nothing is unpickled. Files
of MATLAB are read also as LabChart and AcqKnowledge write them; of HDF5, the units in attributes, tables of pandas and
episodes of robomimic are understood.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.records.foreign.array_tables import NamedArray, below_one_another, table_of_arrays
from cutenv.records.foreign.named_columns import NamedColumns
from cutenv.records.foreign.stated_units import known_spelling
from cutenv.records.hdf5_file import check_heaps
from cutenv.records.schema import refusing_damage

_FEW_TEXTS = 16  # a longer list of text may be a column of times, and not names or units
_LABELS, _VALUES, _UNITS_BESIDE = ("label", "title", "name"), ("values", "data"), ("units", "unit")


class Elements(dict[str, Any]):
    """Elements of a structure or cell array, named by number."""


def named_arrays(content: Mapping[str, Any], before: str = "") -> Iterator[NamedArray]:
    """Yield a structure's numbers with places, names and units.

    In it are, by name, a NamedArray, an ndarray, a list of text, or a mapping of these. A list with an entry for each
    column of a matrix names them, or gives their units. A mapping of a label and its values, as Simulink and Spike2
    have for each channel, is a column. `before` is the place of the structure, with a dot behind it.
    """
    arrays = {
        name: _as_array(name, value) for name, value in content.items() if isinstance(value, np.ndarray | NamedArray)
    }
    lists = {name: tuple(value) for name, value in content.items() if isinstance(value, list) and value}
    vectors = [name for name, array in arrays.items() if array.values.size > 1]
    in_order = next((texts for texts in lists.values() if len(texts) == len(vectors) > 1 and _are_units(texts)), ())
    units = dict(zip(vectors, in_order, strict=False))
    for name, value in content.items():
        if isinstance(value, dict):
            channel = _channel(value)
            if channel is not None:
                yield replace(channel, name=f"{before}{channel.name}")
                yield from (
                    replace(each, name=f"{before}{name}.{each.name}")
                    for each in named_arrays(value)
                    if each.values.size == 1
                )
            else:
                yield from named_arrays(value, before if isinstance(value, Elements) else f"{before}{name}.")
        elif name in arrays:
            array = _labelled(arrays[name], lists)
            unit = array.unit or units.get(name) or _unit_beside(name, content)
            yield replace(array, name=f"{before}{name}", unit=unit)
        elif isinstance(value, list) and len(value) > _FEW_TEXTS:
            yield NamedArray(f"{before}{name}", np.array(value))


def _as_array(name: str, value: Any) -> NamedArray:
    return value if isinstance(value, NamedArray) else NamedArray(name, value)


def _channel(content: Mapping[str, Any]) -> NamedArray | None:
    """Return the channel in a structure of label and values, or None."""
    by_key = {key.lower(): value for key, value in content.items()}
    label = next((value[0] for key in _LABELS if isinstance(value := by_key.get(key), list) and len(value) == 1), "")
    values = next((value for key in _VALUES if isinstance(value := by_key.get(key), np.ndarray | NamedArray)), None)
    array = None if values is None else _as_array(label, values)
    if not label or array is None or array.values.size < 2 or array.values.size != max(array.values.shape):
        return None
    unit = next(
        (value[0] for key in _UNITS_BESIDE if isinstance(value := by_key.get(key), list) and len(value) == 1), ""
    )
    return replace(array, name=label, unit=array.unit or unit)


def _labelled(array: NamedArray, lists: Mapping[str, tuple[str, ...]]) -> NamedArray:
    """Return a matrix with the text lists that label its columns."""
    counts = {count for count in array.values.shape if count > 1} if array.values.ndim == 2 else set()
    fitting = [texts for texts in lists.values() if len(texts) in counts and any(texts)]
    units = next((texts for texts in fitting if _are_units(texts)), ())
    labels = next((texts for texts in fitting if texts != units and len({*texts}) == len(texts)), ())
    return replace(array, names=array.names or labels, units=array.units or units)


def _are_units(texts: Collection[str]) -> bool:
    return all(not text or known_spelling(text) is not None for text in texts)


def _unit_beside(name: str, content: Mapping[str, Any]) -> str:
    """Return a variable's unit from ``force_unit`` or a structure ``units.force``."""
    stem = name.lower()
    called = {f"{stem}_unit", f"{stem}_units", f"{stem}unit", f"{stem}units", f"unit_{stem}", f"units_{stem}"}
    for other, value in content.items():
        if isinstance(value, dict) and other.lower() in _UNITS_BESIDE:
            value = value.get(name)
        elif other.lower() not in called:
            continue
        if isinstance(value, list) and len(value) == 1:
            return str(value[0])
    return ""


def read_numpy(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read an ``.npz`` or ``.npy`` file; RecordError without arrays of numbers."""
    notes: list[str] = []
    content: dict[str, Any] = {}
    with refusing_damage(path, "file of NumPy"):
        found = np.load(path)  # without unpickling, since NumPy 1.16.3
        if isinstance(found, np.ndarray):
            content[""] = NamedArray("", found)
        else:
            with found:
                for name in found.files:
                    try:
                        values = found[name]
                        content[name] = values.reshape(-1).astype(str).tolist() if values.dtype.kind in "US" else values
                    except ValueError:
                        notes.append(f"{name} left out: it holds objects of Python, which are not unpickled")
    return table_of_arrays(path, named_arrays(content), "arrays of NumPy", names, notes)


_VERSION_7_3 = b"MATLAB 7.3"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAX_NESTING = 8  # structures in structures
_LABCHART = {"data", "datastart", "dataend", "titles", "samplerate"}


def read_matlab(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a ``.mat`` file of MATLAB, ``scipy.io.savemat``, LabChart or AcqKnowledge."""
    notes: list[str] = []
    with path.open("rb") as file:
        beginning = file.read(520)
    with refusing_damage(path, "file of MATLAB"):
        is_hdf5 = beginning.startswith(_VERSION_7_3) or _HDF5 in (beginning[:8], beginning[512:])
        content = _hdf5_variables(path, notes) if is_hdf5 else _variables(path, notes)
    if content.keys() >= _LABCHART:
        return _labchart(path, content, notes)
    return table_of_arrays(path, named_arrays(content), "file of MATLAB", names, notes)


def _variables(path: Path, notes: list[str]) -> dict[str, Any]:
    import scipy.io

    found = scipy.io.loadmat(path, chars_as_strings=True)
    return {name: _plain(name, value, notes) for name, value in found.items() if not name.startswith("__")}


def _plain(name: str, value: Any, notes: list[str], depth: int = 0) -> Any:
    """Return scipy's variable as numbers, text lists or mapping, else None."""
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction") or depth > _MAX_NESTING:
        return _object(name, notes)
    if not isinstance(value, np.ndarray):
        return np.asarray(value)
    if value.dtype.names:  # a structure, or several
        parts = {}
        for k, each in enumerate(value.reshape(-1), 1):
            inner = {key: _plain(f"{name}.{key}", each[key], notes, depth + 1) for key in value.dtype.names}
            parts[f"{name}_{k}"] = inner
        return next(iter(parts.values())) if len(parts) == 1 else Elements(parts)
    if value.dtype.kind == "O":  # cells
        cells = [_plain(f"{name}_{k}", each, notes, depth + 1) for k, each in enumerate(value.reshape(-1), 1)]
        return _of_cells(name, cells)
    if value.dtype.kind == "U":
        return [str(each).strip() for each in value.reshape(-1)]
    return value


def _of_cells(name: str, cells: list[Any]) -> list[str] | Elements:
    """Return a cell array as list of its texts, or by number."""
    if all(isinstance(cell, list) and len(cell) <= 1 for cell in cells):
        return [cell[0] if cell else "" for cell in cells]
    return Elements({f"{name}_{k}": cell for k, cell in enumerate(cells, 1)})


def _object(name: str, notes: list[str]) -> None:
    told = f"{name} is a table or an object of MATLAB, which only MATLAB reads: writetable({name}) there"
    if told not in notes:
        notes.append(told)


def _hdf5_variables(path: Path, notes: list[str]) -> dict[str, Any]:
    h5py = optional_import("h5py", "h5py", "A file of MATLAB 7.3", extra="formats")
    with h5py.File(path, "r") as file:
        return {name: _hdf5_plain(h5py, name, file[name], notes) for name in file if not name.startswith("#")}


def _hdf5_plain(h5py: Any, name: str, item: Any, notes: list[str], depth: int = 0) -> Any:
    if "MATLAB_object_decode" in item.attrs or depth > _MAX_NESTING:
        return _object(name, notes)
    if isinstance(item, h5py.Group):
        return {key: _hdf5_plain(h5py, f"{name}.{key}", item[key], notes, depth + 1) for key in item}
    kind = item.attrs.get("MATLAB_class", b"").decode()
    if item.attrs.get("MATLAB_empty", 0):
        return [] if kind in ("char", "cell") else np.zeros(0)
    values = item[()].T  # MATLAB counts columns first
    if kind == "char":
        return ["".join(map(chr, row)).strip() for row in np.atleast_2d(values).astype(int)]
    if values.dtype == h5py.ref_dtype:
        cells = [
            _hdf5_plain(h5py, f"{name}_{k}", item.file[each], notes, depth + 1)
            for k, each in enumerate(values.reshape(-1), 1)
        ]
        return _of_cells(name, cells)
    return values


def _labchart(path: Path, content: Mapping[str, Any], notes: list[str]) -> NamedColumns:
    """Read LabChart's export, one long row with blocks indexed [from 1]."""
    data = np.asarray(content["data"]).reshape(-1)
    titles = content["titles"]
    starts, ends = (content[name].reshape(len(titles), -1).astype(int) for name in ("datastart", "dataend"))
    rates = content["samplerate"].reshape(len(titles), -1)
    units = content.get("unittext") or [""]
    of = content.get("unittextmap", np.ones_like(starts)).reshape(len(titles), -1).astype(int)
    blocks = []
    for block in range(starts.shape[1]):
        there = [k for k in range(len(titles)) if starts[k, block] > 0]
        arrays = [
            NamedArray(
                titles[k],
                data[starts[k, block] - 1 : ends[k, block]],
                unit=units[of[k, block] - 1] if 0 < of[k, block] <= len(units) else "",
            )
            for k in there
        ]
        fastest = max((rates[k, block] for k in there), default=1.0)
        longest = max((each.values.size for each in arrays), default=0)
        slower = [each.name for each in arrays if each.values.size != longest]
        arrays = [_as_often(each, longest) for each in arrays]
        if slower:
            notes.append(f"interpolated, because they were recorded more slowly: {', '.join(slower)}")
        table = table_of_arrays(path, [*arrays, NamedArray("samplerate", np.array([fastest]))], "LabChart's export")
        blocks.append((f"block {block + 1}", table))
    if len(blocks) == 1:
        return replace(blocks[0][1], notes=tuple(notes))
    return below_one_another(path, "LabChart's export", blocks, notes)


def _as_often(array: NamedArray, count: int) -> NamedArray:
    if array.values.size == count:
        return array
    places = np.linspace(0.0, array.values.size, count, endpoint=False)
    return replace(array, values=np.interp(places, np.arange(array.values.size), array.values))


_UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units", "UNIT")
_NAME_ATTRIBUTES = ("columns", "names", "labels", "channels", "column_names", "channel_names", "fields")
_MOST_BYTES = 1 << 32  # of one dataset


def read_hdf5(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read an HDF5 file: a dataset is a column, or several, named by its place."""
    h5py = optional_import("h5py", "h5py", "HDF5")
    with refusing_damage(path, "HDF5 file"):
        check_heaps(path)
        with h5py.File(path, "r") as file:
            content = _content(h5py, file)
    return table_of_arrays(path, named_arrays(content), "HDF5", names)


def _content(h5py: Any, group: Any) -> dict[str, Any]:
    """Return a group's content by name, for :func:`cutenv.records.foreign.array_files.named_arrays`."""
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
    unit = next(
        (_text(item.attrs[key]) for key in _UNIT_ATTRIBUTES if isinstance(item.attrs.get(key), str | bytes)), ""
    )
    lists = {key: _texts(item.attrs[key]) for key in item.attrs if key in (*_UNIT_ATTRIBUTES, *_NAME_ATTRIBUTES)}
    labels = next((lists[key] for key in _NAME_ATTRIBUTES if key in lists), ())
    units = next((lists[key] for key in _UNIT_ATTRIBUTES if len(lists.get(key, ())) > 1), ())
    parts = [item.dtype[part].base for part in item.dtype.names or ()] or [item.dtype]
    if all(part.kind in "fiub" or (part.kind == "S" and item.dtype.names) for part in parts):
        return {name: NamedArray(name, item[()], unit=unit, names=labels, units=units)}
    if h5py.check_string_dtype(item.dtype) is not None and item.ndim <= 1:
        return {name: np.array(item.asstr()[()], dtype=str).reshape(-1).tolist()}
    return {}


def _frame(group: Any) -> dict[str, Any]:
    """Return the columns of a pandas table in fixed HDF5 format."""
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
    """Return the single-number attributes, one of which may be the rate."""
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
