"""Specimens side by side in a table: the columns of the first are repeated for each of the others."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cutenv.recording.cell_values import CellValues
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.stated_units import known_spelling, split_header

_NUMBERED = re.compile(r"[\s_.:#-]*\(?\d+\)?$|\s*\[\d+\]$")
TIME_NAME = re.compile(r"time|zeit|temps|tiempo|tempo|^t$|elapsed|^x_value$", re.IGNORECASE)
"""Names of columns of time."""


def side_by_side(table: NamedColumns) -> NamedColumns:
    """Return a table with the specimens that stand side by side below one another, each a part; any other as it is."""
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
    """Return the columns of one specimen and the number of specimens; None without a repetition."""
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
    known = known_spelling(table.stated(column))
    return (known is not None and known.quantity == "time") or bool(TIME_NAME.search(_plain(table.headers[column])))


def _plain(header: str) -> str:
    """Return a name without its unit, the run in front of it and the number behind it, in small letters."""
    return _NUMBERED.sub("", split_header(_first_name(header))[0]).strip().lower()


def _first_name(header: str) -> str:
    """Return a header without the run or specimen in front of it: ``Run 1: Force (N)``, ``Latest: Time (s)``."""
    return re.sub(r"^[^:]{1,40}:\s*(?=\S)", "", header)
