"""Gymnasium environments of every task: single, vectorized, and on a rig.

They step the tasks of :mod:`cutenv.task` in the simulator (:mod:`cutenv.sim`) or on a rig (:mod:`cutenv.rig`). Make
them by name, ``gymnasium.make("cutenv/GentleCut-v1")``, or by the classes listed here. Nothing below this package knows
Gymnasium.

May import: emulation, drivers, rig, display, vision, task, records, sim.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv._base.imports import import_when_used

if TYPE_CHECKING:
    from cutenv._engine.parallel import cores, set_cores
    from cutenv.envs.depth_cut import DepthCutEnv, DepthCutVectorEnv
    from cutenv.envs.gentle_cut import GentleCutEnv
    from cutenv.envs.path_cut import PathCutEnv, PathCutVectorEnv
    from cutenv.envs.rig_cut import RigCutEnv, RigDepthCutEnv, RigPathCutEnv
    from cutenv.envs.shared_control import SharedControl
    from cutenv.envs.vector import GentleCutVectorEnv

__all__ = [
    "DepthCutEnv",
    "DepthCutVectorEnv",
    "GentleCutEnv",
    "GentleCutVectorEnv",
    "PathCutEnv",
    "PathCutVectorEnv",
    "RigCutEnv",
    "RigDepthCutEnv",
    "RigPathCutEnv",
    "SharedControl",
    "cores",
    "set_cores",
]

# The simulator's environments need no module of the rig.
__getattr__ = import_when_used(
    __name__,
    {
        "DepthCutEnv": "cutenv.envs.depth_cut",
        "DepthCutVectorEnv": "cutenv.envs.depth_cut",
        "GentleCutEnv": "cutenv.envs.gentle_cut",
        "GentleCutVectorEnv": "cutenv.envs.vector",
        "PathCutEnv": "cutenv.envs.path_cut",
        "PathCutVectorEnv": "cutenv.envs.path_cut",
        "RigCutEnv": "cutenv.envs.rig_cut",
        "RigDepthCutEnv": "cutenv.envs.rig_cut",
        "RigPathCutEnv": "cutenv.envs.rig_cut",
        "SharedControl": "cutenv.envs.shared_control",
        "cores": "cutenv._engine.parallel",
        "set_cores": "cutenv._engine.parallel",
    },
)
