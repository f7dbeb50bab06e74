"""The native vector environment for Stable-Baselines3, which takes no ``VectorEnv`` of Gymnasium's.

:class:`NativeVecEnv` adapts it as it is; :class:`CutVecEnv` shows what :class:`cutenv.policy.Features` makes of an
observation, followed by the hidden state, which only a critic reads, and takes actions before the dead zone.
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
    """``len(seeds)`` environments that step in one call; each draws its specimens from its own seed.

    Parameters
    ----------
    seeds : sequence of int
        Of the environments; the first reset of each begins with its seed's first episode, number 0.
    **arguments
        Keywords of ``cutenv/GentleCut-v1``.
    """

    def __init__(self, seeds: Sequence[int], **arguments: Any) -> None:
        self.native = GentleCutVectorEnv(len(seeds), autoreset_mode=AutoresetMode.DISABLED, **arguments)
        self.specimen_seeds = list(seeds)  # SB3 has a _seeds of its own
        self.first_episode = 0
        """Number of the episode with which :meth:`reset` begins every environment."""
        self._batch = self.native.batch
        self.seconds = 0.0
        """Spent in :meth:`reset` and :meth:`step_wait` so far."""
        self._returns, self._lengths = np.zeros(len(seeds)), np.zeros(len(seeds), int)
        self._begun = time.monotonic()
        self._actions = np.zeros((len(seeds), 2), np.float32)
        super().__init__(len(seeds), self.space(), self.native.single_action_space)

    def space(self) -> gymnasium.Space[Any]:
        """Of what an environment shows."""
        return self.native.single_observation_space

    @property
    def observations(self) -> np.ndarray:
        """The environment's own, shape (n, 12): written over by the next step."""
        return self._batch.observations

    def see(self) -> np.ndarray:
        """What the environments show after a step."""
        return self.observations.copy()

    def see_beginning(self, begun: np.ndarray) -> np.ndarray:
        """What the environments numbered ``begun`` show at their beginning."""
        return self.observations[begun]

    def reset(self) -> np.ndarray:
        """Begin every environment anew at :attr:`first_episode` of its seed."""
        start = time.perf_counter()
        self.native.reset(seed=self.specimen_seeds, options={"episode": self.first_episode})
        self._returns[:] = self._lengths[:] = 0
        seen = self.see_beginning(np.arange(self.num_envs))
        self.seconds += time.perf_counter() - start
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, shape (n, 2), that :meth:`step_wait` carries out."""
        self._actions[:] = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, ends and infos; a finished environment is begun anew at once."""
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
        """Nothing is held."""

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """No environment is wrapped; returns and lengths are in the infos all the same."""
        return [wrapper_class is Monitor] * len(list(self._get_indices(indices)))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, the same for all environments."""
        value = getattr(self.native.single, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: an environment is what it was made as."""
        raise NotImplementedError(f"{attr_name} cannot be set; make the environments anew with other keywords.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refused: there are no single environments."""
        raise NotImplementedError(f"{method_name} cannot be called; the environments step in one.")


class CutVecEnv(NativeVecEnv):
    """:class:`NativeVecEnv` with features, hidden state and dead zone.

    Parameters
    ----------
    seeds : sequence of int
        Of the environments.
    history : int
        Decisions of history among the features.
    dead_zone : float
        Share of the speed's action that means rest.
    force : bool
        Whether the features feel the force.
    **arguments
        Keywords of ``cutenv/GentleCut-v1``.
    """

    def __init__(
        self, seeds: Sequence[int], *, history: int, dead_zone: float, force: bool = True, **arguments: Any
    ) -> None:
        self._seen = FeatureBatch(len(seeds), history=history, force=force)
        self.features, self.dead_zone = self._seen.size, dead_zone
        self._all = np.arange(len(seeds))
        super().__init__(seeds, **arguments)

    def space(self) -> gymnasium.Space[Any]:
        """Of features and hidden state."""
        return gymnasium.spaces.Box(-np.inf, np.inf, (self.features + len(HIDDEN),), np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, shape (n, 2), before the dead zone."""
        super().step_async(past_dead_zone(actions, self.dead_zone))  # clipped by the environment

    def see(self) -> np.ndarray:
        """Features and hidden state, once per decision: features keep it in mind."""
        return reveal(self._batch.cuts, self._seen(self.observations), self._all)

    def see_beginning(self, begun: np.ndarray) -> np.ndarray:
        """The same of some at their beginning: what was kept in mind of their last cut is forgotten first."""
        self._seen.forget(begun)
        return reveal(self._batch.cuts, self._seen(self.observations[begun], begun), begun)
