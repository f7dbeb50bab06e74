"""Agents: policies, their training, and comparison in simulation and on rigs.

- :mod:`~cutenv.agents.policy`: scripts, planners and trained networks, as functions from an observation to an action;
  needs NumPy alone;
- :mod:`~cutenv.agents.learning`: learners, evaluation with intervals, data sets, leaderboard (extra ``rl``);
- :mod:`~cutenv.agents.sb3`: environments for Stable-Baselines3 (extra ``rl``);
- :mod:`~cutenv.agents.sim_to_real`: whether a policy does on a rig what it does in the simulator, and which of two is
  better;
- :mod:`~cutenv.agents.difficulty`: what scripts get on the specimen of a record.

May import: envs, emulation, drivers, rig, display, vision, task, records, sim.
"""

from __future__ import annotations

from cutenv._base.imports import import_when_used

__all__ = ["difficulty", "learning", "policy", "sb3", "sim_to_real"]

__getattr__ = import_when_used(__name__, {}, __all__)
