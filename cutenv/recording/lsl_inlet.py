"""Force streams of the Lab Streaming Layer, recorded as cuts while they arrive."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.recording.appending import AppendingRecord
from cutenv.recording.column_map import ColumnMap
from cutenv.recording.lsl_library import lsl
from cutenv.recording.mapped_columns import MappedReadings
from cutenv.recording.number_table import STAMP, NumberTable
from cutenv.recording.record_errors import RecordError
from cutenv.trace import Reading

FIND_WITHIN = 3.0
"""Time in which a stream must be found [s]."""
SILENCE = 5.0
"""Time without a sample after which a stream is over [s]."""
_UNITS = {"newton": "N", "newtons": "N", "millimeters": "mm", "millimetres": "mm", "meters": "m", "metres": "m"}
_SECOND_LOOK = 0.3  # [s] for a second stream of the same name
_CHUNK = 0.2  # [s] of waiting for samples at a time
_LEAST = 2  # readings of a record


class LslInlet:
    """Stream of numbers, found by its name and open.

    Parameters
    ----------
    name : str
        Name of the stream, or its source id.
    scope : {"machine", "link", "site"}, optional
        Reach of the search; default this machine.

    Attributes
    ----------
    headers : tuple of str
        Column of the time and of each channel, ``label [unit]``; channels without a label are ``channel 1`` and so on.

    Raises
    ------
    ValueError
        If there is no such stream (the message lists those there are), several, or it has no numbers; or as
        :func:`cutenv.recording.lsl_library.lsl`.
    """

    def __init__(self, name: str, *, scope: str | None = None) -> None:
        self._pylsl = pylsl = lsl(scope)
        chosen = self._found(name)
        if len(chosen) != 1:
            listed = ", ".join(sorted({repr(info.name()) for info in pylsl.resolve_streams(_SECOND_LOOK)})) or "none"
            what = "no stream" if not chosen else f"{len(chosen)} streams"
            raise ValueError(f"there is {what} called {name!r}; found here: {listed}. Give one name or source id.")
        self.name = name
        post = pylsl.proc_clocksync | pylsl.proc_dejitter | pylsl.proc_monotonize
        self._inlet = pylsl.StreamInlet(chosen[0], max_buflen=60, processing_flags=post)
        info = self._inlet.info(FIND_WITHIN)
        if info.channel_format() == pylsl.cf_string:
            raise ValueError(f"stream {name!r} has text, no numbers. Give a stream of a force sensor.")
        self.headers = (f"{STAMP} [s]", *_labels(info))
        self._inlet.open_stream(FIND_WITHIN)

    def _found(self, name: str) -> list[Any]:
        """Return the streams of that name, or of that source id."""
        pylsl = self._pylsl
        found: list[Any] = []
        deadline = time.monotonic() + FIND_WITHIN
        for what in ("name", "source_id"):
            if not found:
                left = max(deadline - time.monotonic(), _SECOND_LOOK) if what == "source_id" else 0.7 * FIND_WITHIN
                found = pylsl.resolve_byprop(what, name, 1, left)
            if found:
                return found + [
                    info
                    for info in pylsl.resolve_byprop(what, name, 2, _SECOND_LOOK)
                    if info.uid() not in [other.uid() for other in found]
                ]
        return []

    def pull(self, seconds: float) -> Array:
        """Return the samples of the next ``seconds`` or fewer, shape (n, columns): time [s], channels."""
        samples, stamps = self._inlet.pull_chunk(timeout=seconds, max_samples=4096)
        if not stamps:
            return np.zeros((0, len(self.headers)))
        return np.column_stack([stamps, np.asarray(samples, dtype=np.float64)])

    def close(self) -> None:
        """End the connection; further calls do nothing."""
        self._inlet.close_stream()


def record_stream(
    inlet: LslInlet,
    mapping: ColumnMap,
    path: Path,
    *,
    seconds: float | None = None,
    told: Callable[[Reading], None] = lambda newest: None,
) -> int:
    """Record a stream until a time has passed or it falls silent; return the number of readings.

    Rows are on the disk as they come, and an interrupted record can be read. Its time starts at the first sample. The
    metadata ``stream_end`` is "asked", or "silent" if no sample has come for :data:`SILENCE`.

    Parameters
    ----------
    inlet : LslInlet
        Open stream.
    mapping : ColumnMap
        Which channel is what; its time is the stream's own, ``time=stamp``.
    path : path
        New file, .csv.
    seconds : float, optional
        Duration [s].
    told : callable
        Is given the newest reading after every chunk.

    Raises
    ------
    RecordError
        If a sample is no reading: not finite, out of range, or not later than the one before (the record keeps all
        before it); or if no two samples came.
    """
    fields = [name for name in Reading._fields if name in mapping.fields]
    record: AppendingRecord | None = None
    start, heard, count, end = 0.0, time.monotonic(), 0, "asked"
    try:
        while True:
            samples = inlet.pull(_CHUNK)
            if not len(samples):
                if time.monotonic() - heard > SILENCE:
                    end = "silent"
                    break
                continue
            heard = time.monotonic()
            start = float(samples[0, 0]) if not count else start
            samples[:, 0] -= start
            kept = samples if seconds is None else samples[samples[:, 0] < seconds]
            if len(kept):
                numbers = count + 1 + np.arange(len(kept))
                table = NumberTable.of(path, inlet.name, inlet.headers, kept, numbers)
                mapped = MappedReadings.of(table, mapping, [])
                if record is None:
                    record = _begun(inlet, path, fields, mapped.force_unit)
                readings = _rows(mapped)
                record.append(readings)
                count += len(readings)
                told(readings[-1])
            if len(kept) < len(samples):
                break
    finally:
        if record is not None:
            record.close({"stream_end": end})
    if count < _LEAST:
        raise RecordError(path, f"stream {inlet.name!r} sent {count} samples, no record. Start its source first.")
    return count


def _begun(inlet: LslInlet, path: Path, fields: list[str], force_unit: str) -> AppendingRecord:
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    facts = {"sensor": f"Lab Streaming Layer: {inlet.name}"[:500], "date": date, "name": path.stem}
    return AppendingRecord(path, facts, fields=fields, force_unit=force_unit)


def _rows(mapped: MappedReadings) -> list[Reading]:
    assert mapped.time is not None  # a stream has stamps
    columns = {"time": mapped.time, "force": mapped.along_cut(mapped.force), **mapped.sensed}
    values = [columns[name].tolist() if name in columns else [None] * len(mapped.time) for name in Reading._fields]
    return list(map(Reading._make, zip(*values, strict=True)))


def _labels(info: Any) -> list[str]:
    """Return label and unit of each channel, as the description has them."""
    channel = info.desc().child("channels").child("channel")
    labels = []
    for number in range(1, info.channel_count() + 1):
        label, unit = channel.child_value("label").strip(), channel.child_value("unit").strip()
        known = _UNITS.get(unit.lower(), unit)
        labels.append((label or f"channel {number}") + (f" [{known}]" if known else ""))
        channel = channel.next_sibling("channel")
    return labels
