"""Reward terms and weights, and ends and limits of cuts.

Reward = what is gained - costs.  A cut gains up to 1: by progress, by a tip near the target, by a success.  All costs
are non-negative and additive: they are charged as they occur.  Every end is charged the same terminal cost; an end for
safety also pays the most that stopping could still have lost, so that it never pays to end early:

    time left, the whole of accuracy and success, a full wedge, and a tissue left loaded.

What a cut achieves is gained and not charged for when it is missed.  The sums differ by a constant, but to a learner
that discounts, a charge at the end is a reason to put off the end.

Costs that only time bounds (force, lag, jumps, backward travel) are not part of that largest cost: a policy that
stops and unloads avoids them, so a breach costs more than stopping in every state.

An entry of a table is all that a term or an end consists of: the compiled assessment, the layout of its records, the
weights and their keywords, ``info``, docstrings and labels of reports are made from it.  Its formulas are lambdas whose
parameters name quantities: of a millisecond (:data:`OF_MILLISECOND`), a step (:data:`OF_STEP`) or an end
(:data:`OF_END`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv._engine.declared import Formula
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.quantities import (
    DECELERATION,
    FORCE_ALLOWED,
    FORCE_LIMIT_PER_DEPTH,
    LAG_ALLOWED,
    LAG_CHARGED,
    OVERSHOOT_ALLOWED,
    TIME_SCALE,
    TIP_TOLERANCE,
    WholeCutTerm,
    closeness,
    force_per_depth,
    lag,
    wedge,
)
from cutenv.sim.tissue.grid import N_POINTS
from cutenv.task.observation import SPEED_SCALE, speed_action

WITHDRAWN = 0.020
"""Distance of drawing back unloaded after which the cut is finished [m]."""
TIME_AT_REST = 0.3
"""Time at rest and unloaded after which the cut is finished [s]."""
WORST_STORED = 2.0
"""Largest stored energy that is charged at an end, in R B 3 mm: a tip 12 mm behind at F = R B."""

OF_MILLISECOND = (
    "felt", "force", "force_limit", "depth", "position", "moved", "speed", "tip", "jump", "touched", "time", "quiet",
    "withdrawn", "target", "deadline", "speed_min", "speed_max",
)  # fmt: skip
"""Quantities of a millisecond, in SI units: measured force; force on the blade and its limit (true or measured, its
size), depth of cut; position of the blade, its motion and the size of its speed; crack tip and its unstable growth
(true or estimated); 1 if the blade has loaded the tissue before; time since reset, time at rest and unloaded, distance
drawn back unloaded; target length and deadline of the task, measured range of speed."""
OF_STEP = ("updates", "target", "tip", "tip_before", "time_left")
"""Quantities of a step: number of milliseconds, target length [m], tip at its end and before [m], time left [s]."""
OF_END = (*OF_STEP, "angle", "stored", "toughness", "success")
"""Quantities of an end: those of its step, angle of the blade [rad], stored energy [J], R B at the tip [N], 1 for a
success and 0 for any other end."""


@dataclass(frozen=True, kw_only=True)
class Term:
    """One term of the reward.

    In its formulas ``weight`` is the term's weight, and ``total`` its sum over the milliseconds of the step.
    """

    name: str
    title: str
    """Label in reports."""
    text: str
    """Reason of the charge, in the words of the documentation."""
    weight: float | None = None
    """Default weight; None: it has none that could be changed."""
    per: str = ""
    """Unit of the weight."""
    each: Formula | None = None
    """Summand of every millisecond."""
    gain: Formula | None = None
    """Gain of a step; a loss where negative."""
    end_gain: Formula | None = None
    """Gain of an end."""
    cost: Formula | None = None
    """Cost of a step."""
    end_cost: Formula | None = None
    """Cost of an end."""
    largest: Formula | None = None
    """Largest cost that stopping could still have; an end for safety pays it."""


REWARD = (
    Term(
        name="progress",
        title="progress",
        text="tip gained / L, up to the target",
        weight=0.6,
        per="for the whole cut",
        gain=lambda weight, tip, tip_before, target: weight * (min(tip, target) - min(tip_before, target)) / target,
    ),
    Term(
        name="accuracy",
        title="accuracy",
        text="1 - tip error / 9 mm where positive: gained on the way to the target, lost beyond it",
        weight=0.2,
        per="for a tip at the target",
        gain=lambda weight, tip, tip_before, target: weight * (closeness(tip, target) - closeness(tip_before, target)),
        largest=lambda weight: weight,
    ),
    Term(
        name="success",
        title="success",
        text="at the end, if it is a success",
        weight=0.2,
        per="for a success",
        end_gain=lambda weight, success: weight * success,
        largest=lambda weight: weight,
    ),
    Term(
        name="uncontrolled",
        title="uncontrolled advance",
        text="unstable growth / L",
        weight=0.1,
        per="per target length of unstable growth",
        each=lambda jump: jump,
        cost=lambda weight, total, target: weight * total / target,
    ),
    Term(
        name="jump",
        title="large jumps",
        text="sum of (run / 10 mm)^2",
        weight=0.03,
        per="per (run of 10 mm) squared",
        each=lambda jump: jump**2,
        cost=lambda weight, total: weight * total / (0.010 * 0.010),
    ),
    Term(
        name="force",
        title="force per depth",
        text="integral of force per depth above 400 N/m, / (100 N/m s)",
        weight=0.012,
        per="per 100 N/m s of force per depth above 400 N/m",
        each=lambda force, depth: (
            force_per_depth(force, depth) - FORCE_ALLOWED if force > FORCE_ALLOWED * depth else 0.0
        ),
        cost=lambda weight, total: weight * total * TICK / 100.0,
    ),
    Term(
        name="lag",
        title="lag",
        text="integral of the tip's lag above 10 mm, / (10 mm s)",
        weight=0.02,
        per="per 10 mm s of lag above 10 mm, up to 20 mm",
        each=lambda position, tip: min(max(lag(position, tip) - LAG_ALLOWED, 0.0), LAG_CHARGED),
        cost=lambda weight, total: weight * total * TICK / 0.010,
    ),
    Term(
        name="backward",
        title="backing up",
        text="backward travel after first contact / L",
        weight=0.1,
        per="per target length of backward travel",
        each=lambda moved, touched: max(-moved, 0.0) if touched == 1 else 0.0,
        cost=lambda weight, total, target: weight * total / target,
    ),
    Term(
        name="haste",
        title="too fast to stop",
        text="integral over travel of stopping distance / 3 mm, / L",
        weight=0.06,
        per="per target length at a speed that takes 3 mm to stop from",
        each=lambda speed, moved: speed**2 * abs(moved),
        cost=lambda weight, total, target: weight * total / (2.0 * DECELERATION * TIP_TOLERANCE * target),
    ),
    Term(
        name="time",
        title="time",
        text="time / 30 s",
        weight=0.1,
        per="per 30 s",
        cost=lambda weight, updates: weight * updates * TICK / TIME_SCALE,
        largest=lambda weight, time_left: weight * time_left / TIME_SCALE,
    ),
    Term(
        name="wedge",
        title="wedge left",
        text="at the end: uncut wedge / B = cot(angle)",
        weight=0.12,
        per="at the end, per wedge as wide as deep",
        end_cost=lambda weight, angle: wedge(angle, weight),
        largest=lambda weight: weight,
    ),
    Term(
        name="stored",
        title="left loaded",
        text="at the end: min(stored energy / (R B 3 mm), 2)",
        weight=0.06,
        per="at the end, per fracture energy of 3 mm, up to 6 mm",
        end_cost=lambda weight, stored, toughness: weight * min(stored / (toughness * 0.003), WORST_STORED),
        largest=lambda weight: weight * WORST_STORED,
    ),
    Term(
        name="safety",
        title="ended for safety",
        text="at an end for safety: the worst that stopping could still have cost",
    ),
)
"""Terms of the reward, in order; the reward is their sum."""
TERMS = tuple(term.name for term in REWARD)
"""Names of the terms."""
GAINS = tuple(term.name for term in REWARD if term.gain is not None or term.end_gain is not None)
"""Names of those that are gained; the others are costs."""


@dataclass(frozen=True, kw_only=True)
class End:
    """One way in which a cut ends."""

    name: str
    text: str
    """When it ends so."""
    when: Formula
    """Condition, of quantities of a millisecond."""
    safety: bool = False
    """True: an end for safety."""


CUT_ENDS = (
    End(
        name="force_limit",
        text="force per depth above ``force_limit_per_depth``; an end for safety",
        when=lambda force, force_limit: force > force_limit,
        safety=True,
    ),
    End(
        name="overshoot",
        text="tip more than 5 mm beyond the target; an end for safety",
        when=lambda tip, target: tip > target + OVERSHOOT_ALLOWED,
        safety=True,
    ),
    End(
        name="finished",
        text="blade has been within 10 mm of the target; then, unloaded, at rest for 0.3 s or drawn back 20 mm",
        when=lambda quiet, withdrawn: quiet >= TIME_AT_REST - 0.5 * TICK or withdrawn >= WITHDRAWN,
    ),
    End(name="deadline", text="``deadline_s`` have passed", when=lambda time, deadline: time >= deadline - 0.5 * TICK),
)
"""Ends, of which the first that applies counts."""
ENDS = ("", *(end.name for end in CUT_ENDS))
"""Names of the ends by code; code 0: not ended."""
STOPPED = "stopped"
"""Name of the end of a cut that a rig's safety has stopped; no simulated cut has it."""
SAFETY_ENDS = tuple(end.name for end in CUT_ENDS if end.safety)
"""Names of the ends for safety."""

