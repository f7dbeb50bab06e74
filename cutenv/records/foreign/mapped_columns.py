"""Mapped columns of a foreign file in SI, and its records."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from cutenv._base.arrays import Array
from cutenv.records.foreign.cell_values import CellValues
from cutenv.records.foreign.clock_repair import stretches
from cutenv.records.foreign.column_map import USUAL_UNITS, ColumnMap, Expression, column_of
from cutenv.records.foreign.cut_detection import noise_level
from cutenv.records.foreign.named_columns import LeftOut, NamedColumns, RowNumbers, bare_name
from cutenv.records.foreign.stated_units import QUANTITY_OF, known_spelling
from cutenv.records.schema import FIELD_UNITS, UNITS, RecordError
from cutenv.sim.trace import Trace, limits

LEAST_RATE, GREATEST_RATE = 1.0, 1e5  # readings a second of a record [Hz], beyond which its unit of time must be wrong
_USUAL_RATE = (4.0, 5e4)  # [Hz]
_USUAL_TIME = (0.2, 3.6e4)  # [s]
_USUAL_WAY = (2e-3, 0.25)  # [m]
_CUT_WAY = (5e-3, 0.15)  # [m] of most cuts
_TIMES = ("s", "ms", "us", "ns", "d", "min", "h")
_WAYS = ("mm", "m", "cm", "um", "in")
_EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # of times since 1970, within a factor of three
_MIN_READINGS = 20  # readings that show a unit, or what is impossible


def usual_step(time: Array) -> float:
    """Return the mean time step in its unit, over all readings."""
    known = time[np.isfinite(time)]
    rising = np.diff(known)
    rising = rising[rising > 0.0]
    if not len(rising):
        return 0.0
    typical = float(np.median(rising))
    tied = len(known) / (1 + np.count_nonzero(np.diff(known) > 0.0))
    return typical / tied if tied > 1.5 else typical


def time_units(cells: CellValues) -> tuple[str, ...]:
    """Return possible time units of a column, the likeliest first."""
    if cells.unit:
        return ("s",)
    known = cells.values[np.isfinite(cells.values)]
    step, length = usual_step(known), float(np.ptp(known)) if len(known) else 0.0
    if len(known) < _MIN_READINGS:
        return ("s",)
    if not step:
        return ()
    size = {unit: UNITS["time"][unit] for unit in _TIMES}
    good = [
        unit
        for unit in _TIMES
        if _USUAL_RATE[0] <= 1.0 / (step * size[unit]) <= _USUAL_RATE[1]
        and _USUAL_TIME[0] <= length * size[unit] <= _USUAL_TIME[1]
    ]
    since = cells.origin + float(known[0])
    epochs = [unit for unit in good if unit in _EPOCHS and _EPOCHS[unit] / 3.0 < since < 3.0 * _EPOCHS[unit]]
    if epochs:
        return tuple(epochs)
    if good and good[0] in ("s", "ms", "us", "ns"):
        return tuple(unit for unit in good if unit in ("s", "ms", "us", "ns"))
    return tuple(good)


def way_units(values: Array) -> tuple[str, ...]:
    """Return possible length units of a blade's way, the likeliest first."""
    known = values[np.isfinite(values)]
    way = float(np.ptp(known)) if len(known) else 0.0
    if len(known) < _MIN_READINGS:
        return ("m",)
    good = [unit for unit in _WAYS if _USUAL_WAY[0] <= way * UNITS["position"][unit] <= _USUAL_WAY[1]]
    good.sort(key=lambda unit: not _CUT_WAY[0] <= way * UNITS["position"][unit] <= _CUT_WAY[1])
    return tuple(good)


_Mask = NDArray[np.bool_]

STAMP = "stamp"  # name of the column with the time of a reading
_MAX_READING = 1e12  # a greater value is not a reading, in any unit
_SPARSE = 0.05  # share of empty cells above which a column is slower than the others, not damaged
_SPIKE, _SPIKE_NOISE = 1.5, 30.0  # ranges of the record, and noises, beyond which one reading alone is impossible
_FEW_SPIKES = 0.005  # share of the readings; more are a fault of the sensor, and stay for the quality check
_PAUSE = 10.0  # [s] longest gap between blocks of one record


