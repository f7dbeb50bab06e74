"""LabVIEW's binary files, TDMS: a group's channels are columns, with the step and the units of their properties."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.imports import optional_import
from cutenv.recording.array_tables import below_one_another, is_time, seconds
from cutenv.recording.joined_series import Series, joined
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError

_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit", "units", "Units")
_ABOUT = "LabVIEW's TDMS"


class _Channel(NamedTuple):
    """A channel: group, name, unit, values, time of the first value [s], and seconds between two values or 0."""

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


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a ``.tdms`` file.

    The channels of a group are columns. Groups with the same channels are records, one below the other; of groups with
    other channels, the slower ones are interpolated.

    Raises
    ------
    RecordError
        If it is no such file, or holds no numbers.
    ModuleNotFoundError
        If nptdms is not installed; names the pip command.
    """
    nptdms = optional_import("nptdms", "nptdms", "TDMS", extra="formats")
    try:
        content = nptdms.TdmsFile.read(path)
        groups = {group.name: [_channel(group, each) for each in group.channels()] for group in content.groups()}
    except Exception as error:  # the library raises errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no TDMS file, or a damaged one ({reason}). Take the file again.") from None
    filled = {name: [each for each in channels if len(each.values) > 1] for name, channels in groups.items()}
    filled = {name: channels for name, channels in filled.items() if channels}
    if not filled:
        raise RecordError(path, "it holds no channel with numbers. Record the force's channel, too.")
    alike = {tuple(each.name for each in channels) for channels in filled.values()}
    if len(filled) > 1 and len(alike) == 1:
        return below_one_another(path, _ABOUT, [(name, _one(path, each, names)) for name, each in filled.items()], ())
    channels = [each for group in filled.values() for each in group]
    repeated = len({each.name for each in channels}) < len(channels)
    if repeated:
        channels = [each._replace(name=f"{each.group}.{each.name}") for each in channels]
    return _one(path, channels, names)


def _channel(group: Any, channel: Any) -> _Channel:
    stated = {**group.properties, **channel.properties}
    began = channel.properties.get("wf_start_time")
    since = 0.0 if began is None else np.datetime64(began, "us").astype(np.int64) / 1e6
    unit = next((str(stated[key]).strip() for key in _UNITS if str(stated.get(key, "")).strip()), "")
    return _Channel(
        group=group.name,
        name=channel.name,
        unit=re.sub(r"^\((.*)\)$", r"\1", unit),
        values=np.asarray(channel[:]),
        start=since + float(channel.properties.get("wf_start_offset", 0.0)),
        step=float(channel.properties.get("wf_increment", 0.0)),
    )


def _one(path: Path, channels: Sequence[_Channel], names: Collection[str]) -> NamedColumns:
    """Return channels as one table: of one length and step as they are, others at the times of the needed one."""
    if len({(len(each.values), each.step) for each in channels}) == 1:
        return _table(path, channels)
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
                times=inside[0].times if time is None else seconds(_table(path, [time]), 0, told),
                values=np.column_stack([each.values.astype(np.float64) for each in numbers]),
            )
        )
    told += [f"left out, because their times are not known: {', '.join(left)}"] if left else []
    if series:
        return joined(path, series, names, told)
    longest = max(len(each.values) for each in channels)
    same = [each for each in channels if len(each.values) == longest]
    fewer = ", ".join(each.name for each in channels if len(each.values) < longest)
    return replace(_table(path, same), notes=(f"left out, because they have fewer values: {fewer}",))


def _table(path: Path, channels: Sequence[_Channel]) -> NamedColumns:
    pairs = [(each.name, each.values) for each in channels]
    step = 0.0 if any(is_time(*pair) for pair in pairs) else channels[0].step
    units = [each.unit for each in channels]
    return NamedColumns.of(path, pairs, units=units, about=_ABOUT, rate=1.0 / step if step else None)
