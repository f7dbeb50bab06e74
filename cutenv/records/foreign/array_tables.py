"""Named arrays as columns, and series joined at common times.

Which arrays belong together, and at which rate, as MATLAB, HDF5, NumPy and others keep them. Series of readings, each
on its own clock, are brought to the times of one of them: topics, streams and channels.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.records.foreign.column_map import column_of
from cutenv.records.foreign.mapped_columns import GREATEST_RATE, LEAST_RATE, STAMP, assumed_unit
from cutenv.records.foreign.named_columns import LeftOut, NamedColumns, bare_name
from cutenv.records.foreign.stated_units import known_spelling, split_header, unit_of_field
from cutenv.records.schema import RecordError


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Readings of one source."""

    source: str  # topic, stream or group
    headers: tuple[str, ...]  # names of the columns, with their units in brackets where they are known
    times: Array  # times [s], in any order, shape (n,)
    values: Array  # numbers in the units of the headers, shape (n, n_columns)

    def in_order(self) -> Series:
        """Return readings in time order, the first of equal times."""
        times, first = np.unique(self.times, return_index=True)
        return Series(source=self.source, headers=self.headers, times=times, values=self.values[first])


def joined(path: Path, every: Sequence[Series], names: Collection[str], notes: Sequence[str] = ()) -> NamedColumns:
    """Return series as one table.

    Its rows are the readings of the series that is needed first. `names` are the columns that are needed, that of the
    force first; the rows reach from where to where all of them have readings, and one step of theirs more. Without any,
    the rows are those of the series with a force that has the most readings.
    """
    series = [each.in_order() for each in every]
    headers = [header for each in series for header in each.headers]
    series_of = [k for k, each in enumerate(series) for _ in each.headers]
    place = {f"#{k}": owner for k, owner in enumerate(series_of, 2)}  # the stamp is the first column
    place |= {bare_name(header): owner for header, owner in zip(headers, series_of, strict=True)}
    needed = list(dict.fromkeys(place[name] for name in map(bare_name, names) if name in place))
    forces = [k for k, each in enumerate(series) if any(header.endswith("[N]") for header in each.headers)]
    base = needed[0] if needed else max(forces or range(len(series)), key=lambda k: len(series[k].times))
    rows, used = series[base].times, [series[k] for k in needed or [base]]
    # A slower series holds for one of its steps more.
    steps = [float(np.median(np.diff(each.times))) if len(each.times) > 1 else 0.0 for each in used]
    first = max(each.times[0] - step for each, step in zip(used, steps, strict=True))
    last = min(each.times[-1] + step for each, step in zip(used, steps, strict=True))
    kept: NDArray[np.intp] = np.flatnonzero((rows >= first) & (rows <= last))
    if len(kept) < 2:
        listed = ", ".join(
            f"{each.source} from {each.times[0] - rows[0]:.3f} s to {each.times[-1] - rows[0]:.3f} s" for each in used
        )
        raise RecordError(path, f"its topics have no two readings at the same time: {listed}. Map topics that do.")
    columns = [rows[kept] - rows[0]]
    for k, each in enumerate(series):
        columns += [
            each.values[kept, column] if k == base else np.interp(rows[kept], each.times, each.values[:, column])
            for column in range(len(each.headers))
        ]
    apart = [each.source for each in series if each.times[0] > rows[-1] or each.times[-1] < rows[0]]
    if apart:
        told = f"no reading of {' or '.join(apart)} lies in the time of {series[base].source}: another clock?"
        notes = (*notes, told)
    repeated = len(every[base].times) - len(rows)
    return NamedColumns.of(
        path,
        list(zip((f"{STAMP} [s]", *headers), columns, strict=True)),
        about=f"readings of {series[base].source}",
        row_name="reading",
        lines=kept + 1,
        source=series[base].source if len(series) > 1 else "",
        left_out=(LeftOut(count=repeated, reason="they repeat a time; the first of each is kept"),) if repeated else (),
        notes=tuple(notes),
    )


