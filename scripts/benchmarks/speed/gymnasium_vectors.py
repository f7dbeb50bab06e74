"""Speed of Gymnasium's own vector environments, made in the usual way."""

from __future__ import annotations

import time
from typing import NamedTuple

import gymnasium
import numpy as np

_STRETCH_S = 0.1  # duration of stepping without a pause, from which the time of a step is computed
_ROUNDS = 3


class Other(NamedTuple):
    """Environment, the way in which Gymnasium vectorises it, and the largest number for which that is sensible."""

    name: str
    way: str
    mode: str
    largest: int


SYNC = Other("Pendulum-v1", "SyncVectorEnv", "sync", 1024)
ASYNC = Other("Pendulum-v1", "AsyncVectorEnv", "async", 16)
NATIVE = Other("CartPole-v1", "its native vector environment", "vector_entry_point", 10**7)


def step_rate(other: Other, count: int) -> float:
    """Measure environment steps per second of ``count`` environments; the best of three stretches."""
    env = gymnasium.make_vec(other.name, num_envs=count, vectorization_mode=other.mode)
    try:
        env.reset(seed=0)
        env.action_space.seed(0)
        actions = env.action_space.sample()
        env.step(actions)
        best = np.inf
        for _ in range(_ROUNDS):
            steps, spent, start = 0, 0.0, time.perf_counter()
            while spent < _STRETCH_S:
                env.step(actions)
                steps += 1
                spent = time.perf_counter() - start
            best = min(best, spent / steps)
    finally:
        env.close()
    return float(count / best)
