"""Gentle cutting of soft tissue: physics, tasks, agents and people.

Importing it registers the environments with Gymnasium by name; heavy modules are imported when one is made.
"""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium

from cutenv.task.registry import TASKS, RegisteredTask

__version__ = "0.1.0"


def register(task: RegisteredTask) -> None:
    """Register a task with Gymnasium, commands, reports and learners."""
    TASKS[task.name] = task
    places = task.places
    gymnasium.register(id=task.id, entry_point=places["single"], vector_entry_point=places["vector"])
    if task.rig_id:
        gymnasium.register(id=task.rig_id, entry_point=places["rig"], nondeterministic=True)


for _task in TASKS.values():
    register(_task)
for _track in ("SafeCut", "GentleCutRaw"):
    gymnasium.register(
        id=f"cutenv/{_track}-v1",
        entry_point=f"cutenv.envs.tracks:{_track}Env",
        vector_entry_point=f"cutenv.envs.tracks:{_track}VectorEnv",
    )
gymnasium.register(id="cutenv/FreeCut-v1", entry_point="cutenv.envs.free_cut:FreeCutEnv")
WINGS = (
    "agents", "commands", "display", "drivers", "emulation", "envs", "people", "records", "rig", "sim", "task",
    "vision",
)  # fmt: skip
"""Packages of the first level, imported when they are used."""


def __getattr__(name: str) -> Any:
    if name in WINGS:
        return importlib.import_module(f"cutenv.{name}")
    if name == "make":
        return gymnasium.make
    raise AttributeError(f"module 'cutenv' has no attribute {name!r}; it has {', '.join(__dir__())}.")


def __dir__() -> list[str]:
    return sorted(["__version__", "make", "register", *WINGS])
