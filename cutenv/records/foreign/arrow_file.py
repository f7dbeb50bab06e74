"""Parquet, Feather and LeRobot data sets of other programs."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.imports import optional_import
from cutenv.records.foreign.array_tables import NamedArray, table_of_arrays
from cutenv.records.foreign.named_columns import NamedColumns
from cutenv.records.foreign.stated_units import quantity_of
from cutenv.records.schema import refusing_damage

_EPISODE = "episode_index"
_COUNTERS = ("frame_index", "index", "task_index", _EPISODE)  # LeRobot's own numbers, which nobody measures
_INFO = "meta/info.json"


def is_lerobot(path: Path) -> bool:
    """Return whether a path is a LeRobot data set's folder."""
    return (path / _INFO).is_file() and (path / "data").is_dir()


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a Parquet or Feather file, or a LeRobot data set.

    A list in a cell is several columns, named by the data set's ``meta/info.json``, or by its places. A list of lists
    holds several readings of a sensor that is faster than the frames. The rows of an episode (``episode_index``) are a
    record.
    """
    files = sorted((path / "data").rglob("*.parquet")) if path.is_dir() else [path]
    described = next((each for each in (path, *path.parents[:4]) if is_lerobot(each)), None)
    with refusing_damage(path, "file of Arrow"):
        info = json.loads((described / _INFO).read_text(encoding="utf-8")) if described else {}
        features, fps = info.get("features", {}), info.get("fps")
        table = _table(files, features)
    found = {name: _values(table.column(name)) for name in table.column_names}
    columns = {name: values for name, values in found.items() if values is not None}
    odd = [f"{name} ({table.schema.field(name).type})" for name, values in found.items() if values is None]
    notes = [f"left out, because they are no columns of numbers: {', '.join(odd)}"] if odd else []
    episodes = columns.get(_EPISODE)
    if _EPISODE in columns:
        columns = {name: values for name, values in columns.items() if name not in _COUNTERS}
    windows = {name: feature["shape"] for name, feature in features.items() if len(feature.get("shape") or []) == 2}
    if any(name in columns for name in windows):
        columns, episodes = _in_full(columns, windows, episodes, fps)
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema}
    units |= {"timestamp": "s"} if described else {}
    arrays = [_labelled(name, values, features.get(name, {}), units.get(name, "")) for name, values in columns.items()]
    if fps and "timestamp" not in columns:
        arrays.append(NamedArray("fps", np.array([float(fps)])))
    about = "data set of LeRobot" if described else {".parquet": "Parquet"}.get(path.suffix.lower(), "Arrow")
    table = table_of_arrays(path, arrays, about, names, notes, parts=episodes, part_name="episode")
    return _without_copies(table) if described else table


def _table(files: list[Path], features: Mapping[str, Any]) -> Any:
    """Return the files as one table, flattened and without pictures."""
    arrow = optional_import("pyarrow", "pyarrow", "Parquet")
    if files and files[0].suffix.lower() == ".parquet":
        parquet = optional_import("pyarrow.parquet", "pyarrow", "Parquet")
        pictures = {name for name, each in features.items() if each.get("dtype") in ("image", "video")}
        kept = [name for name in parquet.read_schema(files[0]).names if name not in pictures]
        table = arrow.concat_tables([parquet.ParquetFile(file).read(columns=kept, use_threads=False) for file in files])
    else:
        feather = optional_import("pyarrow.feather", "pyarrow", "Feather")
        (file,) = files
        table = feather.read_table(file, memory_map=False, use_threads=False)
    while any(arrow.types.is_struct(kind) for kind in table.schema.types):
        table = table.flatten()
    return table


def _values(column: Any) -> NDArray[Any] | None:
    """Return a column as array of numbers, times or text, or matrix.

    Null among numbers is NaN; a matrix is of lists of one length.
    """
    arrow = optional_import("pyarrow", "pyarrow", "Parquet")
    types, kind = arrow.types, column.type
    if types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        rows = column.combine_chunks() if isinstance(column, arrow.ChunkedArray) else column
        inner = rows.flatten()
        matrix = None if rows.null_count else _values(inner)
        lengths = {*rows.value_lengths().to_pylist()} if not types.is_fixed_size_list(kind) else {kind.list_size}
        if matrix is None or len(lengths) != 1 or matrix.dtype.kind not in "fiub":
            return None
        return matrix.reshape(len(rows), -1)
    if types.is_decimal(kind):
        column, kind = column.cast(arrow.float64()), arrow.float64()
    if types.is_string(kind) or types.is_large_string(kind):
        return np.array(["" if each is None else each for each in column.to_pylist()])
    if types.is_time(kind):
        column = column.cast(arrow.time64("ns")).cast(arrow.int64()).cast(arrow.duration("ns"))
        kind = column.type
    if types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind) or types.is_temporal(kind):
        values = column.to_numpy() if isinstance(column, arrow.ChunkedArray) else column.to_numpy(zero_copy_only=False)
        return np.asarray(values, dtype=np.float64) if values.dtype.kind == "O" else np.asarray(values)
    return None


def _in_full(
    columns: dict[str, NDArray[Any]], windows: Mapping[str, list[int]], episodes: NDArray[Any] | None, fps: Any
) -> tuple[dict[str, NDArray[Any]], NDArray[Any] | None]:
    """Return rows at the fastest sensor's rate; other values are repeated."""
    times = max(windows[name][0] for name in columns if name in windows)
    found = {}
    for name, values in columns.items():
        count = windows[name][0] if name in windows else 1
        each = values.reshape(len(values) * count, -1)
        found[name] = np.repeat(each, times // count, axis=0).squeeze() if times % count == 0 else values[:0]
    if "timestamp" in found and fps:
        part = np.tile(np.arange(times) / (times * float(fps)), len(columns["timestamp"]))
        found["timestamp"] = found["timestamp"].astype(np.float64) + part
    return {name: values for name, values in found.items() if len(values)}, (
        None if episodes is None else np.repeat(episodes, times)
    )


def _labelled(name: str, values: NDArray[Any], feature: Mapping[str, Any], unit: str) -> NamedArray:
    """Return a column with the data set's names and units."""
    stated = {**feature, **(feature.get("info") or {})}
    units = next((stated[key] for key in ("units", "unit") if stated.get(key)), unit)
    count = values.shape[1] if values.ndim == 2 else 1
    labels = tuple(_flat(feature.get("names")))
    return NamedArray(
        name,
        values,
        unit=units if isinstance(units, str) else "",
        names=tuple(f"{name}.{label}" for label in labels) if len(labels) == count else (),
        units=tuple(map(str, units)) if isinstance(units, list) and len(units) == count else (),
    )


def _is_wrench(name: str) -> bool:
    return "wrench" in re.split(r"[._]", name.lower())


def _without_copies(table: NamedColumns) -> NamedColumns:
    """Return columns without forces outside of wrenches: means, limits, copies."""
    kept = [
        k for k, header in enumerate(table.headers) if _is_wrench(header) or quantity_of(table.stated(k)) != "force"
    ]
    left = [header for k, header in enumerate(table.headers) if k not in kept]
    if not left or not any(_is_wrench(header) for header in table.headers):
        return table
    return dataclasses.replace(
        table,
        headers=tuple(table.headers[k] for k in kept),
        units=tuple(table.units[k] for k in kept),
        n_columns=len(kept),
        typed=lambda k: table.typed(kept[k]),
        text=lambda k: table.text(kept[k]),
        notes=(*table.notes, f"left out beside the wrench: {', '.join(left)}"),
    )


def _flat(names: Any) -> Iterator[str]:
    """Yield the names of a LeRobot feature, flattened."""
    if isinstance(names, dict):
        names = [each for value in names.values() for each in _flat(value)]
    for each in names if isinstance(names, list) else []:
        yield from _flat(each) if isinstance(each, list | dict) else [str(each)]
