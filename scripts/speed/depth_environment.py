"""Speed of DepthCut-v1 in a batch, beside GentleCut-v1 under the same motion along the cut."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.parallel import cores
from cutenv.envs.batch import CutBatch
from cutenv.envs.depth_cut import DepthBatch, DepthCutEnv
from cutenv.envs.gentle_cut import GentleCutEnv
from speed.measured import Measured, Number

COUNT, STEPS, ROUNDS = 1024, 60, 5

Descents = Callable[[np.random.Generator, int], NDArray[np.float64]]
"""Third actions of n cuts in a decision, shape (n,)."""

MOTIONS: dict[str, Descents] = {
    "at a constant level": lambda rng, count: np.zeros(count),
    "at random": lambda rng, count: rng.uniform(-1.0, 1.0, count),
    "pressing down": lambda rng, count: rng.uniform(0.1, 0.4, count),
}


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


def measure() -> Measured:
    """Measure each motion; return decisions per second, and how many times GentleCut-v1's time they take."""
    numbers: dict[str, Number] = {}
    lines = [
        f"DepthCut-v1, {COUNT} cuts on {cores()} cores at 50 decisions a second, beside GentleCut-v1's under the same",
        "  motion along the cut, resets included",
        "                          decisions a second   GentleCut-v1   times",
    ]
    gentle, depth = CutBatch(COUNT, GentleCutEnv()), DepthBatch(COUNT, DepthCutEnv())
    for name, motion in MOTIONS.items():
        rng = np.random.default_rng(0)
        along = [rng.uniform((0.3, -1.0), (1.0, 1.0), (COUNT, 2)) for _ in range(STEPS)]
        moving = [np.column_stack([action, motion(rng, COUNT)]) for action in along]
        best = [math.inf, math.inf]
        for _ in range(ROUNDS):
            for k, (batch, actions) in enumerate(((depth, moving), (gentle, along))):
                best[k] = min(best[k], seconds_of(batch, actions))
        rates = [COUNT * STEPS / seconds for seconds in best]
        numbers[f"decisions {name}"] = Number(rates[0], "1/s")
        numbers[f"times GentleCut-v1 {name}"] = Number(rates[1] / rates[0], "1")
        lines.append(f"  {name:24s}{rates[0]:18.0f}{rates[1]:15.0f}{rates[1] / rates[0]:8.1f}")
    return Measured(numbers, lines)
