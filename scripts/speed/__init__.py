"""Measurements of speed, each compared with something run in the same process; the program is scripts/bench.py."""

from __future__ import annotations

BENCHMARKS = {
    "first": "first_use",
    "step": "environment",
    "batch": "batch",
    "descent": "vertical_motion",
    "depth": "depth_environment",
    "steering": "steering",
    "freehand": "freehand",
    "path": "path_environment",
    "tick": "tick",
    "picture": "picture",
    "field": "field",
    "models": "models",
    "factorisation": "factorisation",
    "calibration": "calibration",
    "ppo": "ppo",
    "reading": "reading",
}
"""Module with ``measure()`` by name."""
