"""Environments for LeRobot's hub: ``make_env`` for an ``env.py``, with the observations of this package's data sets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from numpy.typing import NDArray

from cutenv._base.validation import in_range
from cutenv.learning.demonstration import added_infos, felt_at_rest, felt_now
from cutenv.learning.lerobot_datasets import INSTRUCTION, measured_names
from cutenv.task.registry import task_of


class LeRobotEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Environment with LeRobot's names for what it observes.

    ``agent_pos`` is the data sets' ``observation.state``: what a rig measures, the force in newtons;
    ``environment_state`` the environment's own observation, scaled.

    Parameters
    ----------
    env : gymnasium.Env
        Environment of this package.

    Attributes
    ----------
    task, task_description : str
        Its id, and what is to be done in words.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        spec = env.spec
        assert spec is not None  # it was made by its id
        self.task, self.task_description = spec.id, INSTRUCTION
        self._max_episode_steps = spec.max_episode_steps
        self.state_names = measured_names(spec.id)
        state = Box(-np.inf, np.inf, (len(self.state_names),), np.float32)
        self.observation_space = Dict({"agent_pos": state, "environment_state": env.observation_space})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a cut; see the environment."""
        observation, info = super().reset(seed=seed, options=options)
        inner: Any = self.env.unwrapped
        felt = felt_at_rest(inner.cutting, inner.start_angle)
        return self._named(observation, felt, info), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Carry out a decision; see the environment."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        inner: Any = self.env.unwrapped
        return self._named(observation, felt_now(inner.cutting), info), reward, terminated, truncated, info

    def _named(self, observation: NDArray[np.float32], felt: dict[str, float], info: dict[str, Any]) -> dict[str, Any]:
        known = felt | added_infos(self.task, observation, info)
        state = np.array([known[name] for name in self.state_names], np.float32)
        return {"agent_pos": state, "environment_state": observation}


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None, *, environment: Mapping[str, Any] | None = None
) -> dict[str, dict[int, VectorEnv[Any, Any, Any]]]:
    """Make environments for LeRobot.

    Parameters
    ----------
    n_envs : int
        Number of environments that are stepped together.
    use_async_envs : bool
        True to give each a process of its own.
    cfg : object, optional
        LeRobot's ``EnvConfig``; its ``task``, where it has one, must be the environment's.
    environment : mapping, optional
        Keyword arguments of the environment, with "task" for another than gentle cutting.

    Returns
    -------
    dict
        Vector environments by the environment's id and a number, as LeRobot expects them.

    Raises
    ------
    ValueError
        If an argument is out of range, or ``cfg`` is for another task.
    """
    task, keywords = task_of(environment or {})
    count = round(in_range("n_envs", n_envs, 1, 4096, "1", "Give how many environments are stepped together."))
    wanted = getattr(cfg, "task", None)
    if wanted not in (None, "", task.id):
        raise ValueError(f"cfg.task = {wanted!r}: this is {task.id}. Leave the task out, or take another repository.")

    def made() -> LeRobotEnv:
        return LeRobotEnv(gymnasium.make(task.id, **keywords))

    kind = AsyncVectorEnv if use_async_envs else SyncVectorEnv
    vector = kind([made] * count, autoreset_mode=AutoresetMode.SAME_STEP)
    return {task.id: {0: vector}}
