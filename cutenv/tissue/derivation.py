"""Constants that scripts derive from the tables: one JSON file per quantity, with its method and interval."""

from __future__ import annotations

import json
import math
from typing import NamedTuple

from cutenv._base import resources

FOLDER = "derived"
"""Folder of the assets with these files."""


def derived_value(name: str) -> float:
    """Return the value stored in ``assets/derived/<name>.json``.

    Raises
    ------
    FileNotFoundError
        If no script has derived it.
    ValueError
        If the file holds no finite number.
    """
    file = resources.path(f"{FOLDER}/{name}.json")
    value = json.loads(file.read_text()).get("value")
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{file.name}: value = {value!r} is not a finite number; derive it again.")
    return float(value)


class DerivedConstant(NamedTuple):
    """A derived constant: its value, unit, 95 % interval, source and script."""

    value: float
    unit: str
    interval_95: tuple[float, float] | None
    source: str
    script: str


def write_derived(name: str, constant: DerivedConstant) -> None:
    """Store a derived constant."""
    resources.path(FOLDER).joinpath(f"{name}.json").write_text(json.dumps(constant._asdict(), indent=1) + "\n")
