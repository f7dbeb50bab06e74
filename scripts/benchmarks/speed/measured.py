"""Result of a benchmark: numbers with their units, for a file, and lines of text, for a reader."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

Key = TypeVar("Key")


class Number(NamedTuple):
    """A measured number; ``unit`` is "1" for a pure number."""

    value: float
    unit: str


class Measured(NamedTuple):
    """Result of a benchmark.

    Attributes
    ----------
    numbers : mapping of str to Number
        Numbers by names that are the same in every run, so that runs can be compared; empty if nothing was measured.
    lines : sequence of str
        The same numbers as text, with requirements and verdicts.
    """

    numbers: Mapping[str, Number]
    lines: Sequence[str]


def at_least(what: str, value: float, required: float) -> str:
    """Return a line with the verdict on a number that must be large."""
    return f"  {what}: {'at least' if value >= required else 'MISSED:'} {required:g} required"


def at_most(what: str, value: float, allowed: float, shown: str) -> str:
    """Return a line with the verdict on a number that must be small; ``shown`` is ``allowed`` as text."""
    return f"  {what}; {'within' if value <= allowed else 'MISSED:'} the {shown} allowed"


def fastest(ways: Mapping[Key, Callable[[], object]], rounds: int) -> dict[Key, float]:
    """Return the time of each way [s]: the best of rounds in which they take turns, as a busy machine slows all."""
    best = dict.fromkeys(ways, math.inf)
    for _ in range(rounds):
        for name, way in ways.items():
            start = time.perf_counter()
            way()
            best[name] = min(best[name], time.perf_counter() - start)
    return best
