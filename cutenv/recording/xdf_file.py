"""Files of LabRecorder, XDF: the streams of the Lab Streaming Layer, with their labels, units and clocks."""

from __future__ import annotations

import logging
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.recording.joined_series import Series, joined
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read a ``.xdf`` file; each channel of a stream is a column, at the times of the stream with the force.

    Raises
    ------
    RecordError
        If it is no such file, or no stream holds numbers.
    ModuleNotFoundError
        If pyxdf is not installed; names the pip command.
    """
    pyxdf = optional_import("pyxdf", "pyxdf", "XDF", extra="formats")
    logging.getLogger("pyxdf").setLevel(logging.ERROR)
    try:
        streams, _ = pyxdf.load_xdf(str(path))
    except Exception as error:  # the library raises errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no XDF file, or a damaged one ({reason}). Take the file again.") from None
    series, notes = [], []
    for stream in streams:
        values, name = stream["time_series"], _first(stream["info"].get("name"))
        if not isinstance(values, np.ndarray) or values.ndim != 2 or len(values) < 2:
            notes.append(f"stream {name!r} left out: it holds text, or nothing")
            continue
        labels = _labels(stream["info"], values.shape[1])
        many = sum(1 for each in streams if isinstance(each["time_series"], np.ndarray)) > 1
        headers = tuple(f"{name}.{label}" if many else label for label in labels)
        series.append(Series(source=name, headers=headers, times=stream["time_stamps"], values=values.astype(float)))
    if not series:
        raise RecordError(path, "none of its streams holds numbers. Record the force's stream, too.")
    return joined(path, series, names, notes)


def _labels(info: Any, count: int) -> list[str]:
    """Return the header of each channel, with the unit that the description gives it."""
    description = _first(info.get("desc")) or {}
    channels = (_first(description.get("channels")) or {}).get("channel") or []
    labels = []
    for k in range(count):
        channel = channels[k] if k < len(channels) else {}
        label, unit = _first(channel.get("label")) or f"channel {k + 1}", _first(channel.get("unit"))
        labels.append(f"{label} [{unit}]" if unit else label)
    return labels


def _first(value: Any) -> Any:
    """Return the first element: pyxdf makes a list of everything."""
    return value[0] if isinstance(value, list) and value else value or ""
