"""Entries of the benchmark of cuts along a curve: read, checked and measured against the reference."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scripts.validation.physics.curves.made import ENERGY, PATHS, STIFFNESS

LARGEST_GAP = 0.006  # largest distance of two arc lengths of an entry's stiffness [m]


class Standing(NamedTuple):
    """Result of an entry."""

    method: str
    errors: tuple[float, float, float]
    """Largest errors of the stiffness along the path, coupled (over that along) and across [1]."""
    residual: float | None  # largest residual of the energy account over the work or 1 mJ [1]; None without energies
    seconds: float  # time of a tip's stiffness [s], as given

    def cells(self) -> tuple[str, ...]:
        """Return the cells of its row."""
        shown = "not given" if self.residual is None else f"{self.residual:.0e}"
        return (self.method, *(f"{100 * error:.1f} %" for error in self.errors), shown, f"{1e3 * self.seconds:.3g} ms")


HEADER = ("method", "along", "coupled", "across", "energy residual", "time of a tip, as told")


def measured(entry: Path, benchmark: Path) -> Standing:
    """Return the result of an entry; ValueError with file, line and cure if a file is missing or wrong."""
    about = _about(entry / "about.json")
    reference, found = _stiffness(benchmark / "reference.csv"), _stiffness(entry / "stiffness.csv")
    worst = np.zeros(3)
    for name, rows in reference.items():
        ends = json.loads((benchmark / "about.json").read_text(encoding="utf-8"))
        first, last = ends["first_arc_length_m"], ends["last_arc_length_m"][name]
        known = rows[(rows[:, 0] >= first) & (rows[:, 0] <= last - LARGEST_GAP)]
        own = found.get(name)
        if own is None:
            raise ValueError(f"{entry / 'stiffness.csv'}: path {name!r} is missing; give all of {', '.join(PATHS)}.")
        own = own[np.argsort(own[:, 0])]
        inside = own[(own[:, 0] >= first - LARGEST_GAP) & (own[:, 0] <= last + LARGEST_GAP), 0]
        gaps = np.diff(np.concatenate(([first], np.clip(inside, first, None), [last])))
        if len(inside) < 2 or gaps.max() > 2.0 * LARGEST_GAP or np.diff(inside).max() > LARGEST_GAP + 0.002:
            raise ValueError(
                f"{entry / 'stiffness.csv'}: path {name!r} has gaps; give a tip every {1e3 * LARGEST_GAP:g} mm from "
                f"{1e3 * first:g} to {1e3 * last:g} mm."
            )
        values = np.column_stack([np.interp(known[:, 0], own[:, 0], own[:, k]) for k in (1, 2, 3)])
        scale = np.column_stack((known[:, 1], known[:, 1], known[:, 3]))
        worst = np.maximum(worst, (abs(values - known[:, 1:]) / scale).max(axis=0))
    energies = entry / "energy.csv"
    residual = _residual(energies) if energies.is_file() else None
    along, coupled, across = worst.tolist()
    return Standing(str(about["method"]), (along, coupled, across), residual, float(str(about["seconds_per_tip"])))


def _about(path: Path) -> dict[str, object]:
    if not path.is_file():
        raise ValueError(f"{path} is missing: give method, by and seconds_per_tip as JSON.")
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is no JSON: {error}.") from None
    missing = [key for key in ("method", "by", "seconds_per_tip") if not isinstance(about, dict) or key not in about]
    if missing:
        raise ValueError(f"{path} lacks {', '.join(missing)}.")
    seconds = about["seconds_per_tip"]
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 < seconds < 1e6:
        raise ValueError(f"{path}: seconds_per_tip = {seconds!r} is no positive number of seconds.")
    return dict(about)


def _stiffness(path: Path) -> dict[str, np.ndarray]:
    """Return arc length, along, coupled and across of each path, shape (n, 4)."""
    rows: dict[str, list[list[float]]] = {}
    for name, values in _rows(path, STIFFNESS):
        rows.setdefault(name, []).append(values)
    return {name: np.array(values) for name, values in rows.items()}


def _residual(path: Path) -> float:
    """Return the largest residual of the energy account over the work or 1 mJ."""
    worst = 0.0
    for _, (_, work, stored, *spent) in _rows(path, ENERGY):
        worst = max(worst, abs(work - stored - math.fsum(spent)) / max(abs(work), 1e-3))
    return worst


def _rows(path: Path, columns: tuple[str, ...]) -> list[tuple[str, list[float]]]:
    if not path.is_file():
        raise ValueError(f"{path} is missing: columns {', '.join(columns)}.")
    found = []
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        missing = [column for column in columns if column not in (reader.fieldnames or ())]
        if missing:
            raise ValueError(f"{path} lacks the column {', '.join(missing)}; it has {reader.fieldnames}.")
        for number, row in enumerate(reader, 2):
            try:
                values = [float(row[column]) for column in columns[1:]]
            except (TypeError, ValueError):
                raise ValueError(f"{path}, line {number}: give a number in each of {', '.join(columns[1:])}.") from None
            if not np.isfinite(values).all():
                raise ValueError(f"{path}, line {number}: a number is not finite.")
            found.append((row[columns[0]], values))
    return found
