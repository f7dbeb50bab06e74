"""Speed of the law where the blade also moves up and down: bare physics in a batch, beside that of GentleCut-v1."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.work_queue import make_queue
from cutenv.cutting.descending_cut import hold_some_descending
from cutenv.cutting.descent import descent_records, layered_profiles
from cutenv.cutting.drive import Rig
from cutenv.cutting.dtypes import new_state
from cutenv.cutting.parameters import law_records
from cutenv.cutting.sensor import SensorParameters, sensor_records
from cutenv.cutting.simulate import Physics, hold_some
from cutenv.tissue import Layers, Specimen
from cutenv.tissue.specimen import LENGTH, SPACING
from speed.measured import Measured, Number

COUNT, TICKS = 1024, 20
_LAYERS = Layers(capsule_thickness=5e-4, capsule_modulus=5.0, boundary=0.017, deep_toughness=3.0, deep_modulus=2.0)
_ANGLE = math.radians(60.0)
_WARM_UP, _STEPS, _ROUNDS = 25, 25, 40

Commands = Callable[[int, np.random.Generator, int], NDArray[np.float64]]
"""Speed [m/s], angle [rad] and speed downwards [m/s] of n cuts in a step of 20 ms, shape (n, 3), by its number."""


def _steady(downwards: Callable[[int], float]) -> Commands:
    return lambda step, rng, count: np.tile((0.01, _ANGLE, downwards(step)), (count, 1))


MOTIONS: dict[str, Commands] = {
    "at level 0": _steady(lambda step: 0.0),
    "at a constant level above it": _steady(lambda step: -0.005 if step < _WARM_UP - 10 else 0.0),
    "at random": lambda step, rng, count: rng.uniform((-0.002, 0.8, -0.003), (0.02, 1.57, 0.005), (count, 3)),
    "pressing down": _steady(lambda step: 0.004),
}


class DescendingRates(NamedTuple):
    """Updates per second of one core's own time, so that other programs disturb little; the best of many rounds."""

    descending: float
    gentle: float
    """Those of GentleCut-v1, under the same commands along the cut."""


def descending_rates(motion: Commands, count: int = COUNT, rounds: int = _ROUNDS) -> DescendingRates:
    """Measure ``count`` cuts through layers; each round begins at the same place."""
    specimens = [Specimen.drawn(number) for number in range(min(count, 64))]
    specimens = [specimens[number % len(specimens)] for number in range(count)]
    slab, descents = specimens[0].tissue.slab(), descent_records(specimens, _LAYERS)
    cuts = Physics(
        new_state(count, _ANGLE), layered_profiles(descents, slab), law_records(specimens),
        np.repeat(Rig().records(travel=LENGTH - SPACING), count),
        sensor_records([SensorParameters()] * count, [0] * count, range(count)),
    )  # fmt: skip
    steps = [motion(step, np.random.default_rng(step), count) for step in range(_WARM_UP + _STEPS)]
    along = [np.ascontiguousarray(commands[:, :2]) for commands in steps]
    felt, upwards = np.empty(count), np.empty((count, 2))

    def descending(own: Any, moving: Any) -> None:
        for commands in moving:
            hold_some_descending(make_queue(count), 0, own[0], own[1], slab, commands, TICKS, upwards)

    def gentle(own: Any, moving: Any) -> None:
        for commands in moving:
            hold_some(make_queue(count), 0, own[0], commands, TICKS, felt)

    best = [math.inf, math.inf]
    for _ in range(rounds):
        for k, (way, moving) in enumerate(((descending, steps), (gentle, along))):
            own = Physics(*(part.copy() for part in cuts)), descents.copy()
            way(own, moving[:_WARM_UP])
            start = time.thread_time()
            way(own, moving[_WARM_UP:])
            best[k] = min(best[k], time.thread_time() - start)
    return DescendingRates(*(count * TICKS * _STEPS / seconds for seconds in best))


def measure() -> Measured:
    """Measure each motion; return the times of an update, and how many times GentleCut-v1's they are."""
    numbers: dict[str, Number] = {}
    lines = [
        f"bare physics where the blade also moves up and down, {COUNT} cuts through layers on one core, beside",
        "  GentleCut-v1's under the same commands along the cut; time of that core",
        "                                  ns an update   GentleCut-v1   times",
    ]
    for name, motion in MOTIONS.items():
        found = descending_rates(motion)
        times = found.gentle / found.descending
        numbers[f"updates {name}"] = Number(found.descending, "1/s")
        numbers[f"times GentleCut-v1 {name}"] = Number(times, "1")
        lines.append(f"  {name:32s}{1e9 / found.descending:12.0f}{1e9 / found.gentle:15.0f}{times:8.1f}")
    return Measured(numbers, lines)
