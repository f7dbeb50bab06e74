"""The native vector environment as a Stable-Baselines3 VecEnv, since SB3 does not accept Gymnasium's ``VectorEnv``.

:class:`NativeVecEnv` adapts it unchanged; :class:`CutVecEnv` returns the features of :class:`cutenv.policy.Features`
followed by the hidden state, which only a critic reads, and applies a dead zone to the actions.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.policy.features import FeatureBatch, past_dead_zone
from cutenv.task.hidden import HIDDEN, reveal
from cutenv.task.records import ENDS


class NativeVecEnv(VecEnv):
    """Vector environment of ``len(seeds)`` cuts that step in one call; each samples its specimens from its own seed.

    Parameters
    ----------
    seeds : sequence of int
        Seeds of the environments; the first reset of each begins with its seed's first episode, number 0.
    **arguments
        Keyword arguments of ``cutenv/GentleCut-v1``.
    """

    def __init__(self, seeds: Sequence[int], **arguments: Any) -> None:
        self.native = GentleCutVectorEnv(len(seeds), autoreset_mode=AutoresetMode.DISABLED, **arguments)
        self.specimen_seeds = list(seeds)  # SB3 has a _seeds of its own
        self.first_episode = 0
        """Number of the episode with which :meth:`reset` begins every environment."""
        self._batch = self.native.batch
        self.seconds = 0.0
        """Time spent in :meth:`reset` and :meth:`step_wait` so far [s]."""
        self._returns, self._lengths = np.zeros(len(seeds)), np.zeros(len(seeds), int)
        self._begun = time.monotonic()
        self._actions = np.zeros((len(seeds), 2), np.float32)
        super().__init__(len(seeds), self.space(), self.native.single_action_space)

    def space(self) -> gymnasium.Space[Any]:
        """Return the observation space of one environment."""
        return self.native.single_observation_space

    @property
    def observations(self) -> np.ndarray:
        """The environments' own observations, shape (n, 12): overwritten by the next step."""
        return self._batch.observations

    def see(self) -> np.ndarray:
        """Return the observations after a step."""
        return self.observations.copy()

    def see_beginning(self, begun: np.ndarray) -> np.ndarray:
        """Return the first observations of the environments with indices ``begun``."""
        return self.observations[begun]

    def reset(self) -> np.ndarray:
        """Reset every environment to episode :attr:`first_episode` of its seed."""
        start = time.perf_counter()
        self.native.reset(seed=self.specimen_seeds, options={"episode": self.first_episode})
        self._returns[:] = self._lengths[:] = 0
        seen = self.see_beginning(np.arange(self.num_envs))
        self.seconds += time.perf_counter() - start
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions, shape (n, 2), for :meth:`step_wait`."""
        self._actions[:] = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step; return observations, rewards, ends and infos. A finished environment is reset at once."""
        start = time.perf_counter()
        rewards, (ends, *_) = self._batch.decide(self._actions)
        self._returns += rewards
        self._lengths += 1
        seen, ended = self.see(), ends != 0
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if ended.any():
            finished = np.flatnonzero(ended)
            success, now = self._batch.succeeded(), time.monotonic() - self._begun
            for n in finished:
                infos[n] = {
                    "episode": {"r": float(self._returns[n]), "l": int(self._lengths[n]), "t": now},
                    "is_success": bool(success[n]),
                    "end": ENDS[ends[n]],
                    "terminal_observation": seen[n].copy(),
                }
            self._batch.begin(finished)
            self._returns[finished] = self._lengths[finished] = 0
            seen[finished] = self.see_beginning(finished)
        self.seconds += time.perf_counter() - start
        return seen, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Do nothing: no resources are held."""

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """Return False for each: no environment is wrapped; returns and lengths are in the infos all the same."""
        return [wrapper_class is Monitor] * len(list(self._get_indices(indices)))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute, the same for all environments."""
        value = getattr(self.native.single, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise: attributes of an environment cannot be changed."""
        raise NotImplementedError(f"{attr_name} cannot be set; make the environments anew with other keywords.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Raise: there are no single environments."""
        raise NotImplementedError(f"{method_name} cannot be called; the environments step in one.")


class CutVecEnv(NativeVecEnv):
    """A :class:`NativeVecEnv` with features, hidden state and dead zone.

    Parameters
    ----------
    seeds : sequence of int
        Seeds of the environments.
    history : int
        Number of past decisions among the features.
    dead_zone : float
        Fraction of the range of the action's speed that means rest.
    force : bool
        Whether the features use the force.
    **arguments
        Keyword arguments of ``cutenv/GentleCut-v1``.
    """

    def __init__(
        self, seeds: Sequence[int], *, history: int, dead_zone: float, force: bool = True, **arguments: Any
    ) -> None:
        self._seen = FeatureBatch(len(seeds), history=history, force=force)
        self.features, self.dead_zone = self._seen.size, dead_zone
        self._all = np.arange(len(seeds))
        super().__init__(seeds, **arguments)

    def space(self) -> gymnasium.Space[Any]:
        """Return the space of features and hidden state."""
        return gymnasium.spaces.Box(-np.inf, np.inf, (self.features + len(HIDDEN),), np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions, shape (n, 2), after applying the dead zone."""
        super().step_async(past_dead_zone(actions, self.dead_zone))  # clipped by the environment

    def see(self) -> np.ndarray:
        """Return features and hidden state; to be called once per decision, because features have a memory."""
        return reveal(self._batch.cuts, self._seen(self.observations), self._all)

    def see_beginning(self, begun: np.ndarray) -> np.ndarray:
        """Return features and hidden state of environments that begin; the features' memory is reset first."""
        self._seen.forget(begun)
        return reveal(self._batch.cuts, self._seen(self.observations[begun], begun), begun)
