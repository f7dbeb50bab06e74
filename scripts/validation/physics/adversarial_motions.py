"""Motions that no drive makes: a blade that jitters, leaps, flips or pumps, to test the energy account.

Not a program: the checks of the laws beside it and ``tests/sim/properties/test_energy.py`` move a blade along them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cutenv.sim.tissue.grid import LENGTH

TICKS = 3000
UPRIGHT, INCLINED = math.radians(90.0), math.radians(45.0)
FEED = 0.01e-3 * np.arange(1, TICKS + 1)  # 1 cm/s [m]
FLIPS = np.where(np.arange(TICKS) % 2 == 0, UPRIGHT, INCLINED)

Motion = tuple[Any, Any]  # positions [m], shape (3000,), and angles [rad], of that shape or one for all


def _reversing(step: float) -> Any:
    return FEED + np.where(np.arange(TICKS) % 2 == 0, step, 0.0)


def _pumping(angle: float) -> Motion:
    return FEED + 1e-3 * (1.0 + np.sin(2.0 * math.pi * 25e-3 * np.arange(TICKS))), angle


def _teleporting(rng: np.random.Generator) -> Any:
    return rng.uniform(0.0, LENGTH, TICKS)


MOTIONS: dict[str, Callable[[np.random.Generator], Motion]] = {
    "white jitter of 1 mm": lambda rng: (np.clip(FEED + rng.normal(0.0, 1e-3, TICKS), 0.0, LENGTH), UPRIGHT),
    "2 mm back and forth": lambda rng: (_reversing(2e-3), UPRIGHT),
    "10 um back and forth": lambda rng: (_reversing(10e-6), UPRIGHT),
    "10 um back and forth, inclined": lambda rng: (_reversing(10e-6), INCLINED),
    "standing": lambda rng: (np.zeros(TICKS), UPRIGHT),
    "across the specimen in one update": lambda rng: (np.full(TICKS, LENGTH), UPRIGHT),
    "anywhere at once": lambda rng: (_teleporting(rng), UPRIGHT),
    "out of the crack and in again": lambda rng: (np.where(np.arange(TICKS) % 2 == 0, FEED + 0.01, 0.0), UPRIGHT),
    "flipping while it moves": lambda rng: (FEED, FLIPS),
    "flipping at rest, loaded": lambda rng: (np.minimum(FEED, 0.0061), FLIPS),
    "anywhere at once at any angle": lambda rng: (_teleporting(rng), rng.uniform(INCLINED, UPRIGHT, TICKS)),
    "steps of 1e-12 m": lambda rng: (0.02 + 1e-12 * np.arange(TICKS), UPRIGHT),
    "pumping at 25 Hz": lambda rng: _pumping(UPRIGHT),
    "pumping at 25 Hz, inclined": lambda rng: _pumping(INCLINED),
}
"""One position and angle each millisecond, by name; random numbers come from the generator."""
