"""A task of one's own: a straight cut that is charged for the largest growth of the tip between two decisions."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._engine.jit import njit_inline, njit_internal
from cutenv.agents.policy import ConstantFeed, Features
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.gymnasium_facts import described
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.people.play.played_cut import PlayedCut
from cutenv.sim.quantities import WholeCutTerm
from cutenv.task.declare import CutNumber, Task, whole_fields
from cutenv.task.episode import TaskOptions
from cutenv.task.observation import COMPONENTS, Component
from cutenv.task.registry import RegisteredTask

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
    errors=(CutNumber(name="surge_mm", meaning="largest growth of the tip", value=lambda whole: 1e3 * whole.largest),),
    truth=(
        CutNumber(
            name="ahead_m", meaning="way from the tip to the target", value=lambda state, target: target - state.tip
        ),
    ),
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


@described
class SteadyCutEnv(GentleCutEnv):
    """The environment ``own/SteadyCut-v0``, with the further component, cost, end, numbers in the info and keyword

    {components}

    {terms}

    {ends}

    {truth}

    {errors}

    {keywords}
    """

    options_class = SteadyOptions


class SteadyCutVectorEnv(GentleCutVectorEnv):
    """Many of them."""

    single_class = SteadyCutEnv


class SteadyFeatures(Features):
    """Features of gentle cutting, which leave out the component that the task adds."""

    components = len(COMPONENTS) + 1


class SteadyFeed(ConstantFeed):
    """Script that goes on at one speed, whatever the component that the task adds."""

    def act(self, observations):
        """Return the actions, shape (n, 2)."""
        return super().act(observations[:, : len(COMPONENTS)])


class PlayedSteadyCut(PlayedCut):
    """Cut of it by a person."""

    environment = SteadyCutEnv


ENTRY = RegisteredTask(
    name="steady",
    id=STEADY_CUT.environment,
    task=STEADY_CUT,
    single=SteadyCutEnv,
    vector=SteadyCutVectorEnv,
    along="without a surge",
    features=SteadyFeatures,
    scripts={"steady feed": lambda: SteadyFeed(speed=0.01)},
    script="steady feed",
    options={"control_hz": 20},
    played=PlayedSteadyCut,
)
"""Its entry in the registry."""
