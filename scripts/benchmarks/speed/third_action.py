"""Speed of a task with a third action in a batch, beside GentleCut-v1 under the same speed and angle."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.parallel import cores
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import CutBatch
from cutenv.task.registry import TASKS
from scripts.benchmarks.speed.measured import Measured, Number, at_most

COUNT, STEPS, ROUNDS = 1024, 60, 5
ALLOWED = 2.0  # most times the time of GentleCut-v1 that a decision should take

ThirdActions = Callable[[np.random.Generator, int], NDArray[np.float64]]
"""Third actions of n cuts in a decision, shape (n,)."""
MOTIONS: dict[str, dict[str, ThirdActions]] = {  # motions of each task by name; lines of all kinds are cut along
    "depth": {
        "at a constant level": lambda rng, count: np.zeros(count),
        "at random": lambda rng, count: rng.uniform(-1.0, 1.0, count),
        "pressing down": lambda rng, count: rng.uniform(0.1, 0.4, count),
    },
    "path": {
        "straight on": lambda rng, count: np.zeros(count),
        "turning at random": lambda rng, count: rng.uniform(-1.0, 1.0, count),
    },
}


class RatesBeside(NamedTuple):
    """Decisions per second; the best of interleaved rounds."""

    own: float
    gentle: float  # those of GentleCut-v1, under the same speed and angle


def seconds_of(batch: CutBatch, actions: list[NDArray[np.float64]]) -> float:
    """Return the seconds of all decisions, from the same start; a cut that ends begins again."""
    every = np.arange(len(batch))
    batch.give_seeds(every.tolist(), every, np.random.default_rng(0))
    batch.begin(every)
    batch.decide(actions[0])
    start = time.perf_counter()
    for action in actions:
        _, ends = batch.decide(action)
        if ends.any():
            batch.begin(np.flatnonzero(ends))
    return time.perf_counter() - start


def rates_beside(
    task: str, motion: ThirdActions, count: int = COUNT, steps: int = STEPS, rounds: int = ROUNDS
) -> RatesBeside:
    """Measure as many cuts of both; each round begins with the same specimens, and resets are included."""
    own, rng = CutBatch(count, TASKS[task].single()), np.random.default_rng(0)
    gentle = CutBatch(count, GentleCutEnv())
    along = [rng.uniform((0.3, -1.0), (1.0, 1.0), (count, 2)) for _ in range(steps)]
    moving = [np.column_stack([action, motion(rng, count)]) for action in along]
    best = [math.inf, math.inf]
    for _ in range(rounds):
        for k, (batch, actions) in enumerate(((own, moving), (gentle, along))):
            best[k] = min(best[k], seconds_of(batch, actions))
    return RatesBeside(*(count * steps / seconds for seconds in best))


def measure(task: str) -> Measured:
    """Measure each motion; return decisions per second, and how many times GentleCut-v1's time they take."""
    numbers: dict[str, Number] = {}
    lines = [
        f"{TASKS[task].id.removeprefix('cutenv/')}, {COUNT} cuts on {cores()} cores at 50 decisions a second, resets "
        "included, beside",
        "  GentleCut-v1 under the same motion along the cut",
    ]
    for name, motion in MOTIONS[task].items():
        found = rates_beside(task, motion)
        times = found.gentle / found.own
        numbers[f"decisions {name}"] = Number(found.own, "1/s")
        numbers[f"times GentleCut-v1 {name}"] = Number(times, "1")
        what = f"{name}: {1e-3 * found.own:.0f} thousand decisions a second, {times:.1f} times GentleCut-v1's time"
        lines.append(at_most(what, times, ALLOWED, f"{ALLOWED:g}"))
    return Measured(numbers, lines)
