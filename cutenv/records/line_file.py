"""Drawn lines as files of places along and across the slab."""

from __future__ import annotations

import csv
from pathlib import Path

from cutenv.records.schema import UNITS
from cutenv.sim.tissue.lines import CutLine, through


def read_line(path: Path) -> CutLine:
    """Return the line through CSV places, such as ``x_mm,y_mm``."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        header, *rows = [row for row in csv.reader(file) if row] or [[]]
    columns = [_column(path, header, axis) for axis in ("x", "y")]
    places = []
    for number, row in enumerate(rows, start=2):
        try:
            places.append([unit * float(row[column]) for column, unit in columns])
        except (IndexError, ValueError):
            given = ",".join(row)
            raise ValueError(f"{path.name}, row {number}: {given!r} is no place. Write two numbers.") from None
    try:
        return through(places)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None


def _column(path: Path, header: list[str], axis: str) -> tuple[int, float]:
    """Return the number and unit of an axis's column [m]."""
    for column, name in enumerate(header):
        quantity, _, unit = name.strip().partition("_")
        if quantity == axis and unit in UNITS["position"]:
            return column, UNITS["position"][unit]
    found = ", ".join(header) or "nothing"
    raise ValueError(f"{path.name} has no column of {axis} with its unit, but {found}. Write x_mm,y_mm on top.")
