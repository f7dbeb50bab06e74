"""The environment's step beside the same steps of Gymnasium's own environments, in one process."""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import cutenv  # noqa: F401  registers the environment

ALLOWED_OVER_PENDULUM = 1.0
"""Largest acceptable time of a step, 20 force updates, over a step of Pendulum-v1."""

_ENVIRONMENTS = ("cutenv/GentleCut-v0", "Pendulum-v1", "CartPole-v1")


def step_times(steps: int = 4000, rounds: int = 5) -> dict[str, float]:
    """Microseconds per step of each environment, resets left out; the best of ``rounds`` interleaved rounds.

    Parameters
    ----------
    steps : int
        In a round, for each environment.
    rounds : int
        Interleaved, so that a busy machine slows all alike.
    """
    envs = {name: gymnasium.make(name) for name in _ENVIRONMENTS}
    best = dict.fromkeys(envs, np.inf)
    for _ in range(rounds):
        for name, env in envs.items():
            best[name] = min(best[name], _time_steps(env, _actions(env, steps)))
    for env in envs.values():
        env.close()
    return {name: float(seconds / steps * 1e6) for name, seconds in best.items()}


def reset_time(resets: int = 300) -> float:
    """Microseconds per reset of the cutting environment, a new specimen drawn each time."""
    env = gymnasium.make(_ENVIRONMENTS[0])
    env.reset(seed=0)
    start = time.perf_counter()
    for _ in range(resets):
        env.reset()
    return (time.perf_counter() - start) / resets * 1e6


def _actions(env: gymnasium.Env[Any, Any], steps: int) -> list[Any]:
    env.action_space.seed(0)
    if isinstance(env.action_space, gymnasium.spaces.Discrete):
        return [env.action_space.sample() for _ in range(steps)]
    # A steady cut for the blade, so that it works in tissue all the time.
    action: NDArray[np.float32] = np.full(env.action_space.shape or (), 0.15, np.float32)
    return [action] * steps


def _time_steps(env: gymnasium.Env[Any, Any], actions: list[Any]) -> float:
    env.reset(seed=0)
    total = 0.0
    start = time.perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            total += time.perf_counter() - start
            env.reset()
            start = time.perf_counter()
    return total + time.perf_counter() - start


def print_report() -> None:
    """Print steps beside Pendulum and CartPole, and resets."""
    times = step_times()
    own, pendulum = times["cutenv/GentleCut-v0"], times["Pendulum-v1"]
    print("one step through gymnasium.make, microseconds")
    for name, microseconds in times.items():
        print(f"  {name:22s} {microseconds:7.1f}   {microseconds / pendulum:5.2f} x Pendulum-v1")
    verdict = "within" if own <= ALLOWED_OVER_PENDULUM * pendulum else "MISSED:"
    print(f"  20 force updates a step; {verdict} the {ALLOWED_OVER_PENDULUM:g} x Pendulum-v1 allowed")
    print(f"  reset, a new specimen drawn: {reset_time():.0f} microseconds")
