"""Vector environment with features for Ray RLlib's environment runners."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from cutenv.agents.policy.features import Features
from cutenv.envs import set_cores
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.observation import CLIP

_INFO = ("is_success", "_is_success")  # the rest would be copied between processes


class RunnerEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Vector environment of ``num_envs`` cuts for Ray's runners.

    Environment i samples its specimens from seed ``first_seed + i``, whatever ``reset`` is given: RLlib's own seeds of
    its runners overlap, and two runners would cut the same specimens; see :meth:`share_seeds`.  Each starts again at
    the step after its end.  A resumed training begins at a ``first_episode`` where no specimen has been cut yet.
    """

    def __init__(
        self,
        num_envs: int,
        *,
        first_seed: int,
        history: int,
        first_episode: int = 0,
        **arguments: Any,
    ) -> None:
        self._native = GentleCutVectorEnv(num_envs, autoreset_mode=AutoresetMode.NEXT_STEP, **arguments)
        self.num_envs, self.metadata = num_envs, self._native.metadata
        self._first_seed, self._first_episode = first_seed, first_episode
        self._features = Features(num_envs, history=history)
        self._begins = np.zeros(num_envs, bool)
        self._fresh = True
        size = self._features.size
        self.single_observation_space = gymnasium.spaces.Box(-CLIP, CLIP, (size,), np.float32)
        self.single_action_space = self._native.single_action_space
        self.observation_space = gymnasium.spaces.Box(-CLIP, CLIP, (num_envs, size), np.float32)
        self.action_space = self._native.action_space

    @classmethod
    def of_runner(cls, context: Any) -> RunnerEnv:
        """Make a runner's environment from its ``EnvContext``, on one core."""
        set_cores(1)  # a process for each runner
        return cls(**{"num_envs": 1} | dict(context))

    @property
    def seeds(self) -> list[int]:
        """Seeds of the environments, one each, since the first ``reset``."""
        return [int(seed) for seed in self._native.batch.seeds]

    def share_seeds(self, runner: int) -> None:
        """Use runner number ``runner``'s share of the seeds, from 0."""
        self._first_seed += runner * self.num_envs

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Reset every cut to its seed's ``first_episode``, later the next."""
        seeds, first = None, {}
        if self._fresh:
            seeds = [self._first_seed + n for n in range(self.num_envs)]
            first = {"episode": self._first_episode}
        self._fresh = False
        observations, _ = self._native.reset(seed=seeds, options=first)
        self._begins = np.ones(self.num_envs, bool)
        seen = self._seen(observations)
        self._begins = np.zeros(self.num_envs, bool)
        return seen, {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step every environment by clipped actions, shape (num_envs, 2)."""
        observations, rewards, ended, truncated, info = self._native.step(actions)
        seen = self._seen(observations)
        self._begins = ended
        return seen, rewards, ended, truncated, {name: info[name] for name in _INFO if name in info}

    def _seen(self, observations: np.ndarray) -> np.ndarray:
        """Return the features, without memory for cuts that begin."""
        self._features.forget(np.flatnonzero(self._begins))
        return self._features(observations)
