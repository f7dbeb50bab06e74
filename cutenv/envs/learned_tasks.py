"""Tasks that agents learn and are compared on, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cutenv._base.validation import one_of
from cutenv.envs.batch import CutBatch
from cutenv.envs.depth_cut import DepthBatch, DepthCutEnv
from cutenv.envs.gentle_cut import GentleCutEnv


@dataclass(frozen=True, kw_only=True)
class LearnedTask:
    """One task: the id of its environment, and the classes of one environment and of a batch of its cuts."""

    id: str
    single: type[GentleCutEnv]
    batch: type[CutBatch]


TASKS = {
    "gentle": LearnedTask(id="cutenv/GentleCut-v1", single=GentleCutEnv, batch=CutBatch),
    "depth": LearnedTask(id="cutenv/DepthCut-v1", single=DepthCutEnv, batch=DepthBatch),
}
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
