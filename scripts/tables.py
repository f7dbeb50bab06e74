"""Tables of programs: kept as CSV, all else as JSON, and printed as Markdown; means of columns as text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv._base.output import atomic_write
from cutenv.agents.learning.statistics import mean_with_interval, rows_of, write_csv


def keep(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a file, in a folder that is made if there is none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path, rows)


def kept_rows(path: Path, command: str, texts: Iterable[str] = ("policy",)) -> list[dict[str, Any]]:
    """Return the rows of a file, numbers but for the columns ``texts``; SystemExit with the command that makes it."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; run 'python -m {command}' first.")
    return [{name: v if name in texts else float(v) for name, v in row.items()} for row in rows_of(path)]


def keep_json(path: Path, content: Any) -> None:
    """Write what JSON can hold to a file, atomically, in a folder that is made if there is none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part:
        part.write_text(json.dumps(content, indent=1), encoding="utf-8")


def kept_json(path: Path, command: str) -> Any:
    """Return the content of a file; SystemExit with the command that makes it."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; make it by: python -m {command}")
    return json.loads(path.read_text(encoding="utf-8"))


def interval_text(found: Mapping[str, float], digits: int = 3, sign: str = "", factor: float = 1.0) -> str:
    """Return a mean times ``factor``, with its 95 % interval, as text."""
    mean, low, high = (f"{factor * found[name]:{sign}.{digits}f}" for name in ("mean", "low_95", "high_95"))
    return f"{mean} [{low}, {high}]"


def mean_text(values: Iterable[float], digits: int = 3, sign: str = "", factor: float = 1.0) -> str:
    """Return the mean of independent values, times ``factor``, with its 95 % interval as text."""
    return interval_text(mean_with_interval(values), digits, sign, factor)


def markdown_table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a Markdown table."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
