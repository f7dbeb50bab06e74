"""Tasks that agents learn and are compared on, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cutenv._base.validation import one_of
from cutenv.envs.depth_cut import DepthCutEnv, DepthCutVectorEnv
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.path_cut import PathCutEnv, PathCutVectorEnv
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.policy import BASELINES, Policy
from cutenv.policy.depth_planner import DepthPlanner
from cutenv.policy.depth_scripts import DEPTH_SCRIPTS
from cutenv.policy.path_planner import PathPlanner
from cutenv.policy.path_scripts import PATH_SCRIPTS
from cutenv.policy.policy_space import PolicySpace, space_of
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.path import PATH_CUT
from cutenv.task.privileged import PRIVILEGED_FEATURES, privileged_names


@dataclass(frozen=True, kw_only=True)
class LearnedTask:
    """One task: its environment, single and in batches, what a learner is shown, and the scripts to imitate."""

    id: str
    """Id of the environment."""
    single: type[GentleCutEnv]
    vector: type[GentleCutVectorEnv]
    privileged: tuple[str, ...]
    """Names of the hidden state that a critic is shown."""
    script: str
    """Name of the script that they imitate, and reach after some time, by default."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of PPO that differ from its defaults on this task."""
    policies: Mapping[str, Callable[[], Policy]]
    """Policies without a network by name, the scripts among them; call a value to make the policy."""

    shown: tuple[str, ...]
    """Scores in printed tables."""
    planner: Callable[[], Policy] | None = None
    """Maker of the planner with truth, where it is not among the policies."""

    @property
    def space(self) -> PolicySpace:
        """Components of an observation, actions, features and scripts."""
        return space_of(self.id)

    @property
    def scripts(self) -> tuple[str, ...]:
        """Names of the scripts that learners imitate, correct, and are compared with."""
        return tuple(self.space.scripts)


TASKS = {
    "gentle": LearnedTask(
        id="cutenv/GentleCut-v1", single=GentleCutEnv, vector=GentleCutVectorEnv,
        privileged=PRIVILEGED_FEATURES, script="return stroke", policies=BASELINES,
        shown=("return", "success", "tip_error_mm", "peak_force_N", "largest_jump_mm", "time_s"),
    ),
    "depth": LearnedTask(
        id="cutenv/DepthCut-v1", single=DepthCutEnv, vector=DepthCutVectorEnv,
        privileged=privileged_names(DEPTH_CUT), script="depth by two forces",
        options={
            "script": "depth by two forces", "base": "script", "hold": 2, "control_hz": 25, "timesteps": 12_000_000,
            "exploration": 0.05, "last_exploration": 0.02, "learning_rate": 5e-4, "epochs": 4, "batch_size": 8000,
            "critic_first": 0.05, "validation_specimens": 1000,
        },
        policies=DEPTH_SCRIPTS,
        shown=("return", "success", "mean_error_mm", "layer_mm", "peak_force_N", "time_s"), planner=DepthPlanner,
    ),
    "path": LearnedTask(
        id="cutenv/PathCut-v1", single=PathCutEnv, vector=PathCutVectorEnv,
        privileged=privileged_names(PATH_CUT), script="steer by force", policies=PATH_SCRIPTS,
        options={
            "script": "steer by force", "base": "script", "hold": 2, "control_hz": 25, "timesteps": 24_000_000,
            "exploration": 0.15, "last_exploration": 0.05, "learning_rate": 7e-4, "epochs": 4, "batch_size": 8000,
            "critic_first": 0.05, "validation_specimens": 1000,
        },
        shown=("return", "success", "mean_distance_mm", "largest_distance_mm", "peak_force_N", "time_s"),
        planner=PathPlanner,
    ),
}  # fmt: skip
"""Tasks by name."""


def task_of(arguments: Mapping[str, Any]) -> tuple[LearnedTask, dict[str, Any]]:
    """Return the task that ``arguments["task"]`` names, by default "gentle", and the environment's own arguments.

    Raises
    ------
    ValueError
        If there is no such task.
    """
    own = dict(arguments)
    return TASKS[one_of("task", own.pop("task", "gentle"), tuple(TASKS))], own
