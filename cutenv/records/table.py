"""Columns of a record's file.

The common form into which every format is read, and from which traces are made.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.schema import AXES, UNITS, Column, header_of, parse_header
from cutenv.sim.trace import CHANNELS, COMPONENTS_OF_FORCE, Trace, limits

CUT_COLUMN = "cut"  # name of the column with the number of the cut

ALONG_KEY = "force_along_cut"
"""Key in the metadata: computation of the force along the cut from its components, one of :data:`ALONG_CUT`."""

ALONG_CUT = ("norm", "x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True, kw_only=True)
class CutTable:
    """Columns with a row per reading, one cut after another."""

    headers: tuple[str, ...]  # headers of the columns, except the cut's
    columns: tuple[Column, ...]
    values: tuple[Array, ...]  # values in the units that the headers name, shape (n,)
    cut: Array | None  # number of the cut of each row; None if there is only one cut, shape (n,)
    place: Callable[[int], str]  # maps a row to its place in the file, such as "line 17"
    native: bool = False  # true if cutenv wrote the file, as its schema shows; cuts are then counted from 0
    shared: Mapping[str, Any] = field(default_factory=dict)  # metadata of all cuts
    own: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)  # metadata by the number of the cut
    # headers of the columns that a cut holds, by its number; its others are NaN. All columns if it is missing
    held: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    name: str = ""  # text in front of every message about it, such as "cut_3: ", if a file holds several tables

    @classmethod
    def of(
        cls, names: Sequence[str], values: Sequence[Array], columns: Sequence[Column | None] | None = None, **facts: Any
    ) -> CutTable:
        """Make a table of raw columns; raises as :func:`parsed_headers`."""
        parsed = list(zip(columns or parsed_headers(names), names, values, strict=True))
        kept = [(column, name, held) for column, name, held in parsed if column is not None]
        return cls(
            headers=tuple(name for _, name, _ in kept),
            columns=tuple(column for column, _, _ in kept),
            values=tuple(held for _, _, held in kept),
            cut=next((held for column, _, held in parsed if column is None), None),
            **facts,
        )


def row_from_0(row: int) -> str:
    """Return a row's place in a file without lines."""
    return f"row {row} (the first is 0)"


def table_of(traces: Sequence[Trace]) -> CutTable:
    """Make one table of traces, NaN where a column is missing."""
    headers_of = [tuple(header_of(name, trace.force_unit) for name in trace.known) for trace in traces]
    any_of = dict.fromkeys(itertools.chain.from_iterable(headers_of))
    headers = tuple(
        header
        for name in (*UNITS, *CHANNELS)
        for header in dict.fromkeys((header_of(name), header_of(name, "1")))
        if header in any_of
    )
    nothing = [np.full(len(trace), np.nan) for trace in traces]
    columns = tuple(map(parse_header, headers))
    values = [
        np.concatenate(
            [
                getattr(trace, column.of_trace) if header in holds else nan
                for trace, holds, nan in zip(traces, headers_of, nothing, strict=True)
            ]
        )
        for header, column in zip(headers, columns, strict=True)
    ]
    alike = all(trace.metadata == traces[0].metadata for trace in traces)
    return CutTable(
        headers=headers,
        columns=columns,
        values=tuple(values),
        cut=np.repeat(np.arange(float(len(traces))), [len(trace) for trace in traces]) if len(traces) > 1 else None,
        place=row_from_0,
        native=True,
        shared=traces[0].metadata if alike else {},
        own={} if alike else {number: trace.metadata for number, trace in enumerate(traces) if trace.metadata},
        held={number: holds for number, holds in enumerate(headers_of) if holds != headers},
    )


def parsed_headers(names: Sequence[str]) -> list[Column | None]:
    """Parse columns' quantities and units, None for the cut number."""
    columns = [None if name == CUT_COLUMN else parse_header(name) for name in names]
    for said, count in Counter(map(_said, columns)).items():
        if count > 1:
            twins = [repr(name) for name, column in zip(names, columns, strict=True) if _said(column) == said]
            raise ValueError(f"columns {' and '.join(twins)} have the same meaning. Keep one of them.")
    fields = {column.field for column in columns if column}
    missing = [f"{header_of(name)} (or {name} in another unit)" for name in ("time", "force") if name not in fields]
    if missing:
        raise ValueError(f"it has no column {' and no '.join(missing)}; it has {', '.join(names) or 'none'}. Add it.")
    return columns


def traces_of(table: CutTable, force: str | None = None) -> list[Trace]:
    """Make a trace of every cut in a table; `force` as in :func:`cutenv.records.load`."""
    if not table.values[0].size:
        raise ValueError("it holds no readings, only names of columns.")
    blocks = _blocks(table)
    numbers = {number for number, _ in blocks}
    for what, known in (("metadata", table.own), ("columns", table.held)):
        if unknown := sorted(set(known) - numbers):
            raise ValueError(f"it names {what} of cut {unknown[0]}, but holds no such cut: it is not whole.")
    labelled = table.cut is not None
    traces = []
    for number, rows in blocks:
        metadata = {**table.shared, **table.own.get(number, {})}
        if labelled and not table.native:
            metadata.setdefault(CUT_COLUMN, number)
        holds = table.held.get(number, table.headers)
        if unknown_names := [name for name in holds if name not in table.headers]:
            raise ValueError(f"cut {number} is said to hold {unknown_names[0]!r}, which is no column. Save it again.")
        parts: dict[str, tuple[Column, Array]] = {}
        for header, column, values in zip(table.headers, table.columns, table.values, strict=True):
            if header in holds:
                parts[header] = (column, values[rows])
            elif not np.isnan(values[rows]).all():
                raise ValueError(f"cut {number} holds {header!r}, but is said not to hold it. Save it again.")
        where = _Where(table, rows, f"cut {number}, " if labelled else "")
        if len(parts) < len(table.headers):
            try:
                parsed_headers(list(parts))
            except ValueError as error:
                raise ValueError(f"cut {number}: {error}") from None
        traces.append(_trace(parts, metadata, force, where))
    return traces


