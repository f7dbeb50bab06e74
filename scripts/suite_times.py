"""Sum up what the tests take, as ``pytest --times FILE`` has measured it: each folder, and the slowest tests.

    python3 scripts/start.py test --times tests/times.csv    measures; then update_docs.py test-times prints the page

A file has the processor and wall seconds of each folder, and of each test that takes a second or longer, all its cases
together. What a fixture takes counts for the test that is first to ask for it, and a child process once it has ended.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from scripts import ROOT

KEPT = ROOT / "tests" / "times.csv"
LEAST = 1.0  # shorter tests are kept in their folder's sum alone [s]
SHOWN = 20
Seconds = tuple[float, float]  # seconds of processors, and of the clock on the wall


def summed(cases: Mapping[str, Seconds]) -> dict[str, Seconds]:
    """Return the seconds of each folder of tests, and of each test that takes LEAST or longer."""
    folders: dict[str, list[Seconds]] = defaultdict(list)
    tests: dict[str, list[Seconds]] = defaultdict(list)
    for case, seconds in cases.items():
        test = case.partition("[")[0]
        folders[test.partition("::")[0].rpartition("/")[0]].append(seconds)
        tests[test].append(seconds)
    totals = {name: (sum(s[0] for s in every), sum(s[1] for s in every)) for name, every in (folders | tests).items()}
    return {name: both for name, both in totals.items() if name in folders or max(both) >= LEAST}


def write(path: Path, rows: Mapping[str, Seconds]) -> None:
    """Write what ``summed`` returned, folders and tests in the order of their names."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("name", "processor_s", "wall_s"))
        writer.writerows((name, f"{rows[name][0]:.1f}", f"{rows[name][1]:.1f}") for name in sorted(rows))


def read(path: Path = KEPT) -> dict[str, Seconds]:
    """Return what ``write`` wrote; nothing where there is no file."""
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {row["name"]: (float(row["processor_s"]), float(row["wall_s"])) for row in csv.DictReader(file)}


def tables(rows: Mapping[str, Seconds]) -> str:
    """Return the sums of the folders, and the tests that take most of the processor, as Markdown."""
    by_time = sorted(rows, key=lambda name: rows[name], reverse=True)
    folders = [name for name in by_time if "::" not in name]
    slowest = [name for name in by_time if "::" in name][:SHOWN]
    whole = (sum(rows[name][0] for name in folders), sum(rows[name][1] for name in folders))
    parts = {"folder": [*((name, rows[name]) for name in folders), ("all", whole)]}
    parts["test"] = [(name.removeprefix("tests/"), rows[name]) for name in slowest]
    return "\n\n".join(
        "\n".join(
            [f"| {title} | processor [s] | wall [s] |", "| --- | ---: | ---: |"]
            + [f"| `{name}` | {processor:.0f} | {wall:.0f} |" for name, (processor, wall) in lines]
        )
        for title, lines in parts.items()
    )


def kept_tables() -> str:
    """Return the tables of the last whole run."""
    return tables(read())
