"""Gentle cutting of soft tissue: measured forces, a law that conserves energy, tasks for agents and people.

Importing it registers the environments with Gymnasium by name; heavy modules are imported when one is made.
"""

from __future__ import annotations

import gymnasium

__version__ = "0.1.0"

gymnasium.register(
    id="cutenv/GentleCut-v1",
    entry_point="cutenv.envs.gentle_cut:GentleCutEnv",
    vector_entry_point="cutenv.envs.vector:GentleCutVectorEnv",
)
gymnasium.register(id="cutenv/RigCut-v1", entry_point="cutenv.envs.rig_cut:RigCutEnv", nondeterministic=True)
