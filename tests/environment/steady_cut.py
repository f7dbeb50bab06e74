"""A task of one's own: a straight cut that is charged for the largest growth of the tip between two decisions."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._engine.jit import njit_inline, njit_internal
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.declare import Task, whole_fields
from cutenv.task.episode import TaskOptions
from cutenv.task.observation import COMPONENTS, Component
from cutenv.task_quantities import WholeCutTerm

GROWTH = (Component(name="largest", meaning="largest growth of the tip in one decision", unit="m", scale=0.01),)
SURGE = (
    WholeCutTerm(
        name="surge",
        title="surge of the tip",
        text="largest growth of the tip in one decision / 10 mm",
        weight=0.3,
        per="per 10 mm of the largest growth",
        value=lambda largest: largest / 0.01,
    ),
)
STEADY: np.dtype[Any] = np.dtype(
    (np.record, [("weight_surge", "f8"), ("largest", "f8"), ("before", "f8"), *whole_fields(SURGE)])
)
"""Record of the whole cut."""
LIMIT = 0.006
"""Largest growth at which a cut ends for safety [m]."""
_NUMBER = len(COMPONENTS)


@njit_inline
def survey(whole, motion, step, k, tip):
    """Bring the largest growth up to date to a ``tip`` [m]."""
    whole.largest = max(whole.largest, tip - whole.before)
    whole.before = tip


@njit_inline
def breached(whole):
    """Return True if the tip has grown too far in one decision."""
    return whole.largest > LIMIT


@njit_inline
def observe(stepping, k, action, observation):
    """Fill the component that the task adds."""
    observation[_NUMBER] = stepping.cuts.wholes[stepping.row.cut[k]].largest / 0.01


@njit_internal
def observe_start(cuts, c, motion, observation):
    """Fill it at the start."""
    observation[_NUMBER] = 0.0


STEADY_CUT = Task(
    place=f"{__name__}:STEADY_CUT",
    environment="own/SteadyCut-v0",
    components=GROWTH,
    costs=SURGE,
    quantities=("largest", "target"),
    whole=STEADY,
    shown_as="steady",
    end="surge",
    end_text="the tip has grown by more than 6 mm in one decision; an end for safety",
    survey=survey,
    breached=breached,
    observe=observe,
    observe_start=observe_start,
    observe_seen=observe,
)


class SteadyOptions(TaskOptions):
    """Its options: the weight of its cost."""

    task = STEADY_CUT
    names = ("weight_surge",)

    def __init__(self, keywords):
        super().__init__(keywords)
        self.weight = keywords.pop("weight_surge", SURGE[0].weight)

    def whole(self):
        """Return the record before a cut begins."""
        record = np.zeros(1, STEADY)
        record["weight_surge"] = self.weight
        return record


class SteadyCutEnv(GentleCutEnv):
    """The environment ``own/SteadyCut-v0``."""

    options_class = SteadyOptions


class SteadyCutVectorEnv(GentleCutVectorEnv):
    """Many of them."""

    single_class = SteadyCutEnv
