"""Fields of `info`, for people and tests, never for policies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._engine.declared import Formula
from cutenv.sim.cutting.law import (
    EnergyAccount,
    initiation_excess,  # used by a formula
)
from cutenv.sim.quantities import RUN_ALLOWED, overshoot
from cutenv.task.reward import TERMS


@dataclass(frozen=True, kw_only=True)
class InfoField:
    """Number of `info`, in SI unless its name has a unit.

    In its formulas ``total`` is what the milliseconds of the step add up to.
    """

    name: str
    group: str = ""  # dictionary of `info` that holds it; empty: `info` itself
    whole: bool = False  # True: a whole number
    value: Formula | None = None  # its value, of quantities of OF_INFO; None: a term of the reward
    each: Formula | None = None  # summand of every millisecond


OF_INFO = ("state", "law", "task", "energy", "modulus", "resistance")
"""Quantities of a field of hidden state: records of the cut, energy account, modulus and resistance at the tip."""
OF_COST = ("task", "tip", "tip_before", "info")
"""Quantities of the other fields: record of the task, tip as assessed at the end of the step and before [m], the fields
so far."""

INFO_FIELDS = (
    InfoField(name="tip_m", group="truth", value=lambda state: state.tip),
    InfoField(name="blade_m", group="truth", value=lambda state: state.blade),
    InfoField(name="fracture_resistance_J_m2", group="truth", value=lambda resistance: resistance),
    InfoField(name="modulus_Pa", group="truth", value=lambda modulus: modulus),
    InfoField(name="initiation_excess", group="truth", value=lambda law, state: initiation_excess(law, state.pushing)),
    InfoField(name="units", group="truth", whole=True, value=lambda state: state.units),
    InfoField(name="uncontrolled_m", group="truth", value=lambda state: state.uncontrolled),
    InfoField(name="target_length_m", group="truth", value=lambda task: task.target),
    InfoField(name="work", group="energy", value=lambda energy: energy.work),
    InfoField(name="stored", group="energy", value=lambda energy: energy.stored),
    InfoField(name="fracture", group="energy", value=lambda energy: energy.fracture),
    InfoField(name="friction", group="energy", value=lambda energy: energy.friction),
    InfoField(name="loss", group="energy", value=lambda energy: energy.loss),
    InfoField(name="ledger", group="energy", value=lambda energy: energy.ledger),
    InfoField(name="residual", group="energy", value=lambda energy: energy.residual),
    *(InfoField(name=name, group="reward_terms") for name in TERMS),
    InfoField(
        name="overshoot_mm",
        group="cost_terms",
        value=lambda tip, tip_before, task: 1e3 * (overshoot(tip, task.target) - overshoot(tip_before, task.target)),
    ),
    InfoField(
        name="long_runs_mm",
        group="cost_terms",
        each=lambda jump: max(jump - RUN_ALLOWED, 0.0),
        value=lambda total: 1e3 * total,
    ),
    InfoField(name="cost", value=lambda info: info.cost_terms_overshoot_mm + info.cost_terms_long_runs_mm),
    InfoField(
        name="out_of_range",
        whole=True,
        each=lambda speed, speed_min, speed_max: 0 if speed == 0.0 or speed_min <= speed <= speed_max else 1,
        value=lambda total: total,
    ),
)
"""Fields in order: truth (hidden state), energy (account since reset), reward_terms of the step, its cost [mm] and the
parts of it (growth of the overshoot, runs beyond 4 mm), and the updates of the step at a speed outside the measured
range."""


def column(field: InfoField) -> str:
    """Return the name of a field in :data:`INFO`."""
    return f"{field.group}_{field.name}" if field.group else field.name


INFO: np.dtype[Any] = np.dtype((np.record, [(column(field), "i8" if field.whole else "f8") for field in INFO_FIELDS]))
"""Structured dtype of all fields."""
GROUPS = {
    group: tuple(field for field in INFO_FIELDS if field.group == group)
    for group in dict.fromkeys(field.group for field in INFO_FIELDS if field.group)
}
"""Fields of each group."""
PLACES = {
    group: slice(INFO_FIELDS.index(fields[0]), INFO_FIELDS.index(fields[-1]) + 1) for group, fields in GROUPS.items()
}
"""Place of each group in a record, counted in fields, each 8 bytes wide."""
WHOLE_NUMBERS = tuple(number for number, field in enumerate(INFO_FIELDS) if field.whole)  # places of the whole numbers
COST, OUT_OF_RANGE = ([column(field) for field in INFO_FIELDS].index(name) for name in ("cost", "out_of_range"))
"""Places of the cost and of the updates out of range."""

assert tuple(field.name for field in GROUPS["energy"]) == EnergyAccount._fields
