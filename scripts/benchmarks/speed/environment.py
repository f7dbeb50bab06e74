"""Time of a step, compared with Gymnasium's own environments in the same process."""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import cutenv  # noqa: F401  registers the environment
from scripts.benchmarks.speed.measured import Measured, Number, at_most, fastest

ALLOWED_OVER_PENDULUM = 1.0  # largest acceptable time of a step, 20 force updates, over a step of Pendulum-v1

_ENVIRONMENTS = ("cutenv/GentleCut-v1", "Pendulum-v1", "CartPole-v1")


def step_times(steps: int = 4000, rounds: int = 5) -> dict[str, float]:
    """Measure the time per step of each environment [us], without resets; the best of ``rounds`` interleaved rounds."""
    envs = {name: gymnasium.make(name) for name in _ENVIRONMENTS}
    best = dict.fromkeys(envs, np.inf)
    for _ in range(rounds):
        for name, env in envs.items():
            best[name] = min(best[name], _time_steps(env, _actions(env, steps)))
    for env in envs.values():
        env.close()
    return {name: float(seconds / steps * 1e6) for name, seconds in best.items()}


def reset_times(resets: int = 100, rounds: int = 5) -> dict[str, float]:
    """Measure the time per reset of each environment [us], each with a new specimen; the best of interleaved rounds."""
    envs = {name: gymnasium.make(name) for name in _ENVIRONMENTS}
    for env in envs.values():
        env.reset(seed=0)
    best = fastest({name: lambda env=env: [env.reset() for _ in range(resets)] for name, env in envs.items()}, rounds)
    for env in envs.values():
        env.close()
    return {name: seconds / resets * 1e6 for name, seconds in best.items()}


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


def measure() -> Measured:
    """Measure steps and resets next to those of Pendulum and CartPole."""
    steps, resets = step_times(), reset_times()
    pendulum = steps["Pendulum-v1"]
    over = steps[_ENVIRONMENTS[0]] / pendulum
    numbers = {f"step of {name}": Number(microseconds, "us") for name, microseconds in steps.items()}
    numbers |= {f"reset of {name}": Number(microseconds, "us") for name, microseconds in resets.items()}
    numbers["step over Pendulum-v1's"] = Number(over, "1")
    lines = ["one step through gymnasium.make, and one reset, microseconds"]
    for name, microseconds in steps.items():
        beside = f"{microseconds:7.1f}   {microseconds / pendulum:5.2f} x Pendulum-v1"
        lines.append(f"  {name:22s} {beside}   reset {resets[name]:6.1f}")
    lines.append(
        at_most("20 force updates a step", over, ALLOWED_OVER_PENDULUM, f"{ALLOWED_OVER_PENDULUM:g} x Pendulum-v1")
    )
    return Measured(numbers, lines)
