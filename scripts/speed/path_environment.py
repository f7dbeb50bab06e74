"""Speed of PathCut-v1 in a batch, beside GentleCut-v1 under the same motion along the cut."""

from __future__ import annotations

import numpy as np

from cutenv.envs.batch import CutBatch
from cutenv.envs.path_cut import PathCutEnv
from speed.measured import Measured
from speed.third_action import COUNT, ROUNDS, STEPS, RatesBeside, ThirdActions, measured_beside, rates_beside

MOTIONS: dict[str, ThirdActions] = {
    "straight on": lambda rng, count: np.zeros(count),
    "turning at random": lambda rng, count: rng.uniform(-1.0, 1.0, count),
}


def path_rates(motion: ThirdActions, count: int = COUNT, steps: int = STEPS, rounds: int = ROUNDS) -> RatesBeside:
    """Measure ``count`` cuts along lines of all kinds."""
    return rates_beside(CutBatch(count, PathCutEnv()), motion, steps, rounds)


def measure() -> Measured:
    """Measure each motion; return decisions per second, and how many times GentleCut-v1's time they take."""
    return measured_beside("PathCut-v1", MOTIONS, lambda motion: path_rates(motion))