_MOST_COLUMNS = 64  # a table with more is a picture or a spectrum
_RATES = {
    "fs", "f_s", "sf", "sr", "rate", "srate", "samplerate", "sample_rate", "samplingrate", "sampling_rate",
    "sampling_frequency", "samplingfrequency", "sample_frequency", "samplefrequency", "fsample", "nominal_srate",
    "sampling_freq", "samp_rate", "abtastrate", "wf_samplerate", "rate_hz", "freq_hz", "fps",
}  # fmt: skip
_STEPS = {
    "dt", "delta_t", "deltat", "isi", "sample_interval", "sampling_interval", "sample_period", "sampling_period",
    "samplinginterval", "sampleinterval", "time_step", "timestep", "step", "wf_increment", "increment", "delta_x",
    "ts", "xincrement", "x_increment", "tinterval", "interval", "t_step", "tsample", "t_sample",
}  # fmt: skip
_TIMES = re.compile(
    r"(?:.*[^a-z])?(?:t|time|times|timestamp|timestamps|zeit|zeitstempel|temps|tiempo|tempo|clock|stamp|datetime|"
    r"time_?(?:stamp|sec|secs|seconds|s|ms|us|ns)|elapsed)"
)
_FORCES = {"wrench", "ft", "force", "forces"}
_COMPONENTS = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_CLOCKS = re.compile(r"t_\w+|time_?\w+|\w+_t")  # of one sensor, if they run


@dataclass(frozen=True, eq=False)
class NamedArray:
    """One array of a file."""

    name: str  # its path in the file, with dots
    values: NDArray[Any]  # numbers, times or text, of any shape
    unit: str = ""  # unit that is stated beside it, "" for none
    names: tuple[str, ...] = ()  # names and units of its columns, if the file states them
    units: tuple[str, ...] = ()


def table_of_arrays(
    path: Path,
    arrays: Iterable[NamedArray],
    about: str,
    names: Collection[str] = (),
    notes: Sequence[str] = (),
    *,
    parts: NDArray[Any] | None = None,
    part_name: str = "part",
) -> NamedColumns:
    """Return the arrays of a file as columns.

    Arrays of one length are columns of a table; a matrix is several. Arrays of other lengths are interpolated if they
    have times of their own, and left out with a note otherwise. Groups whose names differ by a number alone
    (``demo_0``, ``demo_1``) are records, one below the other. A number such as ``fs`` or ``dt`` is the rate. `parts` is
    the number of the record of each row, where the file itself says so, `part_name` the word for one.
    """
    given, told = list(arrays), list(notes)
    records = _records(given, told) if parts is None else {"": given}
    tables = {name: _table(path, about, part, names, told) for name, part in records.items()}
    found = [(name, table) for name, table in tables.items() if table is not None]
    if not found:
        said = f" ({'; '.join(told)})" if told else ""
        raise RecordError(path, f"it holds no arrays of numbers, a value for each instant{said}.")
    if len(found) > 1:
        return below_one_another(path, about, found, told)
    table = replace(found[0][1], notes=(*told, *found[0][1].notes))
    if parts is None or len(parts) != len(table):
        return table
    numbers, part_of = np.unique(parts, return_inverse=True)
    return replace(table, parts=part_of, part_names=tuple(f"{part_name} {number}" for number in numbers.tolist()))


def below_one_another(
    path: Path, about: str, tables: Sequence[tuple[str, NamedColumns]], notes: Sequence[str]
) -> NamedColumns:
    """Return several named records as one table with parts.

    Those with other columns are left out.
    """
    headers = tables[0][1].headers
    alike = [(name, table) for name, table in tables if table.headers == headers]
    others = [name for name, table in tables if table.headers != headers]
    told = [f"{', '.join(others)} left out: the columns are not those of {alike[0][0]}"] if others else []
    rates = {table.rate for _, table in alike}
    columns = []
    for k, header in enumerate(headers):
        cells = [table.typed(k) for _, table in alike]
        columns.append((header, np.concatenate([each.values + (each.origin - cells[0].origin) for each in cells])))
    return NamedColumns.of(
        path,
        columns,
        units=[alike[0][1].stated(k) for k in range(len(headers))],
        about=about,
        rate=rates.pop() if len(rates) == 1 else None,
        parts=np.repeat(np.arange(len(alike)), [len(table) for _, table in alike]),
        part_names=tuple(name for name, _ in alike),
        left_out=tuple(each for _, table in alike for each in table.left_out),
        notes=(*notes, *told, *(note for _, table in alike for note in table.notes)),
    )


