"""Rewards and ends of gentle cutting worked out again from every millisecond, from the words of the task."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from whole_cut import Cut

from cutenv.sim.tissue.specimen import N_POINTS, SPACING

TICK = 0.001
WEIGHTS = {
    "progress": 0.6,
    "accuracy": 0.2,
    "success": 0.2,
    "uncontrolled": 0.1,
    "jump": 0.03,
    "force": 0.012,
    "lag": 0.02,
    "backward": 0.1,
    "haste": 0.06,
    "time": 0.1,
    "wedge": 0.12,
    "stored": 0.06,
}


class Assessment(NamedTuple):
    """Terms since the start, the end, the number of readings up to it, and whether it was a success."""

    terms: dict[str, float]
    end: str
    ticks: int
    success: bool


def assess_again(env: Any, cut: Cut, *, weights: dict[str, float] = WEIGHTS, force_limit: float = 1000.0) -> Assessment:
    """What ``cut`` in ``env`` should have been charged, from its readings and the hidden truth."""
    task, specimen = env.unwrapped.cutting, env.unwrapped.specimen
    readings, L = cut.readings, task.target_length
    x, a, v, theta = (readings[name] for name in ("position", "tip", "speed", "angle"))

    def along(values: np.ndarray, place: Any) -> Any:
        return np.interp(place, np.arange(N_POINTS) * SPACING, values)

    depth = along(specimen.depth, x)
    per_depth = np.abs(readings["true_force"]) / depth
    friction = specimen.friction_per_depth * depth
    time = TICK * np.arange(1, len(x) + 1)
    end, n = _first_end(x, a - L, v, per_depth - force_limit, readings["force"] - friction, time - task.deadline, L)

    feed = np.diff(x[:n], prepend=0.0)
    touched = np.concatenate(([False], np.maximum.accumulate(x > a)[: n - 1]))
    terms = {
        "progress": min(a[n - 1], L) / L,
        "accuracy": max(1.0 - abs(a[n - 1] - L) / 0.009, 0.0),
        "uncontrolled": -readings["jump"][:n].sum() / L,
        "jump": -((readings["jump"][:n] / 0.010) ** 2).sum(),
        "force": -np.maximum(per_depth[:n] - 400.0, 0.0).sum() * TICK / 100.0,
        "lag": -np.clip(x[:n] - a[:n] - 0.010, 0.0, 0.010).sum() * TICK / 0.010,
        "backward": np.minimum(feed, 0.0)[touched].sum() / L,
        "haste": -(v[:n] ** 2 / (2.0 * 0.1) / 0.003 * np.abs(feed)).sum() / L,
        "time": -n * TICK / 30.0,
    }
    tip, lag = a[n - 1], max(x[n - 1] - a[n - 1], 0.0)
    stored = 0.5 * along(specimen.stiffness(), tip) * lag**2
    success = end == "finished" and abs(tip - L) <= 0.003 and theta[n - 1] >= math.radians(80.0)
    terms["success"] = 1.0 if success else 0.0
    terms["wedge"] = -1.0 / math.tan(theta[n - 1])
    terms["stored"] = -min(stored / (along(specimen.fracture_force(), tip) * 0.003), 2.0)
    terms = {name: value * weights.get(name, 1.0) for name, value in terms.items()}
    worst = weights["accuracy"] + weights["success"] + weights["wedge"] + 2.0 * weights["stored"]
    left = weights["time"] * (task.deadline - n * TICK) / 30.0
    terms["safety"] = -(worst + left) if end in ("force_limit", "overshoot") else 0.0
    return Assessment(terms, end, n, success)


def _first_end(x, beyond, v, over_limit, over_friction, after_deadline, L) -> tuple[str, int]:
    free = (over_friction < 0.1) & (np.maximum.accumulate(x) >= L - 0.010)
    quiet = free & (np.abs(v) < 0.5e-3)
    loaded_at = math.nan
    for i in range(len(x)):
        loaded_at = loaded_at if free[i] else x[i]
        if over_limit[i] > 0.0:
            return "force_limit", i + 1
        if beyond[i] > 0.005:
            return "overshoot", i + 1
        if (i >= 299 and quiet[i - 299 : i + 1].all()) or loaded_at - x[i] >= 0.020:
            return "finished", i + 1
        if after_deadline[i] > -0.5 * TICK:
            return "deadline", i + 1
    raise AssertionError("nothing ended this cut")


def check_assessment(env: Any, cut: Cut, tolerance: float = 1e-9, **changes: Any) -> None:
    """The rewards, the end and the success of ``cut`` are those worked out again."""
    again = assess_again(env, cut, **changes)
    assert cut.end == again.end
    assert cut.infos[-1]["is_success"] == again.success
    for name, value in cut.totals.items():
        assert abs(value - again.terms[name]) <= tolerance, f"{name}: {value} charged, {again.terms[name]} due"
