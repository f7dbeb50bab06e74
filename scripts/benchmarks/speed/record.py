"""JSON file of a run of the benchmarks: its numbers, the machine, the version and the date."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import cutenv
from cutenv._base.output import atomic_write
from scripts.benchmarks.speed.machine import description
from scripts.benchmarks.speed.measured import Number

FORMAT = "cutenv bench 1"
_CURE = "Make one with: python -m scripts.benchmarks.speed.bench --json FILE"

Numbers = Mapping[str, Mapping[str, Number]]  # numbers by benchmark and name


class Record(NamedTuple):
    """One run of the benchmarks."""

    version: str
    date: str
    machine: Mapping[str, str | int]
    numbers: Numbers


def record_of(numbers: Numbers, date: datetime) -> Record:
    """Return the record of numbers measured now on this machine."""
    return Record(cutenv.__version__, date.isoformat(timespec="seconds"), description(), numbers)


def check_place(path: Path) -> None:
    """Refuse a file that could not be written, before minutes are spent on measuring."""
    if path.is_dir():
        raise ValueError(f"{path} is a folder. Give the name of a file in it.")
    if not path.parent.is_dir():
        raise ValueError(f"{path} cannot be written: there is no folder {path.parent}. Make it first.")


def write(path: Path, record: Record) -> None:
    """Write a record atomically: an interruption leaves the earlier one, or none."""
    content = {
        "format": FORMAT,
        "cutenv": record.version,
        "date": record.date,
        "machine": dict(record.machine),
        "numbers": {
            benchmark: {name: number._asdict() for name, number in numbers.items()}
            for benchmark, numbers in record.numbers.items()
        },
    }
    with atomic_write(path) as part:
        part.write_text(json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")


def read(path: Path) -> Record:
    """Read a record written by :func:`write`; ValueError with the cure if it is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}. {_CURE}") from None
    except ValueError:
        raise ValueError(f"{path} is not JSON. {_CURE}") from None
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        raise ValueError(f"{path} has format {found!r}, not {FORMAT!r}. {_CURE}")
    try:
        return Record(
            version=str(content["cutenv"]),
            date=str(content["date"]),
            machine=dict(content["machine"]),
            numbers={
                benchmark: {name: _number(name, given) for name, given in numbers.items()}
                for benchmark, numbers in content["numbers"].items()
            },
        )
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a whole record ({type(error).__name__}: {error}). {_CURE}") from None


def _number(name: str, given: Any) -> Number:
    value = float(given["value"])
    if not math.isfinite(value):
        raise ValueError(f"{name} = {value} is no measured number")
    return Number(value, str(given["unit"]))
