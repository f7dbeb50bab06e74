"""Finished cut with all of its readings, and its scores."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv.plant.protocol import recorded_trace
from cutenv.scoring import METRICS, Truth, score
from cutenv.task.episode import ShownDepth
from cutenv.tissue.grid import SPACING

METRIC_PREFIX = "metric_"


@dataclass(frozen=True, kw_only=True, eq=False)
class FinishedCut:
    """One cut by one policy.

    Parameters
    ----------
    seed : int
        Seed of the environment, whose first episode it was.
    end : str
        Reason of its end.
    success : bool
        True if it succeeded.
    truth : mapping
        ``info["truth"]`` at the end.
    reward_totals : mapping of str to float
        Sum of each term of the reward over the cut.
    cost_totals : mapping of str to float
        Sum of each part of the cost over the cut: ``overshoot_mm``, ``long_runs_mm`` [mm].
    largest_jump_m : float
        Largest unstable growth in a millisecond [m].
    time_s : float
        Time of its end [s].
    readings : Records
        Readings at 1 kHz, :data:`cutenv.cutting.dtypes.READING`, shape (n,), hidden tip included; for the scores alone,
        ``true_force`` is enough.
    depth, measured_depth, resistance : array, shape (301,)
        Depth [m], as measured beforehand [m], and fracture resistance [J/m2] of the specimen along the line.
    further : mapping of str to float
        Scores that the task adds.
    shown_depth : ShownDepth, optional
        Depth of the cut for a picture, of a task with a third axis.
    """

    seed: int
    end: str
    success: bool
    truth: Mapping[str, Any]
    reward_totals: Mapping[str, float]
    cost_totals: Mapping[str, float]
    largest_jump_m: float
    time_s: float
    readings: StructArray
    depth: np.ndarray
    measured_depth: np.ndarray
    resistance: np.ndarray
    further: Mapping[str, float] = field(default_factory=dict)
    shown_depth: ShownDepth | None = None

    def scores(self) -> dict[str, Any]:
        """Return the scores that follow from the task and from the hidden state."""
        truth, readings = self.truth, self.readings
        beyond = truth["tip_m"] - truth["target_length_m"]
        return {
            "seed": self.seed,
            "specimen_class": truth["specimen_class"],
            "target_length_mm": 1e3 * truth["target_length_m"],
            "return": math.fsum(self.reward_totals.values()),
            "success": float(self.success),
            "end": self.end,
            "tip_error_mm": 1e3 * abs(beyond),
            "cost_mm": math.fsum(self.cost_totals.values()),
            **self.cost_totals,
            "time_s": self.time_s,
            "peak_force_N": float(readings["true_force"].max()),
            "mean_force_N": float(readings["true_force"].mean()),
            "uncontrolled_share": truth["uncontrolled_m"] / max(truth["tip_m"], 1e-9),
            "largest_jump_mm": 1e3 * self.largest_jump_m,
            "runs": int(truth["units"]),
            **{f"reward_{name}": value for name, value in self.reward_totals.items()},
            **self.further,
        }

    def metrics(self) -> dict[str, float | str]:
        """Return every metric of the score card, keyed by :func:`metric_column`; an undefined one is an empty text."""
        readings, trace = self.readings, recorded_trace(self.readings, self.depth)
        cut = self.resistance[: max(int(self.truth["tip_m"] / SPACING), 0) + 1]
        truth = Truth(tip=readings["tip"], jump=readings["jump"], resistance=float(cut.mean()))
        card = score(trace, target_length=self.truth["target_length_m"], truth=truth)
        values = {name: scored.value for name, scored in card.metrics.items()}
        return {metric_column(name): "" if value is None else value for name, value in values.items()}


def metric_column(name: str) -> str:
    """Return the column name of a metric of the score card, with its unit: ``metric_peak_force_N``."""
    unit = METRICS[name].unit.replace("F", "N")
    suffix = "" if unit == "1" else "_" + unit.replace("/", "_per_").replace(" ", "_")
    return METRIC_PREFIX + name + suffix
