"""The Lab Streaming Layer.

Cuts sent while they go on, and force streams recorded as cuts while they arrive.

Two streams are sent, and nothing ever comes back. ``SOURCE readings`` (type Force) has a sample each millisecond: force
[N], position [m], speed [m/s], angle [rad], depth [m], in double precision. ``SOURCE markers`` (type Markers) has
``begin NAME`` and ``end CAUSE``.

liblsl finds streams by multicast, which is kept on this machine unless another scope is asked for. Its data sockets,
however, accept connections at every interface of the machine, whatever the scope: a firewall closes them.
"""

from __future__ import annotations

import queue
import socket
import threading
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._base.imports import optional_import
from cutenv._base.validation import one_of
from cutenv.records.appending import AppendingRecord
from cutenv.records.foreign.column_map import ColumnMap
from cutenv.records.foreign.mapped_columns import STAMP, along_cut, columns_in_si
from cutenv.records.foreign.named_columns import NamedColumns
from cutenv.records.schema import RecordError, unit_of
from cutenv.sim.trace import Reading

SCOPES = ("machine", "link", "site")  # reach of a stream: on this machine alone, on its local network, or at its site
_chosen: str | None = None  # a process has one scope: liblsl reads its settings once


def lsl(scope: str | None = None) -> Any:
    """Import pylsl, keeping its streams within a scope at first use.

    A ValueError says that there is no such scope, or that the process has chosen another one before; an OSError that
    liblsl is missing, which comes with pylsl's wheels for usual systems.
    """
    global _chosen
    wanted = "machine" if scope is None else one_of("scope", scope, SCOPES)
    try:
        pylsl = optional_import("pylsl", "pylsl", "The Lab Streaming Layer", extra="streams")
    except RuntimeError as error:
        raise OSError(
            f"pylsl is installed, but not liblsl, which it calls ({str(error).partition('.')[0]}). Install liblsl from "
            "its releases or as conda-forge's liblsl, and set PYLSL_LIB to its file."
        ) from None
    if _chosen is None:
        listen = "ListenAddress = 127.0.0.1\n" if wanted == "machine" else ""  # to those who search for streams
        pylsl.set_config_content(f"[multicast]\nResolveScope = {wanted}\n{listen}[log]\nlevel = -3\n")
        _chosen = wanted
    elif scope is not None and wanted != _chosen:
        raise ValueError(f"scope is {wanted!r}, but this program's streams are kept to {_chosen!r}. Start it again.")
    return pylsl


STREAMED = Reading._fields[1:]  # channels of the stream of readings
_RATE = 1000.0  # readings a second
_LONGEST_WAIT = 2.0  # [s] for what is still to be sent when the outlet is closed


class LslOutlet:
    """Listener that streams the cuts of one source, rig or person.

    A thread of its own talks to liblsl: the caller puts readings into a queue and never waits. `source` stands in front
    of the streams' names; `about` are facts for readers, kept in the description of the stream of readings.
    """

    def __init__(self, source: str, *, scope: str = "machine", about: dict[str, str] | None = None) -> None:
        pylsl = lsl(scope)
        host = socket.gethostname()
        readings = pylsl.StreamInfo(
            f"{source} readings", "Force", len(STREAMED), _RATE, "double64", f"{source} readings on {host}"
        )
        channels = readings.desc().append_child("channels")
        for name in STREAMED:
            channel = channels.append_child("channel")
            channel.append_child_value("label", name)
            channel.append_child_value("unit", unit_of(name).sign)
            channel.append_child_value("type", "Force" if name == "force" else "Motion")
        for name, value in (about or {}).items():
            readings.desc().append_child_value(name, value)
        markers = pylsl.StreamInfo(f"{source} markers", "Markers", 1, 0.0, "string", f"{source} markers on {host}")
        self._readings, self._markers = pylsl.StreamOutlet(readings), pylsl.StreamOutlet(markers)
        self._ahead = pylsl.local_clock() - time.monotonic()
        self._waiting: queue.SimpleQueue[tuple[Array, Any] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._send, name="cutenv lsl", daemon=True)
        self._thread.start()

    def began(self, name: str) -> None:
        """Mark the beginning of a cut."""
        self._mark(f"begin {name}")

    def readings(self, readings: StructArray, depth: Array, origin: float) -> None:
        """Send readings with the depth of cut at each [m].

        Their time was zero at `origin`, by ``time.monotonic()`` [s].
        """
        rows = np.column_stack([*(readings[name] for name in STREAMED[:-1]), depth])
        self._waiting.put((origin + readings["time"], rows))

    def ended(self, cause: str) -> None:
        """Mark the end of a cut and its cause."""
        self._mark(f"end {cause}")

    def close(self) -> None:
        """Send waiting readings and end the streams. Further calls do nothing."""
        self._waiting.put(None)
        self._thread.join(_LONGEST_WAIT)

    def _mark(self, text: str) -> None:
        self._waiting.put((np.array([time.monotonic()]), text))

    def _send(self) -> None:
        while (item := self._waiting.get()) is not None:
            times, content = item
            stamps = (times + self._ahead).tolist()
            if isinstance(content, str):
                self._markers.push_sample([content], stamps[0])
            else:
                self._readings.push_chunk(content.tolist(), stamps)
        del self._readings, self._markers  # which tells liblsl that the streams are over


