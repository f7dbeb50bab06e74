"""Tables of scores: CSV files, and text on the terminal."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv._base.atomic_file import atomic_write

SHOWN = ("return", "success", "tip_error_mm", "peak_force_N", "largest_jump_mm", "time_s")
"""Scores in printed tables."""


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV file, atomically; missing values become empty cells."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with atomic_write(path) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=names, restval="")
        writer.writeheader()
        writer.writerows(rows)


def print_table(summary: Sequence[Mapping[str, Any]], scores: Sequence[str] = SHOWN) -> None:
    """Print the chosen scores of each policy with their intervals, the best return first."""
    values = {(row["policy"], row["score"]): row for row in summary}
    policies = sorted({row["policy"] for row in summary}, key=lambda name: -values[name, "return"]["mean"])
    width = max(len(name) for name in policies) + 2
    print("".ljust(width) + "".join(score.rjust(24) for score in scores))
    for policy in policies:
        cells = [values[policy, score] for score in scores]
        shown = [f"{cell['mean']:.3f} [{cell['low_95']:.3f}, {cell['high_95']:.3f}]" for cell in cells]
        print(policy.ljust(width) + "".join(text.rjust(24) for text in shown))


def print_differences(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print paired differences of return and success."""
    values = {(row["baseline"], row["score"]): row for row in rows}
    print(f"\n{rows[0]['policy']} minus each other on the same specimens, mean [95 % interval]\n")
    print("".ljust(30) + "".join(score.rjust(28) for score in ("return", "success")))
    for baseline in dict.fromkeys(row["baseline"] for row in rows):
        cells = [values[baseline, score] for score in ("return", "success")]
        shown = "".join(
            f"{cell['mean']:+.3f} [{cell['low_95']:+.3f}, {cell['high_95']:+.3f}]".rjust(28) for cell in cells
        )
        print(baseline.ljust(30) + shown)


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file as text, none if there is no file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_rows(path: Path) -> list[dict[str, float]]:
    """Read rows of numbers from a CSV file; an empty cell is an absent number, an absent file has no rows."""
    return [{name: float(value) for name, value in row.items() if value} for row in rows_of(path)]
