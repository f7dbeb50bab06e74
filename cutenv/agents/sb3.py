"""Vector environments for Stable-Baselines3, over the compiled batch.

``NativeVecEnv`` and ``FeatureVecEnv``.

Stable-Baselines3 takes no ``VectorEnv`` of Gymnasium; these step all environments in one compiled call, some hundred
times faster than its ``DummyVecEnv`` over single environments.  They need the extra ``rl``::

    from stable_baselines3 import PPO
    from cutenv.agents.sb3 import FeatureVecEnv

    environments = FeatureVecEnv(64, control_hz=10)
    model = PPO("MlpPolicy", environments, n_steps=128, batch_size=1024, gamma=1.0)
    model.learn(500_000)
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from cutenv._base.imports import extra_named
from cutenv._base.validation import in_range, one_of
from cutenv.agents.policy.interface import script_of
from cutenv.envs.gentle_cut import RESET_OPTIONS
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.info import INFO
from cutenv.task.registry import task_of
from cutenv.task.reward import REWARD

with extra_named("rl"):
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv

__all__ = ["FeatureVecEnv", "NativeVecEnv"]

_GAINS = tuple(f"reward_terms_{term.name}" for term in REWARD if term.gain or term.end_gain)


class NativeVecEnv(VecEnv):
    """Vector environment of ``cutenv/GentleCut-v1``, or another task, for Stable-Baselines3.

    A cut that has ended starts again within the same step; its return and length are in ``info["episode"]``, as from
    Stable-Baselines3's ``Monitor``, with its ``cost``, beside ``is_success``, ``end`` and ``terminal_observation``.
    Every info has the ``cost`` of the step [mm].

    Parameters
    ----------
    seeds : int or sequence of int
        Number of environments, whose seeds then are 0, 1, 2, ... until :meth:`seed` gives others, as ``PPO(...,
        seed=...)`` does; or the seed of each, which is kept.  An environment draws its specimens, one for each episode,
        from its own seed.
    hidden_state : bool
        Whether the hidden state of the simulator follows the observation, for a critic such as that of
        :mod:`cutenv.agents.learning.asymmetric_actors` or the fully observed twin of ``cutenv/GentleCutRaw-v1``.  A
        policy that reads it cannot be used on a rig.
    task : str
        Name of the task, of :data:`cutenv.task.registry.TASKS`.
    **arguments
        Keyword arguments of the environment; :data:`cutenv.envs.tracks.PROTOCOL` are those of the tracks.
    """

    def __init__(
        self, seeds: int | Sequence[int], *, hidden_state: bool = False, task: str = "gentle", **arguments: Any
    ) -> None:
        self._task, _ = task_of({"task": task})
        self._hidden = len(self._task.privileged) if hidden_state else 0  # numbers after the observation
        self._keeps_seeds = not isinstance(seeds, int)
        self.specimen_seeds = list(range(seeds) if isinstance(seeds, int) else seeds)  # SB3 has a _seeds of its own
        """Seed of each environment."""
        count = len(self.specimen_seeds)
        self.native: GentleCutVectorEnv = self._task.vector(count, autoreset_mode=AutoresetMode.DISABLED, **arguments)
        self.first_episode = 0
        """Number of the episode with which :meth:`reset` begins every environment."""
        self.seconds = 0.0
        """Time spent in :meth:`reset` and :meth:`step_wait` so far [s]."""
        self.cuts = 0
        """Number of cuts begun so far."""
        self._batch = self.native.batch
        self._returns, self._costs, self._lengths = np.zeros(count), np.zeros(count), np.zeros(count, int)
        self._infos = np.empty(count, INFO)
        self._begun = time.monotonic()
        self._actions = np.zeros((count, len(self.native.single.task.action_names)), np.float32)
        super().__init__(count, self._make_observation_space(), self.native.single_action_space)

    def _make_observation_space(self) -> gymnasium.Space[Any]:
        """Return the space of one environment's observations."""
        space = self.native.single_observation_space
        if not self._hidden:
            return space
        assert isinstance(space, gymnasium.spaces.Box)
        size = space.shape[0] + self._hidden
        return gymnasium.spaces.Box(space.low[0], space.high[0], (size,), np.float32)

    @property
    def observations(self) -> np.ndarray:
        """Observations, shape (n, k), overwritten by the next step."""
        observations: np.ndarray = self._batch.observations
        return observations

    @property
    def gained(self) -> np.ndarray:
        """Gains of the last decision, (n,): rewards without costs."""
        gains: np.ndarray = sum((self._infos[name] for name in _GAINS), np.zeros(self.num_envs))
        return gains

    def _observe(self) -> np.ndarray:
        """Return the observations after a step; called once for each decision."""
        return self._with_hidden_state(self.observations, np.arange(self.num_envs))

    def _observe_start(self, started: np.ndarray) -> np.ndarray:
        """Return initial observations of the environments at these indices."""
        return self._with_hidden_state(self.observations[started], started)

    def _with_hidden_state(self, shown: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return a copy of numbered environments' observations, with any hidden state."""
        return self._batch.append_hidden(shown, numbers) if self._hidden else shown.copy()

    def reset(self) -> np.ndarray:
        """Reset each environment to its seed's :attr:`first_episode`, with set options."""
        start = time.perf_counter()
        wanted = self._options
        self._reset_options()  # they hold for one reset, even if it refuses them
        groups: dict[int, list[int]] = {}  # environments by their options; equal ones are one object
        for n, options in enumerate(wanted):
            groups.setdefault(id(options) if options else 0, []).append(n)
        for which in groups.values():
            mask = np.zeros(self.num_envs, bool)
            mask[which] = True
            options = {"episode": self.first_episode, **wanted[which[0]], "reset_mask": mask}
            self.native.reset(seed=self.specimen_seeds, options=options)
        self._returns[:] = self._costs[:] = self._lengths[:] = 0
        self.cuts += self.num_envs
        shown = self._observe_start(np.arange(self.num_envs))
        self.seconds += time.perf_counter() - start
        return shown

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seed environment i by ``seed + i``, or randomly; return the seeds.

        They count from the next reset on.  Seeds that were given one by one are kept, and returned.
        """
        if not self._keeps_seeds:
            first = int(np.random.default_rng().integers(2**32)) if seed is None else int(seed)
            self.specimen_seeds = [first + n for n in range(self.num_envs)]
        return list(self.specimen_seeds)

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Set the next reset's options, for all environments or each.

        They are those of ``GentleCutEnv.reset``.

        Raises
        ------
        ValueError
            If there is no such option, or a list is not one for each environment.
        """
        if isinstance(options, list) and len(options) != self.num_envs:
            raise ValueError(
                f"options holds {len(options)} entries; give one for each of {self.num_envs} environments."
            )
        for each in options if isinstance(options, list) else [options or {}]:
            for name in each:
                one_of("option", name, RESET_OPTIONS)
        super().set_options(options)

    def step_async(self, actions: np.ndarray) -> None:
        """Store actions, (n, 2), or (n, 3) with depth, for :meth:`step_wait`."""
        self._actions[:] = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, rewards, ends and infos; ended cuts restart at once."""
        start = time.perf_counter()
        rewards, ends = self._batch.decide(self._actions, infos=self._infos)
        self._returns += rewards
        self._costs += self._infos["cost"]
        self._lengths += 1
        shown, ended = self._observe(), ends != 0
        infos: list[dict[str, Any]] = [{"cost": cost} for cost in self._infos["cost"].tolist()]
        if ended.any():
            finished = np.flatnonzero(ended)
            success, now = self._batch.succeeded(), time.monotonic() - self._begun
            for n in finished:
                returned, cost, length = float(self._returns[n]), float(self._costs[n]), int(self._lengths[n])
                infos[n] |= {
                    "episode": {"r": returned, "l": length, "t": now, "cost": cost},
                    "is_success": bool(success[n]),
                    "end": str(self._batch.end_names[ends[n]]),
                    "terminal_observation": shown[n].copy(),
                }
            self._batch.begin(finished)
            self.cuts += len(finished)
            self._returns[finished] = self._costs[finished] = self._lengths[finished] = 0
            shown[finished] = self._observe_start(finished)
        self.seconds += time.perf_counter() - start
        return shown, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Do nothing: the environments hold no files, processes or windows."""

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """Return True for ``Monitor`` alone, whose infos are provided."""
        return [wrapper_class is Monitor] * len(list(self._get_indices(indices)))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of ``GentleCutEnv``, the same for all environments."""
        value = getattr(self.native.single, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise NotImplementedError: keyword arguments of environments are fixed."""
        raise NotImplementedError(f"{attr_name} cannot be set; make new environments with other keyword arguments.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Raise NotImplementedError: there are no single environments with methods."""
        raise NotImplementedError(f"{method_name} cannot be called; all environments step in one call.")


class FeatureVecEnv(NativeVecEnv):
    """Environments of ``cutenv train``: the observations are features.

    An observation is the output of :class:`cutenv.agents.policy.Features`: forces by depth, an estimate of the crack
    tip, the distance to the target; or of the task's own class of features.  The action of the ``script`` follows, if
    there is one.  The attribute ``features`` is the size of both.

    Parameters
    ----------
    seeds : int or sequence of int
        See :class:`NativeVecEnv`.
    history : int
        Number of past decisions among the features.
    force : bool
        Whether the features include the force.
    script : str, optional
        Script to whose action the learner's is added (residual policy learning: Silver, Allen, Tenenbaum and Kaelbling,
        2018).  In a ``terminal_observation`` its action is 0.
    hold : int
        Number of the environment's decisions that a step makes: the script decides at each, and what the learner adds
        is held.  A cut that begins within a step has the script alone until the next.
    hidden_state, task, **arguments
        See :class:`NativeVecEnv`.

    Raises
    ------
    ValueError
        If there is no such script, or ``hold`` is no whole number from 1, or has no script to hold for.
    """

    def __init__(
        self,
        seeds: int | Sequence[int],
        *,
        history: int = 0,
        force: bool = True,
        script: str | None = None,
        hold: int = 1,
        hidden_state: bool = False,
        task: str = "gentle",
        **arguments: Any,
    ) -> None:
        count, (learned, _) = seeds if isinstance(seeds, int) else len(seeds), task_of({"task": task})
        if in_range("hold", hold, 1, 1000, "1", "Give the number of decisions.") % 1.0:
            raise ValueError(f"hold = {hold} is not a whole number of decisions.")
        if hold > 1 and script is None:
            raise ValueError(f"hold = {hold} has no effect without a script. Give script, or leave hold out.")
        self._features = learned.features(count, history=history, force=force)
        self._script, self._hold = None if script is None else script_of(learned, script), hold
        self._scripted = np.zeros((count, 0 if script is None else len(learned.task.action_names)), np.float32)
        self.features = self._features.size + self._scripted.shape[1]
        self._all = np.arange(count)
        super().__init__(seeds, hidden_state=hidden_state, task=task, **arguments)

    def _make_observation_space(self) -> gymnasium.Space[Any]:
        size = self.features + self._hidden
        return gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def _observe(self) -> np.ndarray:
        return self._shown(self._features(self.observations), self._all)

    def _observe_start(self, started: np.ndarray) -> np.ndarray:
        self._features.forget(started)  # the features of the cut before
        return self._shown(self._features(self.observations[started], started), started)

    def _shown(self, features: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return features, room for the script's action, and any hidden state."""
        place = np.zeros((len(features), self._scripted.shape[1]), np.float32)
        shown = np.concatenate([features, place], axis=1) if self._script else features
        return self._with_hidden_state(shown, numbers)

    def _with_script(self, shown: np.ndarray) -> np.ndarray:
        """Fill in the script's actions, decided once for all environments."""
        if self._script is not None:
            start = time.perf_counter()
            self._scripted = self._script.act(self.observations)
            shown[:, self._features.size : self.features] = self._scripted
            self.seconds += time.perf_counter() - start
        return shown

    def reset(self) -> np.ndarray:
        """Reset every environment as :meth:`NativeVecEnv.reset` does."""
        shown = super().reset()
        if self._script is not None:
            self._script.begin([np.random.default_rng() for _ in self._all])
        return self._with_script(shown)

    def step_async(self, actions: np.ndarray) -> None:
        """Store actions, (n, 2) or (n, 3), added to the script's."""
        if self._script is None:
            super().step_async(actions)
        else:
            self._added = np.array(actions, np.float32)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, rewards, ends and infos; ended cuts restart at once."""
        if self._script is None:
            return super().step_wait()
        rewards, ended = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        infos: list[dict[str, Any]] = [{"cost": 0.0} for _ in self._all]
        for _ in range(self._hold):
            super().step_async(np.clip(self._scripted + self._added, -1.0, 1.0))
            shown, earned, ends, seen = super().step_wait()
            for n in np.flatnonzero(~ended).tolist():
                infos[n] = {**seen[n], "cost": infos[n]["cost"] + seen[n]["cost"]}
            rewards[~ended] += earned[~ended]
            ended |= ends
            self._added[ended] = 0.0
            self._script.forget(np.flatnonzero(ends))
            shown = self._with_script(shown)
        return shown, rewards, ended, infos
