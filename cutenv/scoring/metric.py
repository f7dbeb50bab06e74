"""Metrics: pure functions of one cut, each with unit, direction, formula, source and validity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from cutenv._base.validation import one_of

if TYPE_CHECKING:
    from cutenv.scoring.scored_cut import ScoredCut

Direction = Literal["lower", "higher", "none"]
Invariance = Literal["time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"]

INVARIANCES: dict[Invariance, str] = {
    "time_shift": "the clock may start anywhere",
    "force_scale": "the force may be normalised by any number",
    "force_offset": "a sensor's zero does not matter",
    "resampling": "the rate of readings does not matter, from 200 Hz on, within 5 %",
    "rest_after": "a second of rest in the unloaded tissue after the cut adds nothing, within 2 %",
    "units": "doubling a cut's force and depth and the slab's thickness together changes nothing",
}
"""Invariances that a metric may promise; each has one test for all metrics that do."""


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One metric of a cut.

    Attributes
    ----------
    name : str
        Name of the metric; ``*_error`` is best at zero.
    unit : str
        "1" for a pure number; "F" stands for the force unit of the record.
    direction : {"lower", "higher", "none"}
        Direction that is better; "none": reported and never rewarded.
    meaning, formula, source, validity : str
        Description, formula, source, and range of validity.
    needs : tuple of str
        Required fields of the trace beside time and force, and "newtons", "target_length", "tip".
    invariances : tuple of str
        Names in :data:`INVARIANCES`.
    function : callable
        Function from a :class:`~cutenv.scoring.scored_cut.ScoredCut` to a float; raises :class:`Unavailable`.
    """

    name: str
    unit: str
    direction: Direction
    meaning: str
    formula: str
    source: str
    validity: str
    function: Callable[[ScoredCut], float]
    needs: tuple[str, ...] = ()
    invariances: tuple[Invariance, ...] = ()

    def __post_init__(self) -> None:
        one_of("direction", self.direction, get_args(Direction))
        for each in self.invariances:
            one_of("invariance", each, INVARIANCES)


METRICS: dict[str, Metric] = {}
"""Metrics of every record by name, in the order of the score card."""
MAP_METRICS: dict[str, dict[str, Metric]] = {"depth": {}, "path": {}}
"""Metrics that a record of a task adds, which has a map of the cut, by the task; in the order of the score card."""
FORCE_WEIGHTS: Mapping[str, float] = {
    "force_rate": 0.30,
    "force_jerk": 0.20,
    "force_drops": 0.20,  # tissue that tears lets go of the blade
    "mean_force_drop": 0.15,
    "force_variation": 0.15,
}
"""Weights of the leading metrics' percentiles for a record without tip or target; they sum to 1.

They are a choice that follows research on force-based assessment: steadiness of the force leads, the peak force is only
a safety limit, and smoothness of the motion is reported but not scored.
"""


def metric(
    unit: str, direction: Direction, *, among: dict[str, Metric] = METRICS, **about: Any
) -> Callable[[Callable[[ScoredCut], float]], Callable[[ScoredCut], float]]:
    """Register a function of a cut in :data:`METRICS` by its name; its docstring's first line is the meaning.

    ``among`` is one of :data:`MAP_METRICS` for a metric of a map; ``about`` are the other fields of a :class:`Metric`.
    """

    def enter(function: Callable[[ScoredCut], float]) -> Callable[[ScoredCut], float]:
        name, meaning = function.__name__, (function.__doc__ or "").strip().partition("\n")[0]
        among[name] = Metric(name=name, unit=unit, direction=direction, meaning=meaning, function=function, **about)
        return function

    return enter


def metric_named(name: str) -> Metric:
    """Return a metric of any record by its name."""
    return all_metrics()[name]


def all_metrics() -> dict[str, Metric]:
    """Return the metrics of every record and of every task, by name in the order of the score card."""
    return {name: each for metrics in (METRICS, *MAP_METRICS.values()) for name, each in metrics.items()}