assert math.isclose(TIP_TOLERANCE, 0.003), "the texts above say 3 mm"


TASK: np.dtype[Any] = np.dtype(
    (
        np.record,
        [(term.name, "f8") for term in REWARD if term.weight is not None]  # weights, see RewardWeights
        + [
            ("target", "f8"),  # L [m]
            ("deadline", "f8"),  # [s]
            ("force_limit_per_depth", "f8"),  # [N/m]
            ("friction_per_depth", "f8"),  # of the moving blade [N/m]
            ("speed_min", "f8"),  # measured range [m/s]
            ("speed_max", "f8"),
        ],
    )
)

PROGRESS: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("tip", "f8"),  # so far, as assessed [m]
            ("position", "f8"),  # of the blade at the last reading [m]
            ("furthest", "f8"),  # of the blade so far [m]
            ("quiet", "f8"),  # time for which the blade has been at rest and unloaded [s]
            ("loaded_at", "f8"),  # position of the blade when the tissue was last loaded [m]
            ("time", "f8"),  # since reset [s]
            ("updates", "i8"),  # number in this step, up to the end if there is one
            ("angle", "f8"),  # of the blade at the last update [rad]
            ("touched", "i8"),  # 1 once the blade has loaded the tissue
            ("end", "i8"),  # index in ENDS
        ],
    )
)
"""Memory of the assessment between decisions."""

