"""A training result made of formulas: nothing is trained, and every number on its page can be told from another."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv.display.report.training_page import CutPicture, TrainingResult
from cutenv.display.report.training_result import COLUMNS
from cutenv.sim.cutting.dtypes import READING

AGENT, SCRIPT, BOUND, OTHER = "PPO", "fast-then-slow, 60 deg", "planner that knows the truth", "constant 1.27 cm/s"
RETURNS = {SCRIPT: 0.51, AGENT: 0.64, OTHER: 0.24, BOUND: 0.83}
SPEEDS, ANGLES = (0.1, 0.38, 0.64, 1.27, 1.78, 2.16, 2.54), (45.0, 60.0, 75.0, 90.0)
GAINED = {"progress": 0.59, "accuracy": 0.17, "success": 0.15}
TERMS = (*GAINED, "uncontrolled", "jump", "time", "stored", "wedge")


def row(mean: float, half: float, **words: Any) -> dict[str, Any]:
    """A mean with its interval."""
    return {**words, "mean": mean, "low_95": mean - half, "high_95": mean + half, "cuts": 100}


def summary() -> list[dict[str, Any]]:
    """Every score of every policy, in no order."""
    rows = []
    for place, (policy, value) in enumerate(RETURNS.items()):
        for number, column in enumerate(COLUMNS):
            mean = value if column.name == "return" else (0.31 + 0.13 * place + 0.017 * number)
            rows.append(row(mean, 0.021 + 0.011 * place, policy=policy, score=column.name))
        for number, term in enumerate(TERMS):
            cost = 0.0 if term == "wedge" else -0.01 * (1 + number) * (1 + place)
            rows.append(row(GAINED.get(term, cost), 0.004, policy=policy, score=f"reward_{term}"))
    return rows


def differences(mean: float = 0.13, half: float = 0.05) -> list[dict[str, Any]]:
    """Agent minus each other policy; ``mean`` and ``half`` are those of the return against the best script."""
    rows = []
    for baseline in (SCRIPT, BOUND, OTHER):
        own = mean if baseline == SCRIPT else RETURNS[AGENT] - RETURNS[baseline]
        rows.append(row(own, half, policy=AGENT, baseline=baseline, score="return"))
        rows.append(row(0.17, 0.09, policy=AGENT, baseline=baseline, score="success"))
    return rows


def grid() -> list[dict[str, Any]]:
    """A return for every pair of speed and angle, the best at 0.64 cm/s and 60 degrees."""
    rows = []
    for speed in SPEEDS:
        for angle in ANGLES:
            mean = 0.40 - 0.25 * np.log(speed / 0.64) ** 2 - 0.0001 * (angle - 60.0) ** 2
            rows.append(row(float(mean), 0.07, speed_cm_s=speed, angle_deg=angle, success=0.5))
    return rows


def readings(seconds: float = 2.0, sawing_hz: float = 0.0) -> np.ndarray:
    """A blade that goes 84 mm with a saw-toothed force, and may move back and forth on its way."""
    count = round(1000 * seconds)
    made = np.zeros(count, READING)
    made["time"] = 1e-3 * (1 + np.arange(count))
    made["position"] = np.linspace(0.0, 0.084, count) + 0.002 * np.sin(2 * np.pi * sawing_hz * made["time"])
    made["speed"] = np.gradient(made["position"], 1e-3)
    made["angle"] = np.radians(80.0)
    noise = np.random.default_rng(0).normal(0.0, 0.02, count)
    made["force"] = made["true_force"] = 1.0 + 40.0 * made["position"] + np.arange(count) % 200 / 200.0 + noise
    made["tip"] = np.linspace(0.0, 0.079, count)
    made["jump"] = np.where(np.arange(count) % 200 == 199, 1e-3, 0.0)
    return made


def cut(policy: str, **changes: Any) -> CutPicture:
    """One cut of a policy."""
    given: dict[str, Any] = {
        "policy": policy,
        "caption": f"Held-out specimen 2000007, cut by {policy}",
        "readings": readings(),
        "depth": np.linspace(0.001, 0.02, 301),
        "target_length": 0.078,
        "force_limit_per_depth": 1000.0,
    }
    return CutPicture(**(given | changes))


def curve() -> list[dict[str, float]]:
    """A learning curve, validated at every fifth row."""
    rows: list[dict[str, float]] = []
    for k in range(1, 31):
        value = {"decisions": 8192.0 * k, "return": 0.6 - 1.5 / k, "success": 0.7 - 0.7 / k}
        rows.append(value | ({"validation_return": 0.65 - 1.5 / k, "validation_success": 0.7} if k % 5 == 0 else {}))
    rows[3]["validation_return"] = float("nan")
    return rows


def result(**changes: Any) -> TrainingResult:
    """The whole result, with fields replaced."""
    given: dict[str, Any] = {
        "title": "Gentle cutting with PPO",
        "subtitle": "Run made-up, seed 7",
        "facts": {"specimen class": "liver", "seed": "7", "commit": "e2b9161", "versions": "numpy 2.4.6"},
        "summary": summary(),
        "differences": differences(),
        "agent": AGENT,
        "best_script": SCRIPT,
        "bound": BOUND,
        "grid": grid(),
        "cuts": [cut(AGENT), cut(SCRIPT)],
        "curve": curve(),
        "chosen_at": 122_880,
    }
    return TrainingResult(**(given | changes))
