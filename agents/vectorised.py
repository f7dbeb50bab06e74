"""Gentle cutting for Stable-Baselines3: all environments step in one compiled call, features and hidden state beside.

An observation is what the policy may see (:class:`cutenv.policy.Features`), followed by the hidden state, which only
the critic reads.  An action is that of the environment before the dead zone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from cutenv.cutting.records import READING, Records
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.policy.features import extract_batch, feature_count, forget, new_memory, past_dead_zone
from cutenv.task.assessment import succeeded
from cutenv.task.batch import HIDDEN, reveal_all, step_all
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, BOUND, COMPONENTS
from cutenv.task.records import ENDS, TERMS


class CutVecEnv(VecEnv):
    """``len(seeds)`` environments; each draws its specimens from its own seed, episode after episode.

    Parameters
    ----------
    seeds : sequence of int
        Of the environments.
    history : int
        Decisions of history among the features.
    dead_zone : float
        Share of the speed's action that means rest.
    **arguments
        Keywords of ``cutenv/GentleCut-v0``; the reward must come from hidden state.
    """

    def __init__(self, seeds: Sequence[int], *, history: int, dead_zone: float, **arguments: Any) -> None:
        self._specimen_seeds, self.dead_zone = list(seeds), dead_zone
        n = len(self._specimen_seeds)
        self._drawers = [GentleCutEnv(**arguments) for _ in range(n)]  # draw specimens; their cuts are made here
        self.features = feature_count(history)
        fixed = math.radians(arguments.get("fixed_angle_deg", 90.0))
        self._fixed_angle = (fixed - ANGLE_CENTRE) / ANGLE_SCALE if arguments.get("angle_mode") == "fixed" else None
        self._memory, self._frames = new_memory(n, history)
        self.observations = np.zeros((n, len(COMPONENTS)), np.float32)
        self._hidden = np.zeros((n, len(HIDDEN)))
        self._terms = np.zeros((n, len(TERMS)))
        self._returns, self._lengths = np.zeros(n), np.zeros(n, int)
        self._begun = time.monotonic()
        self._actions = np.zeros((n, 2))
        first = self._draw(0, self._specimen_seeds[0])
        self._records = [np.repeat(record, n, axis=0) for record in first]
        self._readings = np.zeros((n, self._drawers[0].cutting.ticks), READING)
        super().__init__(
            n,
            gymnasium.spaces.Box(-np.inf, np.inf, (self.features + len(HIDDEN),), np.float32),
            gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32),
        )

    def _draw(self, n: int, seed: int | None = None) -> list[Records]:
        """The next specimen of environment ``n``: states, profile, law, drive, sensor, task, progress, nominal."""
        env = self._drawers[n]
        self.observations[n] = env.reset(seed=seed)[0]
        start = env.plant.snapshot()
        task, progress = env.cutting.assessment()
        parts = (start.states, start.profile[None], start.laws, start.drives, start.sensors, task, progress)
        return [*parts, env.cutting.nominal[None]]

    def _restart(self, n: int, seed: int | None = None) -> None:
        for records, own in zip(self._records, self._draw(n, seed), strict=True):
            records[n] = own[0]
        forget(self._memory, self._frames, n)
        self._returns[n] = self._lengths[n] = 0

    def _see(self, first: int, end: int) -> np.ndarray:
        """What environments ``first`` to ``end`` show, once per decision: features keep it in mind."""
        own = slice(first, end)
        states, profiles, _, _, _, tasks, _, _ = (records[own] for records in self._records)
        reveal_all(states, profiles, tasks, self._hidden[own])
        features = extract_batch(self._memory[own], self._frames[own], self.observations[own])
        return np.concatenate((features, np.clip(self._hidden[own], -BOUND, BOUND).astype(np.float32)), axis=1)

    def reset(self) -> np.ndarray:
        """Begin every environment anew at its seed's first episode."""
        for n, seed in enumerate(self._specimen_seeds):
            self._restart(n, seed)
        return self._see(0, self.num_envs)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, shape (n, 2), that :meth:`step_wait` carries out."""
        self._actions[:] = past_dead_zone(np.clip(actions, -1.0, 1.0), self.dead_zone)
        if self._fixed_angle is not None:
            self._actions[:, 1] = self._fixed_angle

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, ends and infos; a finished environment is begun anew at once."""
        step_all(*self._records, self._actions, self._readings, self._terms, self.observations)
        rewards = self._terms.sum(axis=1)
        self._returns += rewards
        self._lengths += 1
        progresses, tasks = self._records[6], self._records[5]
        ends = progresses["end"].copy()
        seen = self._see(0, self.num_envs)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for n in np.flatnonzero(ends):
            infos[n] = {
                "episode": {
                    "r": float(self._returns[n]),
                    "l": int(self._lengths[n]),
                    "t": time.monotonic() - self._begun,
                },
                "is_success": bool(succeeded(tasks[n], progresses[n])),
                "end": ENDS[ends[n]],
                "terminal_observation": seen[n].copy(),
            }
            self._restart(n)
            seen[n] = self._see(n, n + 1)
        return seen, rewards.astype(np.float32), ends != 0, infos

    def close(self) -> None:
        """Nothing is held."""

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """No environment is wrapped; returns and lengths are in the infos all the same."""
        return [wrapper_class is Monitor] * len(list(self._get_indices(indices)))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the environments that draw the specimens."""
        return [getattr(self._drawers[n], attr_name) for n in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: an environment is what it was made as."""
        raise NotImplementedError(f"{attr_name} cannot be set; make the environments anew with other keywords.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refused: nothing but drawing is done by single environments."""
        raise NotImplementedError(f"{method_name} cannot be called; the environments step in one.")
