"""Cuts of the tasks with a third axis by a policy, one at a time and many at once."""

from __future__ import annotations

import numpy as np

from cutenv.agents.learning.evaluation import Contestant, evaluate
from cutenv.task.registry import TASKS

SPECIMENS = {"depth": range(7000, 7030), "path": range(7000, 7120)}


def cut(task, policy, seed, **keywords):
    """Cut the first specimen of a seed; return the environment, the return and the last info."""
    env = TASKS[task].single(**keywords)
    observation, info = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    total, ended = 0.0, False
    while not ended:
        observation, reward, ended, _, info = env.step(policy(observation))
        total += reward
    return env, total, info


def returns(task, policy, seeds=None, **keywords):
    """Return of a policy on the first specimen of each seed."""
    seeds = seeds or SPECIMENS[task]
    rows = evaluate({"it": Contestant(policy)}, seeds, {"task": task, **keywords}, processes=1)
    return np.array([row["return"] for row in rows])
