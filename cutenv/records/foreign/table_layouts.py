"""Layouts of text tables without one column per channel.

Time in two columns, specimens side by side, units in a column of their own, one value a row, and channels below one
another, each with its own header, as Igor and Spike2 write them.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.records.foreign.cell_values import CellValues
from cutenv.records.foreign.named_columns import NamedColumns
from cutenv.records.foreign.stated_units import known_spelling, quantity_of, split_header

_SECONDS = re.compile(r"(?:.*[^a-z])?(?:secs?|seconds?|tv_sec)", re.IGNORECASE)
_PARTS = (  # of a second, by the end of the name
    (re.compile(r"(?:.*[^a-z])?(?:n(?:ano)?secs?|nanoseconds?|ns)", re.IGNORECASE), 10**9),
    (re.compile(r"(?:.*[^a-z])?(?:u(?:sec)?s?|micros(?:ec(?:ond)?s?)?)", re.IGNORECASE), 10**6),
    (re.compile(r"(?:.*[^a-z])?(?:m(?:sec)?s?|millis(?:ec(?:ond)?s?)?)", re.IGNORECASE), 10**3),
)


def whole_times(table: NamedColumns) -> NamedColumns:
    """Return a table with a second column's fractions added to seconds."""
    headers = [re.sub(r"(?<=[a-z])(?=[A-Z])", "_", header.strip()) for header in table.headers[: table.n_columns]]
    for k, header in enumerate(headers):
        for j, other in enumerate(headers):
            parts = next((size for pattern, size in _PARTS if pattern.fullmatch(other)), 0)
            if j == k or not parts:
                continue
            seconds, fraction = table.typed(k), table.typed(j).values
            by_clock = seconds.kind in ("clock", "date")
            if not by_clock and not _SECONDS.fullmatch(header):
                continue
            known = fraction[np.isfinite(fraction)]
            whole = seconds.values[np.isfinite(seconds.values)]
            falls = len(known) > 1 and bool((np.diff(known) < 0.0).any())
            if not falls or known.min() < 0.0 or known.max() >= parts or (np.diff(whole) % 1.0).any():
                continue
            return _with_parts(table, k, j, parts)
    return table


def _with_parts(table: NamedColumns, k: int, j: int, parts: int) -> NamedColumns:
    before = table.typed

    def typed(column: int) -> CellValues:
        cells = before(column)
        if column != k:
            return cells
        return replace(cells, values=cells.values - cells.values[0] + before(j).values / parts, unit="s", kind="date")

    note = f"time: {table.header(k)!r} and {table.header(j)!r} together."
    return replace(table, typed=functools.cache(typed), notes=(*table.notes, note))


_NUMBERED = re.compile(r"[\s_.:#-]*\(?\d+\)?$|\s*\[\d+\]$")
TIME_NAME = re.compile(r"time|zeit|temps|tiempo|tempo|^t$|elapsed|^x_value$", re.IGNORECASE)  # names of columns of time


def side_by_side(table: NamedColumns) -> NamedColumns:
    """Return a table with side-by-side specimens stacked as parts."""
    found = _period(table)
    if found is None:
        return table
    period, count = found
    filled = []
    for k in range(count):
        some = [table.values(k * period + column) for column in range(period)]
        filled.append(np.flatnonzero(np.isfinite(some).any(axis=0)))
    filled = [rows for rows in filled if len(rows)]
    if len(filled) < 2:
        return table
    width = table.n_columns
    lengths = [len(rows) for rows in filled]

    def typed(column: int) -> CellValues:
        each = [table.typed(k * period + column) for k in range(len(filled))]
        values = [one.values[rows] + one.origin - each[0].origin for one, rows in zip(each, filled, strict=True)]
        return replace(each[0], values=np.concatenate(values), odd=())

    def text(column: int) -> Sequence[str]:
        each = [table.text(k * period + column) for k in range(len(filled))]
        return [cells[row] for cells, rows in zip(each, filled, strict=True) for row in rows.tolist()]

    names = tuple(f"specimen {k + 1}" for k in range(len(filled)))
    return replace(
        table,
        headers=tuple(_first_name(table.headers[k]) for k in range(period)),
        units=tuple(table.units[:period]),
        n_columns=period,
        lines=np.concatenate([table.lines[rows] for rows in filled]),
        typed=functools.cache(typed),
        text=text,
        parts=np.repeat(np.arange(len(filled)), lengths),
        part_names=names,
        part_starts=(),
        notes=(*table.notes, f"{len(filled)} specimens side by side in {width} columns: a record each."),
    )


