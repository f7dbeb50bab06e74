"""Measurements of speed, each compared with something run in the same process; its program is ``bench``."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scripts.benchmarks.speed.measured import Measured

BENCHMARKS = {  # module with 'measure()' by name, with its argument where it has one
    "first": "first_use",
    "step": "environment",
    "batch": "batch",
    "descent": "vertical_motion",
    "depth": "third_action:depth",
    "steering": "steering",
    "freehand": "freehand",
    "path": "third_action:path",
    "tick": "tick",
    "picture": "picture",
    "field": "field",
    "models": "models",
    "factorisation": "factorisation",
    "calibration": "calibration",
    "ppo": "ppo",
    "reading": "reading",
}


def measurement(name: str) -> Callable[[], Measured]:
    """Return the measurement of a benchmark; its module is loaded only now."""
    module, _, argument = BENCHMARKS[name].partition(":")
    measure = import_module(f"{__name__}.{module}").measure
    return lambda: measure(*filter(None, (argument,)))
