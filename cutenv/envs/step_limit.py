"""Most steps of a cut, which its own options set, in the ``spec`` of its environment."""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol

from gymnasium.envs.registration import EnvSpec


def most_steps(deadline: float, ticks: int) -> int:
    """Return the number of decisions, each of ``ticks`` [ms], at the last of which a ``deadline`` [s] ends a cut."""
    return math.ceil(math.ceil(1000.0 * deadline - 0.5) / ticks)


class _Limited(Protocol):
    most_steps: int


class LimitedSpec:
    """``spec`` of an environment, whose ``max_episode_steps`` are those of its own deadline and rate of decisions.

    An entry of Gymnasium's registry has none: Gymnasium would wrap a TimeLimit with it around every environment, which
    would cut short the cuts of one that decides more often.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._kept = f"_{name}"

    def __get__(self, env: _Limited | None, owner: type) -> EnvSpec | None:
        return None if env is None else env.__dict__.get(self._kept)

    def __set__(self, env: _Limited, spec: EnvSpec | None) -> None:
        told = spec and dataclasses.replace(spec, max_episode_steps=env.most_steps)
        env.__dict__[self._kept] = told