def _period(table: NamedColumns) -> tuple[int, int] | None:
    """Return a specimen's columns and the number of specimens, or None."""
    headers = list(table.headers[: table.n_columns])
    if not headers:
        return None
    n = len(headers)
    names = [_plain(header) for header in headers]
    units = [*table.units[:n], *[""] * n][:n]
    for period in range(2, n // 2 + 1):
        count = n // period
        rest = names[count * period :]
        if any(rest) or not any(_is_time(table, k) for k in range(period)):
            continue
        if any(_plain(headers[k]) == _plain(headers[j]) and headers[k] for k in range(period) for j in range(k)):
            continue
        groups = [range(k * period, (k + 1) * period) for k in range(count)]
        same = all(
            names[i] == names[k] or (not headers[i] and not units[i])
            for group in groups[1:]
            for k, i in enumerate(group)
        )
        blank = all(not headers[i] for group in groups[1:] for i in group)
        filled = [bool(headers[k]) for k in range(period)]
        if same and any(filled) and (not blank or all(filled)):
            return period, count
    return None


def _is_time(table: NamedColumns, column: int) -> bool:
    return quantity_of(table.stated(column)) == "time" or bool(TIME_NAME.search(_plain(table.headers[column])))


def _plain(header: str) -> str:
    """Return a lower-case name without unit, run and number."""
    return _NUMBERED.sub("", split_header(_first_name(header))[0]).strip().lower()


def _first_name(header: str) -> str:
    """Return a header without prefix, as of ``Run 1: Force (N)``."""
    return re.sub(r"^[^:]{1,40}:\s*(?=\S)", "", header)


_UNITS = re.compile(r"(?:.*[^a-z])?(?:units?|einheit(?:en)?)", re.IGNORECASE)


def with_unit_columns(table: NamedColumns) -> NamedColumns:
    """Return a table with the units of a column "Units" assigned."""
    headers = table.headers[: table.n_columns]
    units = [*table.units, *[""] * table.n_columns][: table.n_columns]
    behind, found = 0, False
    for k, header in enumerate(headers):
        if not _UNITS.fullmatch(header.strip()) or table.typed(k).kind != "text":
            continue
        said = set(table.text(k))
        if len(said) == 1 and known_spelling(*said) is not None:
            for j in range(behind, k):
                if not table.stated(j) and _is_value(table, j):
                    units[j], found = next(iter(said)), True
        behind = k + 1
    return replace(table, units=tuple(units)) if found else table


def _is_value(table: NamedColumns, k: int) -> bool:
    """Return whether a column holds measured values, not times or numbers."""
    if table.typed(k).kind != "number" or TIME_NAME.search(table.headers[k].strip()):
        return False
    values = table.values(k)
    return not bool((np.diff(values[np.isfinite(values)]) == 1.0).all())


_CHANNEL = re.compile(
    r"force|load|kraft|fuerza|forza|charge|\bf[xyz]?\b|position|displacement|travel|weg", re.IGNORECASE
)
_MOST_CHANNELS = 32


def one_column_a_channel(table: NamedColumns) -> NamedColumns:
    """Return a long table of channels with one column each.

    A column of text is one of channels if it says which of them is a force or a way; of trials it is not.
    """
    if table.n_columns < 3 or len(table.headers) < table.n_columns:
        return table
    texts = [k for k in range(table.n_columns) if table.typed(k).kind == "text"]
    numbers = [k for k in range(table.n_columns) if k not in texts]
    key = next((k for k in texts if _names_channels(table.text(k))), None)
    if key is None:
        return table
    if len(numbers) > 2:
        numbers = [k for k in numbers if _varies_within(table.values(k), np.array(table.text(key)))]
    if len(numbers) != 2:
        return table
    time, value = numbers
    if table.typed(time).kind == "number" and not (np.diff(table.values(time)) >= 0.0).mean() > 0.9:
        time, value = value, time
    channels = np.array(table.text(key))
    names = list(dict.fromkeys(channels.tolist()))
    units = [""] * len(names)
    for other in texts:
        said = np.array(table.text(other))
        each = [set(said[channels == name].tolist()) for name in names]
        state = len(set(said.tolist())) == 1 and known_spelling(str(said[0])) is None  # such as "good"
        if other == key or state:
            continue
        if any(len(of_one) > 1 for of_one in each):
            return table
        units = [of_one.pop() for of_one in each]
    moments, rows = np.unique(table.values(time), return_inverse=True)
    columns = np.full((len(names), len(moments)), np.nan)
    for k, name in enumerate(names):
        here = channels == name
        columns[k, rows[here]] = table.values(value)[here]
    first = np.full(len(moments), len(rows))
    np.minimum.at(first, rows, np.arange(len(rows)))

    def typed(column: int) -> CellValues:
        return replace(table.typed(time), values=moments) if column == 0 else CellValues(values=columns[column - 1])

    def text(column: int) -> Sequence[str]:
        return [f"{each:.9g}" for each in typed(column).values.tolist()]

    return replace(
        table,
        headers=(table.headers[time], *names),
        units=("", *units),
        n_columns=1 + len(names),
        lines=table.lines[first],
        typed=functools.cache(typed),
        text=text,
        parts=None,
        part_names=(),
        notes=(*table.notes, f"{len(names)} channels below one another, by {table.header(key)!r}: a column each."),
    )


def _varies_within(values: Array, channels: NDArray[np.str_]) -> bool:
    """Return whether numbers vary within a channel, as readings do."""
    known = np.isfinite(values)
    each = [values[known & (channels == name)] for name in np.unique(channels)]
    return any(len(of_one) > 0 and np.ptp(of_one) > 0.0 for of_one in each)


def _names_channels(cells: Sequence[str]) -> bool:
    """Return whether cells name channels, including a force or way."""
    names = set(cells)
    if not 1 < len(names) <= _MOST_CHANNELS:
        return False
    told = any(quantity_of(split_header(name)[1]) in ("force", "length") for name in names)
    return told or sum(bool(_CHANNEL.search(re.sub(r"[_\d]", " ", name))) for name in names) > 1


_WAVES = re.compile(r"WAVES\S*\s+(?P<names>.+)", re.IGNORECASE)
_SCALE = re.compile(
    r"SetScale(?P<form>/[PI])?\s+(?P<axis>[xyzd])\s+(?P<numbers>[^\"]*)\"(?P<unit>[^\"]*)\"\s*,\s*(?P<waves>.+)"
)


@dataclass(kw_only=True)
class ChannelBlock:
    """Channels whose values stand in the same lines."""

    names: list[str]  # their names, and their units, "" where the file states none
    units: list[str]
    rows: list[int] = field(default_factory=list)  # places of the lines that hold the values
    step: float | None = None  # time between two values [s]


def igor_blocks(lines: list[str]) -> list[ChannelBlock]:
    """Return an Igor text file's (.itx) waves with ``SetScale``'s scale."""
    blocks: list[ChannelBlock] = []
    inside = False
    for i, line in enumerate(lines):
        text = line.strip()
        if (found := _WAVES.fullmatch(text)) is not None:
            names = [name.strip(" '\"") for name in re.split(r"[\t,]\s*|\s+(?=')", found["names"]) if name.strip()]
            blocks.append(ChannelBlock(names=names, units=[""] * len(names)))
        elif text.upper() in ("BEGIN", "END"):
            inside = text.upper() == "BEGIN"
        elif inside and blocks and text:
            blocks[-1].rows.append(i)
        elif text.startswith("X "):
            for command in text[2:].split(";"):
                _scale(command.strip(), blocks)
    return blocks


def _scale(command: str, blocks: list[ChannelBlock]) -> None:
    """Set step and unit of the waves in an Igor command."""
    found = _SCALE.fullmatch(command)
    if found is None:
        return
    named = {name.strip(" '\"") for name in found["waves"].split(",")}
    numbers = [float(text) for text in found["numbers"].split(",") if text.strip()]
    for block in blocks:
        for k, name in enumerate(block.names):
            if name not in named:
                continue
            if found["axis"] == "x" and found["unit"] == "s" and len(numbers) > 1:
                steps = max(1, len(block.rows) - 1)
                block.step = (numbers[1] - numbers[0]) / steps if found["form"] == "/I" else numbers[1]
            elif found["axis"] in ("y", "d"):
                block.units[k] = found["unit"]


def spike2_blocks(lines: list[str]) -> list[ChannelBlock]:
    """Return the waveforms of Spike2's text output, with begin and step."""
    blocks: list[ChannelBlock] = []
    i = 0
    while i < len(lines):
        if not lines[i].startswith('"CHANNEL"'):
            i += 1
            continue
        head = []
        while i < len(lines) and not lines[i].startswith('"START"'):
            head.append(lines[i].strip().strip('"'))
            i += 1
        if i == len(lines):
            break
        start = lines[i].split("\t")
        told = [text for text in head if text]
        i += 1
        rows = []
        while i < len(lines) and not lines[i].startswith('"'):
            rows += [i] if lines[i].strip() else []
            i += 1
        if len(told) >= 4 and told[1].lower().startswith("waveform") and len(start) > 2:
            blocks.append(ChannelBlock(names=[told[2]], units=[told[3]], rows=rows, step=float(start[2])))
    return blocks


def joined_rows(lines: list[str], blocks: list[ChannelBlock]) -> list[str] | None:
    """Return lines with all channels' values joined to the first block.

    None if their numbers of values or their steps differ.
    """
    if not blocks or len({(len(block.rows), block.step) for block in blocks}) > 1 or not blocks[0].rows:
        return None
    kept = [""] * len(lines)
    for places in zip(*(block.rows for block in blocks), strict=True):
        kept[places[0]] = "\t".join(re.sub(r"[ \t]+", "\t", lines[place].strip()) for place in places)
    return kept
