"""Gentle cutting of soft tissue: measured forces, a law that conserves energy, tasks for agents and people.

Importing it registers the environments with Gymnasium by name; heavy modules are imported when one is made.
"""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium

__version__ = "0.1.0"

gymnasium.register(
    id="cutenv/GentleCut-v1",
    entry_point="cutenv.envs.gentle_cut:GentleCutEnv",
    vector_entry_point="cutenv.envs.vector:GentleCutVectorEnv",
)
gymnasium.register(
    id="cutenv/DepthCut-v1",
    entry_point="cutenv.envs.depth_cut:DepthCutEnv",
    vector_entry_point="cutenv.envs.depth_cut:DepthCutVectorEnv",
)
gymnasium.register(
    id="cutenv/PathCut-v1",
    entry_point="cutenv.envs.path_cut:PathCutEnv",
    vector_entry_point="cutenv.envs.path_cut:PathCutVectorEnv",
)
for _track in ("SafeCut", "GentleCutRaw"):
    gymnasium.register(
        id=f"cutenv/{_track}-v1",
        entry_point=f"cutenv.envs.tracks:{_track}Env",
        vector_entry_point=f"cutenv.envs.tracks:{_track}VectorEnv",
    )
gymnasium.register(id="cutenv/RigCut-v1", entry_point="cutenv.envs.rig_cut:RigCutEnv", nondeterministic=True)
gymnasium.register(
    id="cutenv/RigDepthCut-v1", entry_point="cutenv.envs.rig_depth_cut:RigDepthCutEnv", nondeterministic=True
)
gymnasium.register(
    id="cutenv/RigPathCut-v1", entry_point="cutenv.envs.rig_path_cut:RigPathCutEnv", nondeterministic=True
)

_LAZY = (
    "envs",
    "measurement",
    "plant",
    "policy",
    "recording",
    "report",
    "rig",
    "scoring",
    "sim_to_real",
    "tissue",
    "trace",
    "viewer",
)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return importlib.import_module(f"cutenv.{name}")
    if name == "make":
        return gymnasium.make
    raise AttributeError(f"module 'cutenv' has no attribute {name!r}; it has {', '.join(__dir__())}.")


def __dir__() -> list[str]:
    return sorted(["__version__", "make", *_LAZY])
