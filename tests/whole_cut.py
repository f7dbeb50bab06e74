"""Whole cuts in the environment, by a policy or by a script of commands, with every reading kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np

import cutenv
from cutenv._base.arrays import joined_records
from cutenv.task.observation import in_units, to_action

ENVIRONMENT = "cutenv/GentleCut-v1"
assert ENVIRONMENT in gymnasium.registry, cutenv.__name__

UPRIGHT, INCLINED = math.radians(90.0), math.radians(45.0)
FASTEST = 0.0254  # of the actions [m/s]
CRUISE = 0.0127  # of the best constant feed, which is inclined [m/s]


class Cut(NamedTuple):
    """One episode: reward by step, terms by step, the last info, and every reading at 1 kHz, step after step."""

    rewards: np.ndarray
    terms: list[dict[str, float]]
    infos: list[dict[str, Any]]
    readings: np.ndarray
    observations: np.ndarray

    @property
    def total(self) -> float:
        return float(self.rewards.sum())

    @property
    def end(self) -> str:
        return self.infos[-1]["end"]

    @property
    def totals(self) -> dict[str, float]:
        """Every reward term, summed over the episode."""
        return {name: sum(terms[name] for terms in self.terms) for name in self.terms[0]}


class Script:
    """A policy written as a function of the decision's number and the observation in SI units."""

    def __init__(self, command: Callable[[int, dict[str, Any]], tuple[float, float]]) -> None:
        self._command = command

    def reset(self, rng: np.random.Generator) -> None:
        self._count = -1

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        self._count += 1
        return to_action(*self._command(self._count, in_units(observation)))


def make(**keywords: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(ENVIRONMENT, **keywords)


def steady(speed: float, angle: float = UPRIGHT) -> Script:
    """The same command for ever: it does not stop at the target."""
    return Script(lambda count, seen: (speed, angle))


def legs(*parts: tuple[float, float, float], control_hz: int = 50) -> Script:
    """Commands by the clock: (duration [s], speed [m/s], angle [rad]), one part after the other, then rest upright."""

    def command(count: int, seen: dict[str, Any]) -> tuple[float, float]:
        left = count / control_hz + 1e-9
        for duration, speed, angle in parts:
            if left < duration:
                return speed, angle
            left -= duration
        return 0.0, parts[-1][2]

    return Script(command)


def cut(env: gymnasium.Env[Any, Any], policy: Any, seed: int = 0, **options: Any) -> Cut:
    """One episode with ``policy`` on the specimen of ``seed``."""
    observation, _ = env.reset(seed=seed, options=options or None)
    policy.reset(np.random.default_rng(seed))
    return go_on(env, policy, observation)


def go_on(env: gymnasium.Env[Any, Any], policy: Any, observation: np.ndarray) -> Cut:
    """The rest of an episode that has begun."""
    rewards, terms, infos, readings, observations = [], [], [], [], []
    ended = False
    while not ended:
        observation, reward, ended, truncated, info = env.step(policy(observation))
        assert not truncated
        rewards.append(reward)
        terms.append(info["reward_terms"])
        infos.append(info)
        readings.append(env.unwrapped.cutting.readings.copy())
        observations.append(observation)
    return Cut(np.array(rewards), terms, infos, joined_records(readings), np.array(observations))


def interval(values: Any) -> tuple[float, float]:
    """95 % interval of the mean: 1.96 standard errors to either side."""
    values = np.asarray(values, dtype=float)
    half = 1.96 * values.std(ddof=1) / math.sqrt(values.size)
    return float(values.mean() - half), float(values.mean() + half)
