"""What a benchmark comes to: numbers with their units, for a file, and lines that say them, for a reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Number(NamedTuple):
    """A measured number; ``unit`` is "1" for a pure number."""

    value: float
    unit: str


class Measured(NamedTuple):
    """A benchmark's result.

    Attributes
    ----------
    numbers : mapping of str to Number
        By names that stay the same from run to run, so that two runs can be compared; empty where nothing was measured.
    lines : sequence of str
        The same for a reader, with what is required of them and the verdict.
    """

    numbers: Mapping[str, Number]
    lines: Sequence[str]


def at_least(what: str, value: float, required: float) -> str:
    """A line with the verdict on a number that must be large."""
    return f"  {what}: {'at least' if value >= required else 'MISSED:'} {required:g} required"


def at_most(what: str, value: float, allowed: float, shown: str) -> str:
    """A line with the verdict on a number that must be small; ``shown`` is ``allowed`` in the reader's words."""
    return f"  {what}; {'within' if value <= allowed else 'MISSED:'} the {shown} allowed"