SPECIMEN: np.dtype[Any] = np.dtype(
    (np.record, [("modulus", "f8", (N_POINTS,)), ("fracture_resistance", "f8", (N_POINTS,))])
)
"""Properties of a specimen reported in `info` beyond its profile: modulus [Pa], fracture resistance [J/m2]."""


T = TypeVar("T")


def _weight_fields(terms: Sequence[Term] | Sequence[WholeCutTerm], prefix: str = "") -> list[tuple[str, type, Any]]:
    """Return a dataclass field per term with adjustable weight."""
    about: dict[str, Any] = {"unit": "1", "low": 0.0, "high": 100.0, "provenance": "choice"}
    return [
        (prefix + term.name, float, parameter(term.weight, source=term.per, title=term.title, **about))
        for term in terms
        if term.weight is not None
    ]


def with_weights(costs: Sequence[WholeCutTerm]) -> Callable[[type[T]], type[T]]:
    """Return a decorator that adds cost weights, ``weight_NAME``, to constants."""

    def extended(kind: type[T]) -> type[T]:
        names = {"__module__": kind.__module__, "__doc__": kind.__doc__}
        fields = _weight_fields(costs, "weight_")
        return dataclasses.make_dataclass(
            kind.__name__, fields, bases=(kind,), namespace=names, frozen=True, kw_only=True
        )

    return extended


if TYPE_CHECKING:

    @dataclass(frozen=True, kw_only=True)
    class RewardWeights:
        """Weights of reward terms; ending early saves no cost."""

        def __init__(self, **weights: float) -> None: ...

        def __getattr__(self, name: str) -> float: ...

else:
    RewardWeights = dataclasses.make_dataclass(
        "RewardWeights",
        _weight_fields(REWARD),
        namespace={
            "__module__": __name__,
            "__doc__": "Weights of the reward's terms; each cost is charged as it occurs: ending early saves nothing.",
            "__post_init__": check_parameters,
        },
        frozen=True,
        kw_only=True,
    )


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits for safety ends, and for a rig's speed."""

    force_limit_per_depth: float = parameter(
        FORCE_LIMIT_PER_DEPTH, unit="N/m", low=1.0, high=1e5, provenance="assumed",
        source="a planner that knows the tissue never meets it", sensitivity=(600.0, 1500.0),
    )  # fmt: skip
    top_speed: float = parameter(
        SPEED_SCALE, unit="m/s", low=0.0005, high=SPEED_SCALE, provenance="measured",
        source="fastest measured; a slower rig obeys its own, and reduces faster actions to it",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


def greatest_action(speed: float) -> float:
    """Return the action, at most 1, of a top speed [m/s]."""
    return min(float(speed_action(speed)), 1.0)


def task_record(
    weights: RewardWeights, limits: Limits, *, speeds: tuple[float, float], **numbers: float
) -> StructArray:
    """Return a :data:`TASK` array, (1,), from weights, limits and speeds [m/s]."""
    task = np.zeros(1, TASK)
    for field in dataclasses.fields(weights):
        task[field.name] = getattr(weights, field.name)
    task["force_limit_per_depth"] = limits.force_limit_per_depth
    for name, number in numbers.items():
        task[name] = number
    task["speed_min"], task["speed_max"] = speeds
    return task