@dataclass(frozen=True)
class _Where:
    """Map from a cut's instant to its place in the file."""

    table: CutTable
    rows: slice
    cut: str

    def __call__(self, instant: int) -> str:
        return f"{self.cut}{self.table.place(self.rows.start + instant)}"


def _blocks(table: CutTable) -> list[tuple[int, slice]]:
    """Return number and rows of each cut."""
    n = len(table.values[0])
    if table.cut is None:
        return [(0, slice(0, n))]
    for row in np.flatnonzero(~((table.cut >= 0) & (table.cut <= 2**53) & (table.cut == np.floor(table.cut))))[:1]:
        raise ValueError(
            f"{table.place(int(row))}: the column 'cut' holds {table.cut[row]:g}. Number the cuts 0, 1, 2, ..."
        )
    borders = [0, *(np.flatnonzero(np.diff(table.cut)) + 1).tolist(), n]
    blocks: list[tuple[int, slice]] = []
    seen = set()
    for start, stop in itertools.pairwise(borders):
        number = int(table.cut[start])
        if number in seen:
            raise ValueError(
                f"{table.place(start)}: cut {number} goes on here, after another cut. Put the rows of a cut together."
            )
        if table.native and number != len(blocks):
            raise ValueError(
                f"{table.place(start)}: cut {number} begins here, but cut {len(blocks)} is the next: rows are missing "
                "or were moved. Take the whole file again."
            )
        seen.add(number)
        blocks.append((number, slice(start, stop)))
    return blocks


def _trace(
    parts: Mapping[str, tuple[Column, Array]], metadata: dict[str, Any], force: str | None, where: _Where
) -> Trace:
    """Make a trace of the rows of one cut."""
    fields: dict[str, Array] = {}
    components: dict[str, Array] = {}
    all_six = {column.of_trace for column, _ in parts.values()}.issuperset(COMPONENTS_OF_FORCE)
    for header, (column, values) in parts.items():
        _check_finite(header, values, where)
        with np.errstate(over="ignore", under="ignore"):  # infinite values are refused as out of range below
            si = column.to_si(values)
        if column.axis and column.field == "force":
            components[column.axis] = si
        if all_six or column.of_trace not in COMPONENTS_OF_FORCE:
            fields[column.of_trace] = si
    _check_time(fields["time"], where)
    units = {column.force_unit for column, _ in parts.values()} - {None}
    if len(units) > 1:
        raise ValueError("it has a force in newtons and one without a unit. Keep one of them.")
    force_unit = "1" if units == {"1"} else "N"
    if components and (force is not None or "force" not in fields):
        chosen = force if force is not None else metadata.get(ALONG_KEY, "norm")
        fields["force"] = _along_cut(components, chosen)
        metadata[ALONG_KEY] = chosen
    elif force is not None:
        raise ValueError(f"force={force!r} asks for components of the force, of which it holds none. Leave force= out.")
    try:
        return Trace(**fields, force_unit=force_unit, metadata=metadata)
    except (TypeError, ValueError, RecursionError) as error:
        for name, values in fields.items():
            low, high = limits(name, force_unit)
            outside = np.flatnonzero(~((values >= low) & (values <= high)))
            if outside.size and str(error).startswith(f"{name} = "):
                raise ValueError(f"{where(int(outside[0]))}: {error}") from None
        raise ValueError(f"{where.cut}from {where(0).removeprefix(where.cut)} on: {error}") from None


def _along_cut(components: Mapping[str, Array], chosen: object) -> Array:
    """Return the chosen force along the cut from components."""
    axes = [axis for axis in AXES if axis in components]
    if chosen not in ALONG_CUT:
        raise ValueError(f"{ALONG_KEY} is {chosen!r}; it must be one of {', '.join(ALONG_CUT)}.")
    listed = " and ".join(f"force_{axis}" for axis in axes)
    if chosen == "norm":
        if len(axes) == 1:
            raise ValueError(f"it contains {listed} only. Declare it as the force along the cut: force='{axes[0]}'.")
        with np.errstate(over="ignore"):
            norm = components[axes[0]]
            for axis in axes[1:]:
                norm = np.hypot(norm, components[axis])
        return norm
    axis = str(chosen)[-1]
    if axis not in components:
        raise ValueError(f"force={chosen!r} asks for force_{axis}, but it holds {listed}.")
    return -components[axis] if str(chosen).startswith("-") else components[axis]


def _check_finite(header: str, values: Array, where: _Where) -> None:
    for row in np.flatnonzero(~np.isfinite(values))[:1]:
        raise ValueError(
            f"{where(int(row))}, column {header}: {values[row]} is no reading. Leave out the whole row, or the whole "
            "column if the sensor was not there; a gap in time is allowed."
        )


def _check_time(time: Array, where: _Where) -> None:
    for row in np.flatnonzero(np.diff(time) <= 0.0)[:1]:
        raise ValueError(
            f"{where(int(row) + 1)}: time goes from {float(time[row])!r} s to {float(time[row + 1])!r} s; it must "
            "increase. Sort the rows by time and drop repeated ones; several cuts in one file need a column 'cut'."
        )


def _said(column: Column | None) -> tuple[str | None, ...]:
    """Return a column's quantity, whatever its unit, for comparison."""
    return (column.field, column.axis, column.force_unit) if column else (CUT_COLUMN,)