def is_time(name: str, values: NDArray[Any]) -> bool:
    """Return whether a column is named as time; ``t_force`` must rise."""
    stem, unit = split_header(name)
    known = known_spelling(unit) if unit else None
    if known is not None and known.quantity != "time":
        return False
    last = stem.lower().rpartition(".")[2].strip()
    rises = values.dtype.kind in "fiu" and bool((np.diff(values) > 0).all())
    return bool(_TIMES.fullmatch(last)) or (rises and bool(_CLOCKS.fullmatch(last)))


def seconds(table: NamedColumns, column: int, notes: list[str]) -> Array:
    """Return times in seconds; a missing unit is guessed and noted."""
    cells = table.typed(column)
    unit = table.unit(column, "time")
    if unit is None:
        unit = assumed_unit(table, "time", [column])
        notes.append(f"{table.header(column)}: no unit is given, {unit} is assumed")
    return column_of("time", unit).to_si(cells.values + cells.origin)


def _records(arrays: Sequence[NamedArray], notes: list[str]) -> dict[str, list[NamedArray]]:
    """Return each record's arrays, named within it; one "" without repetition."""
    for depth in range(1, max((each.name.count(".") for each in arrays), default=0) + 1):
        groups: dict[str, list[NamedArray]] = {}
        for each in arrays:
            parts = each.name.split(".")
            if len(parts) > depth and re.search(r"\d", parts[depth - 1]):
                inner = replace(each, name=".".join(parts[depth:]))
                groups.setdefault(".".join(parts[:depth]), []).append(inner)
        stems = {re.sub(r"\d+", "#", name) for name in groups}
        if len(groups) > 1 and len(stems) == 1 and set.intersection(*map(_names_of, groups.values())):
            others = [each for each in arrays if not each.name.startswith(tuple(f"{name}." for name in groups))]
            left = {
                each.name for each in others if each.values.size > 1 and not is_time(each.name, each.values.reshape(-1))
            }
            notes += [f"left out beside the records: {', '.join(sorted(left))}"] if left else []
            shared = [each for each in others if each.values.size == 1 or is_time(each.name, each.values.reshape(-1))]
            ordered = sorted(groups, key=lambda name: [int(digits) for digits in re.findall(r"\d+", name)])
            return {name.rpartition(".")[2]: [*groups[name], *shared] for name in ordered}
    return {"": list(arrays)}


def _names_of(arrays: Iterable[NamedArray]) -> set[str]:
    return {each.name for each in arrays if each.values.size > 1}


class _Column(NamedTuple):
    """A column of numbers, times or text."""

    name: str
    unit: str
    values: NDArray[Any]

    @property
    def is_number(self) -> bool:
        return self.values.dtype.kind in "fiu"

    @property
    def is_time(self) -> bool:
        return is_time(self.name, self.values)


def _table(
    path: Path, about: str, arrays: Sequence[NamedArray], names: Collection[str], notes: list[str]
) -> NamedColumns | None:
    by_length: dict[int, list[_Column]] = {}
    for each in arrays:
        for column in _columns(each, notes):
            by_length.setdefault(len(column.values), []).append(column)
    by_length = {n: columns for n, columns in by_length.items() if any(column.is_number for column in columns)}
    if not by_length:
        return None
    timed = [n for n, columns in by_length.items() if any(column.is_time for column in columns)]
    main = max(timed or by_length, key=lambda n: n * len(by_length[n]))
    kept = timed if len(timed) > 1 else [main]
    left = [f"{column.name} ({n} values)" for n in by_length if n not in kept for column in by_length[n]]
    notes += [f"left out, because their length is that of no times: {', '.join(left)}"] if left else []
    if len(timed) > 1:
        return joined(path, [_series(path, by_length[n], notes) for n in timed], names)
    columns = by_length[main]
    common = _common([column.name for column in columns])
    return NamedColumns.of(
        path,
        [(column.name.removeprefix(common), column.values) for column in columns],
        units=[column.unit for column in columns],
        about=about,
        rate=None if timed else _rate(arrays),
    )


