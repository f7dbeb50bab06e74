"""Constants that scripts derive from the tables: one JSON file per quantity, with its method and interval."""

from __future__ import annotations

import json
import math

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


def write_derived(
    name: str, value: float, *, unit: str, source: str, script: str, interval: tuple[float, float] | None = None
) -> None:
    """Store a derived constant with its unit, source, script and 95 % interval."""
    content = {
        "value": value,
        "unit": unit,
        "interval_95": interval,
        "source": source,
        "script": script,
    }
    resources.path(FOLDER).joinpath(f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")
