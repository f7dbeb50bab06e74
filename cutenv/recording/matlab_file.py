"""Files of MATLAB from version 5 to 7.3: variables, structures, cells; also as LabChart and AcqKnowledge write them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.recording.array_names import Elements, named_arrays
from cutenv.recording.array_tables import NamedArray, below_one_another, table_of_arrays
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError

_VERSION_7_3 = b"MATLAB 7.3"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEEPEST = 8  # structures in structures
_LABCHART = {"data", "datastart", "dataend", "titles", "samplerate"}


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a ``.mat`` file.

    Parameters
    ----------
    path : path
        File of ``save`` in MATLAB, of ``scipy.io.savemat``, LabChart or AcqKnowledge.
    names : collection of str
        As in :func:`cutenv.recording.array_tables.table_of_arrays`.

    Raises
    ------
    RecordError
        If it is no such file, or holds no arrays of numbers; also if its only content are objects of MATLAB.
    ModuleNotFoundError
        If h5py is needed and not installed; names the pip command.
    """
    notes: list[str] = []
    with path.open("rb") as file:
        beginning = file.read(520)
    try:
        is_hdf5 = beginning.startswith(_VERSION_7_3) or _HDF5 in (beginning[:8], beginning[512:])
        content = _hdf5_variables(path, notes) if is_hdf5 else _variables(path, notes)
    except (ModuleNotFoundError, RecordError):
        raise
    except Exception as error:  # the libraries raise errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no file of MATLAB, or a damaged one ({reason}). Take the file again.") from None
    if content.keys() >= _LABCHART:
        return _labchart(path, content, notes)
    return table_of_arrays(path, named_arrays(content), "file of MATLAB", names, notes)


def _variables(path: Path, notes: list[str]) -> dict[str, Any]:
    import scipy.io

    found = scipy.io.loadmat(path, chars_as_strings=True)
    return {name: _plain(name, value, notes) for name, value in found.items() if not name.startswith("__")}


def _plain(name: str, value: Any, notes: list[str], depth: int = 0) -> Any:
    """Return a variable of scipy's as numbers, lists of text, or a mapping of those; None for an object of MATLAB."""
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction") or depth > _DEEPEST:
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
        if all(isinstance(cell, list) and len(cell) <= 1 for cell in cells):
            return [cell[0] if cell else "" for cell in cells]
        return Elements({f"{name}_{k}": cell for k, cell in enumerate(cells, 1)})
    if value.dtype.kind == "U":
        return [str(each).strip() for each in value.reshape(-1)]
    return value


def _object(name: str, notes: list[str]) -> None:
    told = f"{name} is a table or an object of MATLAB, which only MATLAB reads: writetable({name}) there"
    if told not in notes:
        notes.append(told)


def _hdf5_variables(path: Path, notes: list[str]) -> dict[str, Any]:
    h5py = optional_import("h5py", "h5py", "A file of MATLAB 7.3", extra="formats")
    with h5py.File(path, "r") as file:
        return {name: _hdf5_plain(h5py, file, name, file[name], notes) for name in file if not name.startswith("#")}


def _hdf5_plain(h5py: Any, file: Any, name: str, item: Any, notes: list[str], depth: int = 0) -> Any:
    if "MATLAB_object_decode" in item.attrs or depth > _DEEPEST:
        return _object(name, notes)
    if isinstance(item, h5py.Group):
        return {key: _hdf5_plain(h5py, file, f"{name}.{key}", item[key], notes, depth + 1) for key in item}
    kind = item.attrs.get("MATLAB_class", b"").decode()
    if item.attrs.get("MATLAB_empty", 0):
        return [] if kind in ("char", "cell") else np.zeros(0)
    values = item[()].T  # MATLAB counts columns first
    if kind == "char":
        return ["".join(map(chr, row)).strip() for row in np.atleast_2d(values).astype(int)]
    if values.dtype == h5py.ref_dtype:
        cells = [
            _hdf5_plain(h5py, file, f"{name}_{k}", file[each], notes, depth + 1)
            for k, each in enumerate(values.reshape(-1), 1)
        ]
        if all(isinstance(cell, list) and len(cell) <= 1 for cell in cells):
            return [cell[0] if cell else "" for cell in cells]
        return Elements({f"{name}_{k}": cell for k, cell in enumerate(cells, 1)})
    return values


def _labchart(path: Path, content: Mapping[str, Any], notes: list[str]) -> NamedColumns:
    """Read LabChart's export: one long row, and where each channel begins and ends in it for each block [from 1]."""
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