FIND_WITHIN = 3.0  # time in which a stream must be found [s]
SILENCE = 5.0  # time without a sample after which a stream is over [s]
_UNITS = {"newton": "N", "newtons": "N", "millimeters": "mm", "millimetres": "mm", "meters": "m", "metres": "m"}
_SECOND_LOOK = 0.3  # [s] for a second stream of the same name
_CHUNK = 0.2  # [s] of waiting for samples at a time
_MIN_READINGS = 2  # readings of a record


class LslInlet:
    """Stream of numbers, found by its name or source id, and open.

    Its `headers` are the columns of the time and of each channel, ``label [unit]``; channels without a label are
    ``channel 1`` and so on.
    """

    def __init__(self, name: str, *, scope: str | None = None) -> None:
        self._pylsl = pylsl = lsl(scope)
        chosen = self._found(name)
        if len(chosen) != 1:
            listed = ", ".join(sorted({repr(info.name()) for info in pylsl.resolve_streams(_SECOND_LOOK)})) or "none"
            what = "no stream" if not chosen else f"{len(chosen)} streams"
            raise ValueError(f"there is {what} called {name!r}; found here: {listed}. Give one name or source id.")
        self.name = name
        # Without liblsl's dejitter, which spreads a stall of the sender over the samples before and after it.
        post = pylsl.proc_clocksync | pylsl.proc_monotonize
        self._inlet = pylsl.StreamInlet(chosen[0], max_buflen=60, processing_flags=post)
        info = self._inlet.info(FIND_WITHIN)
        if info.channel_format() == pylsl.cf_string:
            raise ValueError(f"stream {name!r} has text, no numbers. Give a stream of a force sensor.")
        self.headers = (f"{STAMP} [s]", *_labels(info))
        self._inlet.open_stream(FIND_WITHIN)

    def _found(self, name: str) -> list[Any]:
        """Return the streams of that name or source id."""
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
        """Return samples of up to ``seconds``, shape (n, columns): time [s], channels."""
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
    on_reading: Callable[[Reading], None] = lambda newest: None,
) -> int:
    """Record a stream until time or silence ends it; return the number of readings.

    Rows are on the disk (a new .csv) as they come, and an interrupted record can be read. Its time starts at the first
    sample; the mapping's is the stream's own, ``time=stamp``. The metadata ``stream_end`` is "asked", or "silent" if no
    sample has come for :data:`SILENCE`. A sample that is no reading (not finite, out of range, or not later than the
    one before) is a RecordError; the record keeps all before it. `on_reading` is given the newest reading after every
    chunk.
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
                table = NamedColumns.of(
                    path,
                    list(zip(inlet.headers, kept.T, strict=True)),
                    about=inlet.name,
                    row_name="reading",
                    lines=numbers,
                )
                columns, force_unit = columns_in_si(table, mapping, [], guess=False)
                _check_finite(table, mapping)
                if record is None:
                    record = _begun(inlet, path, fields, force_unit)
                readings = _rows(columns, mapping)
                record.append(readings)
                count += len(readings)
                on_reading(readings[-1])
            if len(kept) < len(samples):
                break
    finally:
        if record is not None:
            record.close({"stream_end": end})
    if count < _MIN_READINGS:
        raise RecordError(path, f"stream {inlet.name!r} sent {count} samples, no record. Start its source first.")
    return count


def _begun(inlet: LslInlet, path: Path, fields: list[str], force_unit: str) -> AppendingRecord:
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    facts = {"sensor": f"Lab Streaming Layer: {inlet.name}"[:500], "date": date, "name": path.stem}
    return AppendingRecord(path, facts, fields=fields, force_unit=force_unit)


def _check_finite(table: NamedColumns, mapping: ColumnMap) -> None:
    for field in mapping.fields:
        for name in mapping.expression(field).columns:
            values = table.values(table.index(name))
            for row in np.flatnonzero(~np.isfinite(values))[:1]:
                raise RecordError(
                    table.path,
                    f"reading {table.lines[row]} of {table.about}: {table.header(table.index(name))!r} is {values[row]}"
                    ", no finite number. Leave that column out of the mapping, or repair its source.",
                )


def _rows(columns: dict[str, Array], mapping: ColumnMap) -> list[Reading]:
    force = along_cut(mapping.expression("force"), columns["force"])
    fields = {"force": force, **{name: values[:, 0] for name, values in columns.items() if name != "force"}}
    values = [fields[name].tolist() if name in fields else [None] * len(force) for name in Reading._fields]
    return list(map(Reading._make, zip(*values, strict=True)))


def _labels(info: Any) -> list[str]:
    """Return each channel's label and unit from the description."""
    channel = info.desc().child("channels").child("channel")
    labels = []
    for number in range(1, info.channel_count() + 1):
        label, unit = channel.child_value("label").strip(), channel.child_value("unit").strip()
        known = _UNITS.get(unit.lower(), unit)
        labels.append((label or f"channel {number}") + (f" [{known}]" if known else ""))
        channel = channel.next_sibling("channel")
    return labels
