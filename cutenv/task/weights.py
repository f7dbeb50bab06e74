"""Weights of the reward and limits of the task."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv.task.episode_dtypes import TASK
from cutenv.task.observation import SPEED_SCALE, speed_action
from cutenv.task.reward import REWARD, Term
from cutenv.task_quantities import FORCE_LIMIT_PER_DEPTH, WholeCutTerm

T = TypeVar("T")


def _weight_fields(terms: Sequence[Term] | Sequence[WholeCutTerm], prefix: str = "") -> list[tuple[str, type, Any]]:
    """Return a field of a dataclass for each term whose weight can be changed."""
    about: dict[str, Any] = {"unit": "1", "low": 0.0, "high": 100.0, "provenance": "choice"}
    return [
        (prefix + term.name, float, parameter(term.weight, source=term.per, title=term.title, **about))
        for term in terms
        if term.weight is not None
    ]


def with_weights(costs: Sequence[WholeCutTerm]) -> Callable[[type[T]], type[T]]:
    """Return a decorator that adds the weight of each cost to a dataclass of a task's constants, as ``weight_NAME``."""

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
        """Weights of the reward's terms; each cost is charged as it occurs: ending early saves nothing."""

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
    """Limits at which the task ends for safety, and of the speed that a rig obeys."""

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
    """Return the speed action that commands a top speed [m/s], at most 1: a rig reduces faster actions to it."""
    return min(float(speed_action(speed)), 1.0)


def task_record(
    weights: RewardWeights,
    limits: Limits,
    *,
    target_length: float,
    deadline: float,
    friction_per_depth: float,
    speeds: tuple[float, float],
) -> StructArray:
    """Return one task as a :data:`TASK` array, shape (1,); lengths [m], times [s], friction [N/m], speeds [m/s]."""
    task = np.zeros(1, TASK)
    for field in dataclasses.fields(weights):
        task[field.name] = getattr(weights, field.name)
    task["force_limit_per_depth"] = limits.force_limit_per_depth
    task["target"] = target_length
    task["deadline"] = deadline
    task["friction_per_depth"] = friction_per_depth
    task["speed_min"], task["speed_max"] = speeds
    return task
