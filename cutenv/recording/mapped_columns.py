"""Mapped columns of a foreign table, in SI; and tables that are no text file: a bag's topics, a stream's channels."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.recording.column_map import USUAL_UNITS, ColumnMap, Expression, column_of
from cutenv.recording.csv_sniffer import SniffedTable, bare_name
from cutenv.recording.schema import FIELD_UNITS, RecordError
from cutenv.trace import Trace

STAMP = "stamp"
"""Name of the column with the time of a reading."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberTable(SniffedTable):
    """Numbers that need no parsing, with the headers, units and messages of a text file's table.

    Attributes
    ----------
    values : ndarray of shape (n, n_columns)
        Numbers in the units of the headers.
    source : str
        Topic or stream whose readings are the rows.
    """

    values: Array
    source: str
    row_name: ClassVar[str] = "reading"

    @classmethod
    def of(cls, path: Path, source: str, headers: Sequence[str], values: Array, numbers: NDArray[np.intp]) -> Self:
        """Make a table of columns with units in their headers (``x [mm]``), and each row's number, for messages."""
        return cls(
            path=path,
            headers=tuple(headers),
            units_row=(),
            separator=",",
            decimal=".",
            rows=[""] * len(values),
            lines=numbers,
            n_columns=len(headers),
            above="",
            values=values,
            source=source,
        )

    def __str__(self) -> str:
        return f"{self.n_columns - 1} numbers beside the time, {len(self.values)} readings of {self.source}"

    def numbers(self, indices: list[int]) -> Array:
        """Return some columns, shape (n, len(indices)); raise RecordError if a number is not finite."""
        chosen: Array = self.values[:, indices]
        for row, k in np.argwhere(~np.isfinite(chosen))[:1]:
            raise RecordError(
                self.path,
                f"reading {self.lines[row]} of {self.source}: {self.headers[indices[k]]!r} is {chosen[row, k]}, no "
                "finite number. Leave that column out of the mapping, or repair its source.",
            )
        return chosen

    def texts(self, indices: list[int]) -> list[tuple[str, ...]]:
        """Return some columns as text, a tuple for each row."""
        return [tuple(f"{value:.9g}" for value in row) for row in self.numbers(indices).tolist()]


_LARGEST = 1e12  # a greater value is not a reading, in any unit


