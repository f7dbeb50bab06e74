"""Evaluate policies on the same held-out specimens: every score of every cut, and means with 95 % intervals."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

import cutenv  # registers the environment
from cutenv.policy import Policy

ENVIRONMENT = "cutenv/GentleCut-v0"
assert ENVIRONMENT in gymnasium.registry, cutenv.__name__

TRAINING_SEEDS = range(0, 1_000_000)
VALIDATION_SEEDS = range(1_000_000, 2_000_000)
TEST_SEEDS = range(2_000_000, 3_000_000)
"""Seeds of environments; a specimen is keyed by seed and episode, so disjoint seeds are disjoint specimens."""


@dataclass(frozen=True)
class Contestant:
    """A policy and the environment arguments that it needs (its decision rate, say)."""

    policy: Policy
    arguments: Mapping[str, Any] = field(default_factory=dict)


def run_cut(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> tuple[dict[str, Any], np.ndarray]:
    """One episode: its scores, and every reading at 1 kHz (hidden tip included), shape (n,)."""
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    total = 0.0
    terms: dict[str, float] = {}
    parts = []
    ended = False
    while not ended:
        observation, reward, ended, _, info = env.step(policy(observation))
        total += float(reward)
        for name, value in info["reward_terms"].items():
            terms[name] = terms.get(name, 0.0) + value
        parts.append(env.unwrapped.cutting.readings.copy())  # type: ignore[attr-defined]
    readings = np.concatenate(parts)
    truth = info["truth"]
    scores = {
        "seed": seed,
        "specimen_class": truth["specimen_class"],
        "target_length_mm": 1e3 * truth["target_length_m"],
        "return": total,
        "success": float(info["is_success"]),
        "end": info["end"],
        "tip_error_mm": 1e3 * abs(truth["tip_m"] - truth["target_length_m"]),
        "overshoot_mm": 1e3 * max(truth["tip_m"] - truth["target_length_m"], 0.0),
        "time_s": float(readings["time"][-1]),
        "peak_force_N": float(readings["true_force"].max()),
        "mean_force_N": float(readings["true_force"].mean()),
        "uncontrolled_share": truth["uncontrolled_m"] / max(truth["tip_m"], 1e-9),
        "largest_jump_mm": 1e3 * float(readings["jump"].max()),
        "runs": truth["units"],
        **{f"reward_{name}": value for name, value in terms.items()},
    }
    return scores, readings


def evaluate(
    contestants: Mapping[str, Contestant], seeds: Sequence[int], arguments: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Scores of every contestant on every seed, one row a cut; all meet the same specimens."""
    rows = []
    with tqdm(total=len(contestants) * len(seeds), desc="evaluating", unit="cut") as bar:
        for name, contestant in contestants.items():
            env = gymnasium.make(ENVIRONMENT, **{**arguments, **contestant.arguments})
            for seed in seeds:
                scores, _ = run_cut(env, contestant.policy, seed)
                rows.append({"policy": name, **scores})
                bar.update()
            env.close()
    return rows


def summarise(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Mean of every numeric score for each policy, with a 95 % interval (normal, 1.96 standard errors)."""
    by_policy: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        by_policy.setdefault(row["policy"], []).append(row)
    summary = []
    for policy, own in by_policy.items():
        for score in own[0]:
            if score in ("policy", "seed") or isinstance(own[0][score], str):
                continue
            values = np.array([float(row[score]) for row in own])
            error = values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else math.nan
            mean = float(values.mean())
            summary.append(
                {
                    "policy": policy,
                    "score": score,
                    "mean": mean,
                    "low_95": mean - 1.96 * error,
                    "high_95": mean + 1.96 * error,
                    "cuts": len(values),
                }
            )
    return summary


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to a CSV file, all at once: never half a file under the final name."""
    part = path.with_suffix(".part")
    with part.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    part.replace(path)


def print_table(summary: Sequence[Mapping[str, Any]], scores: Sequence[str]) -> None:
    """Print the chosen scores of each policy with their intervals."""
    policies = list(dict.fromkeys(row["policy"] for row in summary))
    values = {(row["policy"], row["score"]): row for row in summary}
    width = max(len(name) for name in policies) + 2
    print("".ljust(width) + "".join(score.rjust(24) for score in scores))
    for policy in policies:
        cells = [values[policy, score] for score in scores]
        shown = [f"{cell['mean']:.3f} [{cell['low_95']:.3f}, {cell['high_95']:.3f}]" for cell in cells]
        print(policy.ljust(width) + "".join(text.rjust(24) for text in shown))
