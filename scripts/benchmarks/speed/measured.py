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
    """Result of a benchmark; without numbers, nothing was measured."""

    numbers: Mapping[str, Number]  # by names that are the same in every run
    lines: Sequence[str]  # the same as text, with requirements and verdicts


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
