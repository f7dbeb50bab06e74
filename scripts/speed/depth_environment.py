"""Speed of DepthCut-v1 in a batch, beside GentleCut-v1 under the same motion along the cut."""

from __future__ import annotations

import numpy as np

from cutenv.envs.batch import CutBatch
from cutenv.envs.depth_cut import DepthCutEnv
from speed.measured import Measured
from speed.third_action import COUNT, ROUNDS, STEPS, RatesBeside, ThirdActions, measured_beside, rates_beside

MOTIONS: dict[str, ThirdActions] = {
    "at a constant level": lambda rng, count: np.zeros(count),
    "at random": lambda rng, count: rng.uniform(-1.0, 1.0, count),
    "pressing down": lambda rng, count: rng.uniform(0.1, 0.4, count),
}


def depth_rates(motion: ThirdActions, count: int = COUNT, steps: int = STEPS, rounds: int = ROUNDS) -> RatesBeside:
    """Measure ``count`` cuts."""
    return rates_beside(CutBatch(count, DepthCutEnv()), motion, steps, rounds)


def measure() -> Measured:
    """Measure each motion; return decisions per second, and how many times GentleCut-v1's time they take."""
    return measured_beside("DepthCut-v1", MOTIONS, lambda motion: depth_rates(motion))
