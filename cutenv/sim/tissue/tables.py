"""The thesis's tables, parsed strictly, with errata, and constants derived from them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from cutenv._base import resources
from cutenv._base.arrays import Array
from cutenv._base.validation import one_of

_KEYS = ("title", "source", "note", "erratum", "resolution", "printed_mean", "printed_population_sd")


class Printed(NamedTuple):
    """Number as printed, with the unit of its last digit."""

    value: float
    resolution: float


@dataclass(frozen=True, kw_only=True)
class ThesisTable:
    """One table of the thesis; ``table["lem_plane_stress_Pa"]`` is a read-only column."""

    number: str  # in the thesis, as "5.6"
    title: str
    provenance: str  # author, work and table number
    columns: Mapping[str, Array]  # printed, (rows,), NaN where nothing was measured; names end in the unit (_Pa, _cm_s)
    resolution: Mapping[str, float]  # unit of the last printed digit of each column, 0 for exact counts and labels
    notes: tuple[str, ...] = ()  # on the print
    errata: tuple[str, ...] = ()  # known errors in it
    printed_mean: Mapping[str, Printed]  # the printed "Average" row over the rows of the column named
    printed_population_sd: Mapping[str, Printed]  # with ddof = 0

    def __getitem__(self, column: str) -> Array:
        """Return a column, (rows,); raise ValueError for unknown names."""
        return self.columns[one_of(f"column of Table {self.number}", column, self.columns)]


@cache
def table_numbers() -> tuple[str, ...]:
    """Return the tables' numbers in thesis order: ``("4.1", ..., "7.1")``."""
    stems = (file.stem.removeprefix("table_") for file in resources.path("tables").glob("table_*_*.csv"))
    return tuple(stem.replace("_", ".") for stem in sorted(stems, key=lambda s: [int(n) for n in s.split("_")]))


def table(number: str) -> ThesisTable:
    """Read one table of the thesis, by its number there, as ``"5.6"``.

    The values are as printed; columns that the thesis mislabels have the name of what they contain.  ValueError if
    there is no such table, or its file is malformed (the message names file and line).
    """
    known = one_of("table number", number, table_numbers())
    return read_table(resources.path(f"tables/table_{known.replace('.', '_')}.csv"), number=known)


@cache
def read_table(file: Path, *, number: str) -> ThesisTable:
    """Read ``file`` as the table ``number``, once.

    The format: comment lines ``# key: value`` (title and source once; note and erratum any number of times; ``#
    resolution: column = unit`` for every column; ``# printed_mean: column = value to unit``), a header of
    comma-separated column names, then one row of numbers per line. Nothing else, no blank line. ValueError names the
    file and line that depart from it.
    """
    return _Reader(file).read(number)


def errata() -> tuple[tuple[str, str], ...]:
    """Return the thesis's known errata: (table number, text)."""
    return tuple((number, text) for number in table_numbers() for text in table(number).errata)