def _common(names: Sequence[str]) -> str:
    """Return the common prefix of all column names, with its dot."""
    first = names[0].rpartition(".")[0]
    while first and not all(name.startswith(f"{first}.") and not name[len(first) + 1].isdigit() for name in names):
        first = first.rpartition(".")[0]
    return f"{first}." if first and len(names) > 1 else ""


def _series(path: Path, columns: Sequence[_Column], notes: list[str]) -> Series:
    time = next(k for k, column in enumerate(columns) if column.is_time)
    others = [column for column in columns if column is not columns[time] and column.is_number]
    pairs = [(column.name, column.values) for column in columns]
    table = NamedColumns.of(path, pairs, units=[column.unit for column in columns], about="")
    return Series(
        source=columns[time].name,
        headers=tuple(f"{each.name} [{each.unit}]" if each.unit else each.name for each in others),
        times=seconds(table, time, notes),
        values=np.column_stack([each.values.astype(np.float64) for each in others]),
    )


def _columns(array: NamedArray, notes: list[str]) -> list[_Column]:
    """Return an array's columns; none for a picture or single number."""
    values = array.values
    if values.dtype.names:  # a record array
        fields = [(f"{array.name}.{name}".lstrip("."), values[name]) for name in values.dtype.names]
        return [column for name, each in fields for column in _columns(NamedArray(name, each), notes)]
    if values.dtype.kind not in "fiubMmUS" or values.size < 2:
        return []
    values = values.squeeze()
    if values.ndim == 1:
        values = values[:, None]
    elif len(array.names) != values.shape[-1] and (
        len(array.names) == values.shape[0] or values.shape[0] < min(values.shape[1], _MOST_COLUMNS + 1)
    ):
        values = values.T
    if values.ndim != 2 or values.shape[1] > _MOST_COLUMNS:
        notes.append(f"{array.name} left out: its shape {array.values.shape} is that of no table")
        return []
    count = values.shape[1]
    labels = list(array.names) if len(array.names) == count else _labels(array.name, count)
    units = array.units if len(array.units) == count else [array.unit] * count
    values = values.astype(str) if values.dtype.kind == "S" else values
    return [_Column(label, unit, values[:, k]) for k, (label, unit) in enumerate(zip(labels, units, strict=True))]


def _labels(name: str, count: int) -> list[str]:
    """Return names for an unnamed matrix's columns: force components or numbers."""
    if count == 1:
        return [name]
    of_force = _FORCES.intersection(re.split(r"[^a-z]+", name.lower())) and count in (3, 6)
    return [f"{name}.{each}".lstrip(".") for each in (_COMPONENTS if of_force else range(1, count + 1))][:count]


def _rate(arrays: Sequence[NamedArray]) -> float | None:
    """Return the rate if a single number states it [Hz], or None."""
    for each in arrays:
        if each.values.size != 1 or each.values.dtype.kind not in "fiu":
            continue
        last, value = each.name.rpartition(".")[2], float(each.values.reshape(-1)[0])
        name, unit = split_header(last)
        unit = each.unit or unit
        rate = None
        if {name.lower(), last.lower()} & _RATES:
            rate = value * {"khz": 1e3, "mhz": 1e6}.get(unit.lower(), 1.0)
        elif name.lower() in _STEPS and value > 0.0:
            rate = 1.0 / column_of("time", unit_of_field("time", unit) or "s").to_si(np.array([value]))[0]
        if rate is not None and LEAST_RATE <= rate <= GREATEST_RATE:
            return float(rate)
    return None
