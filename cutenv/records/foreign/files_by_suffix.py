"""Files of other programs as named columns, by suffix.

LabVIEW's TDMS, LabRecorder's XDF and workbooks of Excel and OpenDocument are read here.
"""

from __future__ import annotations

import dataclasses
import datetime
import gzip
import logging
import re
import shutil
import tempfile
import zlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.imports import optional_import
from cutenv.records.foreign import array_files, arrow_file, ros_bag
from cutenv.records.foreign.array_tables import Series, below_one_another, is_time, joined, seconds
from cutenv.records.foreign.named_columns import NamedColumns
from cutenv.records.foreign.ros_bag import BAGS, is_bag
from cutenv.records.foreign.text_tables import sniff_table
from cutenv.records.schema import RecordError, refusing_damage

_TDMS_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit", "units", "Units")
_TDMS = "LabVIEW's TDMS"


class _Channel(NamedTuple):
    """Channel: group, name, unit, values, start [s], and step [s] or 0."""

    group: str
    name: str
    unit: str
    values: NDArray[Any]
    start: float
    step: float

    @property
    def times(self) -> Array:
        """Times of the values by start and step [s]."""
        return self.start + self.step * np.arange(len(self.values), dtype=np.float64)


def read_tdms(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a ``.tdms`` file.

    The channels of a group are columns. Groups with the same channels are records, one below the other; of groups with
    other channels, the slower ones are interpolated.
    """
    nptdms = optional_import("nptdms", "nptdms", "TDMS", extra="formats")
    with refusing_damage(path, "TDMS file"):
        content = nptdms.TdmsFile.read(path)
        groups = {group.name: [_channel(group, each) for each in group.channels()] for group in content.groups()}
    filled = {name: [each for each in channels if len(each.values) > 1] for name, channels in groups.items()}
    filled = {name: channels for name, channels in filled.items() if channels}
    if not filled:
        raise RecordError(path, "it holds no channel with numbers. Record the force's channel, too.")
    alike = {tuple(each.name for each in channels) for channels in filled.values()}
    if len(filled) > 1 and len(alike) == 1:
        return below_one_another(
            path, _TDMS, [(name, _tdms_record(path, each, names)) for name, each in filled.items()], ()
        )
    channels = [each for group in filled.values() for each in group]
    repeated = len({each.name for each in channels}) < len(channels)
    if repeated:
        channels = [each._replace(name=f"{each.group}.{each.name}") for each in channels]
    return _tdms_record(path, channels, names)


def _channel(group: Any, channel: Any) -> _Channel:
    stated = {**group.properties, **channel.properties}
    began = channel.properties.get("wf_start_time")
    since = 0.0 if began is None else np.datetime64(began, "us").astype(np.int64) / 1e6
    unit = next((str(stated[key]).strip() for key in _TDMS_UNITS if str(stated.get(key, "")).strip()), "")
    return _Channel(
        group=group.name,
        name=channel.name,
        unit=re.sub(r"^\((.*)\)$", r"\1", unit),
        values=np.asarray(channel[:]),
        start=since + float(channel.properties.get("wf_start_offset", 0.0)),
        step=float(channel.properties.get("wf_increment", 0.0)),
    )


def _tdms_record(path: Path, channels: Sequence[_Channel], names: Collection[str]) -> NamedColumns:
    """Return channels as one table, interpolated to the needed one's times."""
    if len({(len(each.values), each.step) for each in channels}) == 1:
        return _tdms_table(path, channels)
    series: list[Series] = []
    told: list[str] = []
    left: list[str] = []
    for group in {(each.group, len(each.values), each.step): None for each in channels}:
        inside = [each for each in channels if (each.group, len(each.values), each.step) == group]
        time = next((each for each in inside if is_time(each.name, each.values)), None)
        numbers = [each for each in inside if each is not time and each.values.dtype.kind in "fiu"]
        if not numbers or (time is None and not inside[0].step):
            left += [each.name for each in inside]
            continue
        series.append(
            Series(
                source=group[0],
                headers=tuple(f"{each.name} [{each.unit}]" if each.unit else each.name for each in numbers),
                times=inside[0].times if time is None else seconds(_tdms_table(path, [time]), 0, told),
                values=np.column_stack([each.values.astype(np.float64) for each in numbers]),
            )
        )
    told += [f"left out, because their times are not known: {', '.join(left)}"] if left else []
    if series:
        return joined(path, series, names, told)
    longest = max(len(each.values) for each in channels)
    same = [each for each in channels if len(each.values) == longest]
    fewer = ", ".join(each.name for each in channels if len(each.values) < longest)
    return replace(_tdms_table(path, same), notes=(f"left out, because they have fewer values: {fewer}",))


def _tdms_table(path: Path, channels: Sequence[_Channel]) -> NamedColumns:
    pairs = [(each.name, each.values) for each in channels]
    step = 0.0 if any(is_time(*pair) for pair in pairs) else channels[0].step
    units = [each.unit for each in channels]
    return NamedColumns.of(path, pairs, units=units, about=_TDMS, rate=1.0 / step if step else None)


def read_xdf(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a ``.xdf`` file: each stream's channels, at the force's times."""
    pyxdf = optional_import("pyxdf", "pyxdf", "XDF", extra="formats")
    logging.getLogger("pyxdf").setLevel(logging.ERROR)
    with refusing_damage(path, "XDF file"):
        streams, _ = pyxdf.load_xdf(str(path))
    series, notes = [], []
    for stream in streams:
        values, name = stream["time_series"], _first_value(stream["info"].get("name"))
        if not isinstance(values, np.ndarray) or values.ndim != 2 or len(values) < 2:
            notes.append(f"stream {name!r} left out: it holds text, or nothing")
            continue
        labels = _stream_labels(stream["info"], values.shape[1])
        many = sum(1 for each in streams if isinstance(each["time_series"], np.ndarray)) > 1
        headers = tuple(f"{name}.{label}" if many else label for label in labels)
        series.append(Series(source=name, headers=headers, times=stream["time_stamps"], values=values.astype(float)))
    if not series:
        raise RecordError(path, "none of its streams holds numbers. Record the force's stream, too.")
    return joined(path, series, names, notes)


def _stream_labels(info: Any, count: int) -> list[str]:
    """Return each channel's header, with the description's unit."""
    description = _first_value(info.get("desc")) or {}
    channels = (_first_value(description.get("channels")) or {}).get("channel") or []
    labels = []
    for k in range(count):
        channel = channels[k] if k < len(channels) else {}
        label, unit = _first_value(channel.get("label")) or f"channel {k + 1}", _first_value(channel.get("unit"))
        labels.append(f"{label} [{unit}]" if unit else label)
    return labels


def _first_value(value: Any) -> Any:
    """Return the first element of pyxdf's lists."""
    return value[0] if isinstance(value, list) and value else value or ""


WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
_OLD_EXCEL = b"\xd0\xcf\x11\xe0"  # first bytes of an Excel workbook before 2007
_FEWEST_ROWS = 10  # rows of a table that is a record beside longer ones, and no list of results


def is_workbook(path: Path) -> bool:
    """Return whether a file is a workbook; ``.xls`` by its content."""
    if path.suffix.lower() != ".xls":
        return path.suffix.lower() in WORKBOOKS
    with path.open("rb") as file:
        return file.read(4) in (_OLD_EXCEL, b"PK\x03\x04")


def read_workbook(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a workbook's tables; `names` has no effect.

    The longest is read, and below it every other with the same columns: testing machines write a sheet for each
    specimen.
    """
    calamine = optional_import("python_calamine", "python_calamine", "A workbook", extra="formats")
    with refusing_damage(path, "workbook", "Save it again."):
        workbook = calamine.CalamineWorkbook.from_path(str(path))
        found = {name: workbook.get_sheet_by_name(name) for name in workbook.sheet_names}
        sheets = {name: sheet.to_python(skip_empty_area=False) for name, sheet in found.items()}
    tables, empty = {}, {}
    for name, rows in sheets.items():
        lines = ["\t".join(map(_cell_text, row)).rstrip() for row in rows]
        try:
            tables[name] = replace(sniff_table(path, lines), row_name="row", about=f"sheet {name!r}")
        except RecordError as error:
            empty[name] = error.reason
    if not tables:
        told = "; ".join(f"{name!r}: {reason}" for name, reason in empty.items())
        raise RecordError(path, f"none of its sheets holds a table of numbers. {told}")
    main = max(tables, key=lambda name: len(tables[name]))
    alike = {
        name: table
        for name, table in tables.items()
        if name == main or (table.headers == tables[main].headers and len(table) >= _FEWEST_ROWS)
    }
    others = [repr(name) for name in sheets if name not in alike and sheets[name]]
    notes = [f"sheets that are left out: {', '.join(others)}"] if others else []
    if len(alike) == 1:
        return replace(tables[main], notes=(*tables[main].notes, *notes))
    return below_one_another(path, f"{len(alike)} sheets", list(alike.items()), notes)


def _cell_text(cell: Any) -> str:
    if isinstance(cell, float):
        return f"{cell:.0f}" if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.datetime | datetime.time):
        return cell.isoformat(sep=" ") if isinstance(cell, datetime.datetime) else cell.isoformat()
    return " ".join(str(cell).replace('"', "\u2033").split())


_Reader = Callable[[Path, Collection[str]], NamedColumns]
_READERS: dict[str, _Reader] = {
    **dict.fromkeys(BAGS, ros_bag.bag_table),
    **dict.fromkeys((".parquet", ".feather", ".arrow"), arrow_file.read),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), array_files.read_hdf5),
    ".mat": array_files.read_matlab,
    **dict.fromkeys((".npz", ".npy"), array_files.read_numpy),
    ".tdms": read_tdms,
    **dict.fromkeys((".xdf", ".xdfz"), read_xdf),
}
FOREIGN_SUFFIXES = (*_READERS, *WORKBOOKS)  # suffixes of the formats that are no text
PACKED = ".gz"


def is_text(path: Path) -> bool:
    """Return whether a path is text, by its unpacked suffix."""
    return _reader(Path(path.stem) if path.suffix.lower() == PACKED else path) is None


def is_record_folder(path: Path) -> bool:
    """Return whether a folder is one record: ROS 2 bag or LeRobot."""
    return path.is_dir() and (is_bag(path) or arrow_file.is_lerobot(path))


def foreign_columns(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a foreign file's or folder's columns, also if packed with gzip.

    `names` are the columns that are needed, that of the force first; it matters where series with clocks of their own
    are joined.
    """
    if path.suffix.lower() == PACKED and path.is_file():
        return _unpacked(path, names)
    reader = _reader(path)
    return sniff_table(path) if reader is None else reader(path, names)


def _reader(path: Path) -> _Reader | None:
    if path.is_dir():
        return ros_bag.bag_table if is_bag(path) else arrow_file.read if arrow_file.is_lerobot(path) else None
    if path.is_file() and is_workbook(path):
        return read_workbook
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