@dataclass(frozen=True, kw_only=True, eq=False)
class MappedReadings:
    """Mapped columns of a table in SI, all its rows, with the force still in components."""

    table: SniffedTable
    mapping: ColumnMap
    time: Array | None
    force: Array  # (n, k)
    sensed: dict[str, Array]
    force_unit: str

    @classmethod
    def of(cls, table: SniffedTable, mapping: ColumnMap, notes: list[str]) -> MappedReadings:
        """Make those of a table, adding assumptions to ``notes``; raises RecordError for impossible readings."""
        expressions = {field: mapping.expression(field) for field in mapping.fields}
        places = {field: [table.index(name) for name in e.columns] for field, e in expressions.items()}
        needed = sorted({place for group in places.values() for place in group})
        numbers = table.numbers(needed)
        if (beyond := np.abs(numbers) > _LARGEST).any():
            row, column = (int(i) for i in np.argwhere(beyond)[0])
            raise RecordError(
                table.path,
                f"{table.row_name} {table.lines[row]} has {numbers[row, column]:g} in column #{needed[column] + 1}, "
                "which is no reading of a sensor.",
            )
        columns: dict[str, Array] = {}
        force_unit = "N"
        for field, expression in expressions.items():
            unit = _unit_of(table, field, expression, places[field], notes)
            if field == "force":
                force_unit = "1" if unit == "1" else "N"
            if expression.value is not None:
                values = np.full((len(numbers), 1), expression.value)
            else:
                values = expression.sign * numbers[:, [needed.index(place) for place in places[field]]]
            columns[field] = column_of(field, unit).to_si(values)
        force = columns.pop("force")
        time = columns.pop("time", None)
        return cls(
            table=table,
            mapping=mapping,
            time=None if time is None else time[:, 0],
            force=force,
            sensed={field: values[:, 0] for field, values in columns.items()},
            force_unit=force_unit,
        )

    @property
    def expression(self) -> Expression:
        """Expression of the force."""
        return self.mapping.expression("force")

    @property
    def lines(self) -> NDArray[np.intp]:
        """Lines of the file that hold the rows."""
        return self.table.lines

    def times(self, rows: NDArray[np.intp]) -> Array:
        """Return the times of a record's readings [s]; raises RecordError if they do not increase."""
        if self.time is None:
            assert self.mapping.rate is not None
            return np.arange(len(rows)) / self.mapping.rate
        time = self.time[rows]
        back = np.flatnonzero(np.diff(time) <= 0.0)
        if len(back):
            i = int(back[0])
            raise RecordError(
                self.table.path,
                f"{self.table.row_name} {self.lines[rows[i + 1]]}: time goes from {time[i]:.9g} s to "
                f"{time[i + 1]:.9g} s, but must increase. Delete repeated rows; several cuts in one file: "
                "split_by=column; times printed too coarsely: leave time out and give rate=1000Hz.",
            )
        return time

    def along_cut(self, components: Array) -> Array:
        """Return the force along the cut, shape (n,), of components of shape (n, k), [force unit]."""
        return self.expression.sign * _norm(components) if self.expression.is_norm else components[:, 0]

    def trace(self, group: dict[str, str], rows: NDArray[np.intp], tare: tuple[Array, int] | None) -> Trace:
        """Return a record as a trace, without the components' offsets [force unit] if a tare is given."""
        offsets, quiet = (None, 0) if tare is None else tare
        components = self.force[rows] if offsets is None else self.force[rows] - offsets
        force = self.along_cut(components)
        first, last = int(self.lines[rows[0]]), int(self.lines[rows[-1]])
        metadata: dict[str, Any] = {
            "source": self.table.path.name,
            "lines": [first, last],
            "columns": json.loads(self.mapping.to_json()),
        }
        if group:
            metadata["group"] = group
        if offsets is not None:
            # By column: the offset of a norm is that of its components.
            names = (bare_name(name) for name in self.expression.columns)
            metadata["tare_instants"] = [0, quiet - 1]
            metadata[f"tare_{self.force_unit}"] = dict(zip(names, offsets.tolist(), strict=True))
        try:
            return Trace(
                time=self.times(rows),
                force=force,
                **{field: values[rows] for field, values in self.sensed.items()},
                force_unit=self.force_unit,
                metadata=metadata,
            )
        except RecordError:
            raise
        except ValueError as error:
            raise RecordError(
                self.table.path, f"{self.table.row_name}s {first} to {last}: {error}{self._units_taken()}"
            ) from None

    def _units_taken(self) -> str:
        """Return a hint at fields assumed to be in SI for want of a unit: a likely cause of values out of range."""
        silent = [
            field
            for field in self.mapping.fields
            if field != "force"
            and (expression := self.mapping.expression(field)).columns
            and expression.unit is None
            and all(
                _header_unit(self.table, self.table.index(name), field, expression) is None
                for name in expression.columns
            )
        ]
        if not silent:
            return ""
        example = f"{silent[0]}={self.mapping.expression(silent[0]).columns[0]}[{USUAL_UNITS[silent[0]]}]"
        return f" No unit is given for {', '.join(silent)}: SI is assumed. Give it behind the column, as in {example}."

    def component(self, rows: NDArray[np.intp], k: int) -> Trace:
        """Return one component of force as a trace."""
        position = self.sensed.get("position")
        return Trace(
            time=self.times(rows),
            force=self.force[rows, k],
            position=None if position is None else position[rows],
            force_unit=self.force_unit,
        )


def _unit_of(table: SniffedTable, field: str, expression: Expression, places: list[int], notes: list[str]) -> str:
    """Return the unit of a field from the mapping or the header; SI if neither gives one, but never for force."""
    header = {unit for place in places if (unit := _header_unit(table, place, field, expression)) is not None}
    if len(header) > 1:
        raise RecordError(
            table.path, f"the columns of {field} are in {' and '.join(sorted(header))}. Bring them to one."
        )
    said = next(iter(header), None)
    if expression.unit is not None and said is not None and expression.unit != said:
        raise RecordError(
            table.path,
            f"{field} is mapped in {expression.unit}, but the file has {said}. Leave the unit out, or "
            "correct the header.",
        )
    unit = expression.unit or said
    if unit is None and field == "force":
        raise RecordError(
            table.path,
            "the unit of force is not known: the header has none. Give --unit N (mN, kN, gf, kgf, lbf), or --unit 1 "
            "if the force is normalised.",
        )
    if unit is None:
        unit = FIELD_UNITS[field][0].sign
        notes.append(f"{field}: no unit is given, {unit} is assumed.")
    return unit


def _header_unit(table: SniffedTable, place: int, field: str, expression: Expression) -> str | None:
    """Return the unit in the header; an invalid one is ignored if the mapping gives one."""
    try:
        return table.unit(place, field)
    except RecordError:
        if expression.unit is None:
            raise
        return None


def _norm(components: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", components, components)))