class RecordRows(NamedTuple):
    """One record: separating values, and rows with times [s]."""

    group: dict[str, str]
    rows: RowNumbers
    time: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class MappedReadings:
    """Mapped columns in SI with sound rows and force components."""

    table: NamedColumns
    mapping: ColumnMap
    kept: RowNumbers  # rows of the table, shape (n,)
    time: Array | None  # times as printed [s]; None if the mapping gives a rate, shape (n,)
    force: Array  # components of the force [force unit], shape (n, k)
    sensed: dict[str, Array]  # other fields in SI
    force_unit: str  # unit of the force; "N" or "1"
    of_day: bool
    left_out: list[LeftOut]  # rows that are in no record
    notes: list[str]  # what was assumed and corrected

    @classmethod
    def of(cls, table: NamedColumns, mapping: ColumnMap) -> MappedReadings:
        """Make those of a table."""
        notes: list[str] = list(table.notes)
        left_out = list(table.left_out)
        columns, force_unit = columns_in_si(table, mapping, notes)
        places = {field: [table.index(name) for name in mapping.expression(field).columns] for field in mapping.fields}
        for place in dict.fromkeys(place for group in places.values() for place in group):
            if doubt := table.typed(place).doubt:
                notes.append(f"column {table.header(place)!r}: {doubt}.")
        kept = np.arange(len(table))
        kept = _joined(columns, kept, notes)
        kept = _finite(table, columns, places, kept, left_out)
        kept = _without_spikes(table, columns, kept, left_out)
        force = columns.pop("force")
        time = columns.pop("time", None)
        _check_rate(table, None if time is None else time[:, 0])
        _set_position(columns, notes)
        return cls(
            table=table,
            mapping=mapping,
            kept=kept,
            time=None if time is None else time[:, 0],
            force=force,
            sensed={field: values[:, 0] for field, values in columns.items()},
            force_unit=force_unit,
            of_day=any(table.typed(place).kind in ("clock", "date") for place in places.get("time", ())),
            left_out=left_out,
            notes=notes,
        )

    @property
    def expression(self) -> Expression:
        """Expression of the force."""
        return self.mapping.expression("force")

    @property
    def lines(self) -> RowNumbers:
        """Lines of the file that hold the rows."""
        return self.table.lines[self.kept]

    def records(self) -> list[RecordRows]:
        """Return records by group, specimen, block and clock restart."""
        found: list[RecordRows] = []
        repeated = 0
        for group, rows in self._groups():
            parts: list[RecordRows] = []
            for name, own, start in self._parts(rows):
                if self.time is None:
                    assert self.mapping.rate is not None
                    time = np.arange(len(own)) / self.mapping.rate + (start or 0.0)
                    self._add(parts, RecordRows(name, own, time), together=start is not None)
                    continue
                self._check_groups(own)
                pieces, lost = stretches(self.time, own, of_day=self.of_day, notes=self.notes)
                if len(pieces) > max(2, len(own) // 10) or 2 * lost > len(own):
                    falls = np.flatnonzero(np.diff(self.time[own]) <= 0.0)
                    raise RecordError(
                        self.table.path,
                        f"{self.table.row_name} {self.lines[own[falls[0] + 1]]}: time goes from "
                        f"{self.time[own[falls[0]]]:.9g} s to {self.time[own[falls[0] + 1]]:.9g} s, but must increase; "
                        f"so it does {len(falls)} times. Map another column as the time.",
                    )
                repeated += lost
                for piece in pieces:
                    self._add(parts, RecordRows(name, piece.rows, piece.time), together=True, start=start)
            if len(parts) == 1:
                parts = [parts[0]._replace(group={})]
            found += [each._replace(group=group | each.group) for each in parts]
        if repeated:
            self.left_out.append(LeftOut(count=repeated, reason="their time repeats that of the reading before"))
        long = [each for each in found if len(each.rows) >= 2]
        if len(long) < len(found):
            lost = sum(len(each.rows) for each in found if len(each.rows) < 2)
            if not long:
                first, last = int(self.lines[0]), int(self.lines[-1])
                raise RecordError(
                    self.table.path,
                    f"{self.table.row_name}s {first} to {last}: a trace has 2 instants or more, and no record in it "
                    "has. Record for longer, or correct the column of time.",
                )
            self.left_out.append(LeftOut(count=lost, reason="single readings between restarts of the clock"))
        return long

    def _groups(self) -> list[tuple[dict[str, str], RowNumbers]]:
        """Return each `split_by` group's rows and values."""
        if not self.mapping.split_by:
            return [({}, np.arange(len(self.kept)))]
        keys = self.table.texts([self.table.index(name) for name in self.mapping.split_by])
        rows: dict[tuple[str, ...], list[int]] = {}
        for i, place in enumerate(self.kept.tolist()):
            rows.setdefault(keys[place], []).append(i)
        names = [bare_name(name) for name in self.mapping.split_by]
        return [(dict(zip(names, key, strict=True)), np.array(where)) for key, where in rows.items()]

    def _parts(self, rows: RowNumbers) -> list[tuple[dict[str, str], RowNumbers, float | None]]:
        """Return name, rows and start [s] of each specimen or block."""
        if self.table.parts is None:
            return [({}, rows, None)]
        numbers = self.table.parts[self.kept[rows]]
        starts = self.table.part_starts
        return [
            ({"part": self.table.part_names[k]}, rows[numbers == k], starts[k] if starts else None)
            for k in np.unique(numbers).tolist()
        ]

    @staticmethod
    def _add(parts: list[RecordRows], new: RecordRows, *, together: bool, start: float | None = None) -> None:
        """Add a record, or extend the previous if its clock continues."""
        if parts and together:
            before = parts[-1]
            time = new.time
            if start is not None and time[0] <= before.time[-1]:  # each segment counts from its own beginning
                time = time + start
            if len(before.time) > 1 and 0.0 < time[0] - before.time[-1] < _PAUSE:
                rows, both = np.concatenate([before.rows, new.rows]), np.concatenate([before.time, time])
                parts[-1] = RecordRows(before.group, rows, both)
                return
        parts.append(new)

    def _check_groups(self, rows: RowNumbers) -> None:
        """Raise RecordError if a column separates records of the same times."""
        assert self.time is not None
        time = self.time[rows]
        if len(time) < 4 or np.count_nonzero(np.diff(time) <= 0.0) < 0.2 * len(time):
            return
        names = separating_columns(self.table, self.mapping, self.kept[rows], time)
        if names:
            line = int(self.lines[rows[int(np.argmax(np.diff(time) <= 0.0)) + 1]])
            raise RecordError(
                self.table.path,
                f"{self.table.row_name} {line}: time goes back, or stands, where {' and '.join(names)} changes: "
                f"several cuts in one file. Part them: split_by={','.join(names)}.",
            )

    def trace(self, record: RecordRows, tare: tuple[Array, int] | None) -> Trace:
        """Return a record as trace, less the tare's offsets [force unit]."""
        offsets, quiet = (None, 0) if tare is None else tare
        rows = record.rows
        components = self.force[rows] if offsets is None else self.force[rows] - offsets
        force = along_cut(self.expression, components)
        lines = self.lines
        first, last = int(lines[rows[0]]), int(lines[rows[-1]])
        metadata: dict[str, Any] = {
            "source": self.table.path.name,
            "lines": [first, last],
            "columns": json.loads(self.mapping.to_json()),
        }
        if record.group:
            metadata["group"] = record.group
        if offsets is not None:
            # By column: the offset of a norm is that of its components.
            names = (bare_name(name) for name in self.expression.columns)
            metadata["tare_instants"] = [0, quiet - 1]
            metadata[f"tare_{self.force_unit}"] = dict(zip(names, offsets.tolist(), strict=True))
        try:
            return Trace(
                time=record.time,
                force=force,
                **{field: values[rows] for field, values in self.sensed.items()},
                force_unit=self.force_unit,
                metadata=metadata,
            )
        except ValueError as error:
            raise RecordError(
                self.table.path, f"{self.table.row_name}s {first} to {last}: {error}{self._units_taken(str(error))}"
            ) from None

    def _units_taken(self, reason: str) -> str:
        """Return a hint at fields assumed to be in SI."""
        silent = [
            field
            for field in self.mapping.fields
            if field != "force"
            and (expression := self.mapping.expression(field)).columns
            and expression.unit is None
            and not any(self.table.stated(self.table.index(name)) for name in expression.columns)
        ]
        if not silent:
            return ""
        wrong = next((field for field in silent if reason.startswith(field)), silent[0])
        example = f"{wrong}={self.mapping.expression(wrong).columns[0]}[{USUAL_UNITS[wrong]}]"
        return f" No unit is given for {', '.join(silent)}. Give it behind the column, as in {example}."

    def component(self, record: RecordRows, k: int) -> Trace:
        """Return one component of force as a trace."""
        position = self.sensed.get("position")
        return Trace(
            time=record.time,
            force=self.force[record.rows, k],
            position=None if position is None else position[record.rows],
            force_unit=self.force_unit,
        )


def columns_in_si(
    table: NamedColumns, mapping: ColumnMap, notes: list[str], *, guess: bool = True
) -> tuple[dict[str, Array], str]:
    """Return mapped fields in SI, shape (n, k), and force unit, "N" or "1".

    Without `guess`, a field without unit is taken in SI, rather than in the plausible one.
    """
    columns: dict[str, Array] = {}
    force_unit = "N"
    for field in mapping.fields:
        expression = mapping.expression(field)
        places = [table.index(name) for name in expression.columns]
        unit = _unit_of(table, field, expression, notes, guess=guess)
        force_unit = unit if field == "force" and unit == "1" else force_unit
        if expression.value is not None:
            values = np.full((len(table), 1), expression.value)
        else:
            values = expression.sign * np.column_stack([table.values(place) for place in places])
        if field != "time":
            values = np.where(np.abs(values) <= _MAX_READING, values, np.nan)
        columns[field] = column_of(field, unit).to_si(values)
    return columns, force_unit


def along_cut(expression: Expression, components: Array) -> Array:
    """Return the force along the cut [force unit], from components (n, k)."""
    if not expression.is_norm:
        return components[:, 0]
    return np.asarray(expression.sign * np.sqrt(np.einsum("ij,ij->i", components, components)))


def separating_columns(table: NamedColumns, mapping: ColumnMap, rows: RowNumbers, time: Array) -> tuple[str, ...]:
    """Return columns of few values that separate repeated times into records."""
    used = {table.index(name) for field in mapping.fields for name in mapping.expression(field).columns}
    shown = slice(0, 2000)
    few: dict[int, list[str]] = {}
    for k in range(table.n_columns):
        if k in used:
            continue
        cells = table.text(k)
        here = [cells[row] for row in rows[shown].tolist()]
        if 1 < len(set(here)) <= max(2, len(here) // 5):
            few[k] = here
    for size in (1, 2, 3):
        for chosen in itertools.combinations(list(few)[:8], size):
            last: dict[tuple[str, ...], float] = {}
            for key, moment in zip(zip(*(few[k] for k in chosen), strict=True), time[shown].tolist(), strict=True):
                if moment <= last.get(key, -np.inf):
                    break
                last[key] = moment
            else:
                return tuple(bare_name(table.header(k)) for k in chosen)
    return ()


def _joined(columns: dict[str, Array], kept: RowNumbers, notes: list[str]) -> RowNumbers:
    """Keep rows with a force; interpolate slower or faster columns there."""
    known: dict[str, _Mask] = {field: np.all(np.isfinite(values), axis=1) for field, values in columns.items()}
    share = {field: float(np.mean(~each)) for field, each in known.items()}
    time = columns.get("time")
    sparse = [field for field in columns if field != "time" and share[field] > _SPARSE and known[field].sum() >= 2]
    if time is None or not sparse:
        return kept
    rows = known["force"] & known["time"]
    alike = all((known[field] | ~rows).mean() > 1.0 - _SPARSE for field in sparse)
    if "force" not in sparse and alike:
        return kept
    moments = time[:, 0]
    here = np.flatnonzero(rows)
    for field in [name for name in columns if name not in ("time", "force")]:
        there = known[field] & known["time"]
        if not there.any() or (known[field][here]).all():
            continue
        order = np.argsort(moments[there], kind="stable")
        values = np.interp(moments, moments[there][order], columns[field][there, 0][order])
        columns[field] = np.where(known[field], columns[field][:, 0], values)[:, None]
        notes.append(f"{field}: its readings are at other times than those of the force; interpolated there.")
        first, last = moments[there].min(), moments[there].max()
        here = here[(moments[here] >= first - 0.1) & (moments[here] <= last + 0.1)]
    for field, values in columns.items():
        columns[field] = values[here]
    return kept[here]


def _finite(
    table: NamedColumns,
    columns: dict[str, Array],
    places: dict[str, list[int]],
    kept: RowNumbers,
    left_out: list[LeftOut],
) -> RowNumbers:
    """Keep rows of numbers in every column, and count the others."""
    bad: dict[str, _Mask] = {f: ~np.all(np.isfinite(values), axis=1) for f, values in columns.items()}
    lost: _Mask = np.logical_or.reduce(list(bad.values()))
    if not lost.any():
        return kept
    row = int(np.argmax(lost))
    field = next(name for name, each in bad.items() if each[row])
    first = places[field][0] if places[field] else None
    place = next((k for k in places[field] if not np.isfinite(table.typed(k).values[kept[row]])), first)
    where = f"{table.row_name} {table.lines[kept[row]]}"
    if place is not None:
        where += f": {table.text(place)[kept[row]][:40]!r} in column {table.header(place)!r}"
    if lost.mean() > 0.5:
        raise RecordError(
            table.path,
            f"{int(lost.sum())} of {len(kept)} rows have no number for {field} ({where}). Map another column, or "
            "repair the record.",
        )
    left_out.append(LeftOut(count=int(lost.sum()), reason=f"they have no finite number ({where})"))
    for name, values in columns.items():
        columns[name] = values[~lost]
    return kept[~lost]


def _without_spikes(
    table: NamedColumns, columns: dict[str, Array], kept: RowNumbers, left_out: list[LeftOut]
) -> RowNumbers:
    """Leave out single readings impossible for a sensor between their neighbours."""
    for field in ("force", "position"):
        if field not in columns or len(kept) < _MIN_READINGS:
            continue
        odd: _Mask = np.zeros(len(kept), dtype=bool)
        for component in columns[field].T:
            odd |= spikes(component)
        if not odd.any():
            continue
        row = int(np.argmax(odd))
        unit = FIELD_UNITS[field][0].sign
        line = f"{table.row_name} {table.lines[kept[row]]}"
        value = float(np.abs(columns[field][row]).max())
        left_out.append(
            LeftOut(count=int(odd.sum()), reason=f"{field} of {value:.4g} {unit} for one reading, impossible ({line})")
        )
        for name, values in columns.items():
            columns[name] = values[~odd]
        kept = kept[~odd]
    return kept


def spikes(values: Array) -> _Mask:
    """Return which readings jump by more than the whole range, shape (n,)."""
    calm = median_filter(values, size=5, mode="nearest")
    away = np.abs(values - calm)
    span = float(np.ptp(calm))
    if span == 0.0 or not (away > _SPIKE * span).any():
        return np.zeros(len(values), dtype=bool)
    found = (away > _SPIKE * span) & (away > _SPIKE_NOISE * noise_level(values))
    return found if found.sum() <= max(3, _FEW_SPIKES * len(values)) else np.zeros(len(values), dtype=bool)


def _check_rate(table: NamedColumns, time: Array | None) -> None:
    if time is None or len(time) < _MIN_READINGS:
        return
    step = usual_step(time)
    if step and 1.0 / step > GREATEST_RATE:
        raise RecordError(
            table.path,
            f"its times make {1.0 / step:.3g} readings a second, which no force sensor gives: the unit of time is "
            "wrong, in the mapping or in the header. Correct it there.",
        )


def _set_position(columns: dict[str, Array], notes: list[str]) -> None:
    """Count a position from its start if its zero is unreachable."""
    position = columns.get("position")
    if position is None or not len(position):
        return
    low, high = limits("position")
    if (position.min() < low or position.max() > high) and np.ptp(position) <= high:
        first, least = float(position[0, 0]), float(position.min())
        origin = first if first - least <= -low else least
        columns["position"] = position - origin
        notes.append(f"position: counted from {1e3 * origin:.4g} mm, where the record starts.")


def _unit_of(table: NamedColumns, field: str, expression: Expression, notes: list[str], *, guess: bool) -> str:
    """Return a field's unit: mapped, stated or plausible, but force unguessed."""
    places = [table.index(name) for name in expression.columns]
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
    if said is not None:
        spelt = Counter(table.stated(place) for place in places).most_common(1)[0][0]
        if field == "force" and said in ("gf", "kgf") and not spelt.lower().endswith("f"):
            notes.append(f"force: {spelt} of a load cell is read as {said}, its weight by standard gravity.")
    unit = expression.unit or said
    if unit is None and field == "force":
        raise RecordError(
            table.path,
            "the unit of force is not known: the header has none. Give --unit N (mN, kN, gf, kgf, lbf), or --unit 1 "
            "if the force is normalised.",
        )
    if unit is None:
        unit = assumed_unit(table, field, places) if guess else FIELD_UNITS[field][0].sign
        notes.append(f"{field}: no unit is given, {unit} is assumed.")
    return unit


def assumed_unit(table: NamedColumns, field: str, places: Sequence[int]) -> str:
    """Return a field's assumed unit: plausible time and position, else SI."""
    likely: tuple[str, ...] = ()
    if field == "time":
        likely = time_units(table.typed(places[0]))
    elif field == "position":
        likely = way_units(table.values(places[0]))
    return likely[0] if likely else FIELD_UNITS[field][0].sign


def _header_unit(table: NamedColumns, place: int, field: str, expression: Expression) -> str | None:
    """Return the file's unit; another quantity's raises, unknown may be mapped."""
    try:
        return table.unit(place, field)
    except RecordError:
        known = known_spelling(table.stated(place))
        if expression.unit is None:
            raise
        if known is not None and known.quantity != QUANTITY_OF.get(field, field) and expression.unit != "1":
            raise RecordError(
                table.path,
                f"column {table.header(place)!r} is in {known.unit}, which is no {field}. Map another column, or "
                "correct the header.",
            ) from None
        return None