class _Reader:
    def __init__(self, file: Path) -> None:
        self.file = file
        self.line = 0

    def read(self, number: str) -> ThesisTable:
        lines = self.file.read_text(encoding="utf-8").splitlines()
        n_comments = next((i for i, text in enumerate(lines) if not text.startswith("#")), len(lines))
        comments: dict[str, list[tuple[int, str]]] = {key: [] for key in _KEYS}
        for self.line, text in enumerate(lines[:n_comments], start=1):
            key, value = self._split(text.removeprefix("#"), ":", "# key: value")
            if key not in comments:
                raise self._error(f"unknown key {key!r}, expected one of {', '.join(_KEYS)}")
            comments[key].append((self.line, value))
        self.line = n_comments + 1
        if len(lines) < n_comments + 2:
            raise self._error("expected a header of column names and at least one row")
        names = lines[n_comments].split(",")
        if len(set(names)) != len(names) or not all(
            name.isprintable() and name.strip() == name != "" for name in names
        ):
            raise self._error(f"column names must be distinct, without blanks around them, got {lines[n_comments]!r}")
        rows = []
        for self.line, text in enumerate(lines[n_comments + 1 :], start=n_comments + 2):
            cells = text.split(",")
            if len(cells) != len(names):
                raise self._error(f"expected {len(names)} values, got {len(cells)}")
            rows.append([self._number(cell, missing_allowed=True) for cell in cells])
        values = np.array(rows, dtype=np.float64)
        values.flags.writeable = False
        resolution = self._resolution(comments["resolution"], names)
        return ThesisTable(
            number=number,
            title=self._once(comments, "title"),
            provenance=self._once(comments, "source"),
            columns=MappingProxyType({name: values[:, i] for i, name in enumerate(names)}),
            resolution=MappingProxyType(resolution),
            notes=tuple(value for _, value in comments["note"]),
            errata=tuple(value for _, value in comments["erratum"]),
            printed_mean=MappingProxyType(self._printed(comments["printed_mean"], names)),
            printed_population_sd=MappingProxyType(self._printed(comments["printed_population_sd"], names)),
        )

    def _once(self, comments: dict[str, list[tuple[int, str]]], key: str) -> str:
        found = comments[key]
        if len(found) != 1:
            self.line = found[1][0] if found else 1
            raise self._error(f"expected '# {key}: ...' once, found it {len(found)} times")
        return found[0][1]

    def _resolution(self, entries: list[tuple[int, str]], names: list[str]) -> dict[str, float]:
        resolution: dict[str, float] = {}
        for self.line, text in entries:
            name, unit = self._split(text, "=", "# resolution: column = unit of the last printed digit")
            resolution[self._known(name, names, resolution)] = self._number(unit, missing_allowed=False)
        for name in names:
            if name not in resolution:
                self.line = 1
                raise self._error(f"column {name!r} has no '# resolution: {name} = ...'")
        return resolution

    def _printed(self, entries: list[tuple[int, str]], names: list[str]) -> dict[str, Printed]:
        printed: dict[str, Printed] = {}
        for self.line, text in entries:
            name, rest = self._split(text, "=", "column = value to unit of the last printed digit")
            value, unit = self._split(rest, " to ", "column = value to unit of the last printed digit")
            printed[self._known(name, names, printed)] = Printed(
                self._number(value, missing_allowed=False), self._number(unit, missing_allowed=False)
            )
        return printed

    def _known(self, name: str, names: list[str], taken: dict[str, float] | dict[str, Printed]) -> str:
        if name not in names or name in taken:
            raise self._error(f"{name!r} is {'stated twice' if name in taken else 'not a column'}")
        return name

    def _split(self, text: str, separator: str, form: str) -> tuple[str, str]:
        left, found, right = text.partition(separator)
        if not found or not left.strip() or not right.strip():
            raise self._error(f"expected {form!r}, got {text.strip()!r}")
        return left.strip(), right.strip()

    def _number(self, text: str, *, missing_allowed: bool) -> float:
        if text == "nan" and missing_allowed:
            return math.nan
        try:
            number = float(text)
        except ValueError:
            raise self._error(f"expected a number, got {text!r}") from None
        if not math.isfinite(number):
            raise self._error(f"expected a finite number{' or nan' if missing_allowed else ''}, got {text!r}")
        return number

    def _error(self, message: str) -> ValueError:
        return ValueError(f"{self.file}, line {self.line}: {message}")


class FractureResistance(NamedTuple):
    """Mean and between-cut standard deviation of the fracture resistance [J/m2]."""

    mean: float
    sd: float


def measured_fracture_resistance() -> FractureResistance:
    """Return pig liver's apparent fracture resistance: mean and SD.

    They are 211 and 78 J/m2, and unpack as two.  Source: Table 6.1, cuts of 0.0254 to 0.1016 m. The mean is that of its
    seven averages. The standard deviation is that of a cut from any row: the root of the mean variance within the rows
    plus the population variance of the row averages. Rows have equal weight, because the thesis does not say how many
    of the forty cuts are in each. Apparent: work of the blade per depth and length of cut (equations 6.1 to 6.4), which
    contains the blade's friction and the lag of the tip. The thesis's force is the norm of the sensor's three
    components (section 3.3.2), so that it counts the work of vertical and lateral force as if they acted along the cut.
    """
    data = table("6.1")
    averages = data["fracture_resistance_J_m2"]
    variance_within = float((data["sd_fracture_resistance_J_m2"] ** 2).mean())
    return FractureResistance(mean=float(averages.mean()), sd=math.sqrt(variance_within + float(averages.var(ddof=0))))


FOLDER = "derived"  # folder of the assets with these files


def derived_value(name: str) -> float:
    """Return the finite number in ``assets/derived/<name>.json``; FileNotFoundError or ValueError without."""
    file = resources.path(f"{FOLDER}/{name}.json")
    value = json.loads(file.read_text()).get("value")
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{file.name}: value = {value!r} is not a finite number; derive it again.")
    return float(value)


class DerivedConstant(NamedTuple):
    """Derived constant: value, unit, 95 % interval, source and script."""

    value: float
    unit: str
    interval_95: tuple[float, float] | None
    source: str
    script: str


def write_derived(name: str, constant: DerivedConstant) -> None:
    """Store a derived constant."""
    resources.path(FOLDER).joinpath(f"{name}.json").write_text(json.dumps(constant._asdict(), indent=1) + "\n")
