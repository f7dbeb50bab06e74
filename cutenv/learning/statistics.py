"""Means of scores with 95 % intervals, and paired differences between policies on the same specimens."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np


def mean_with_interval(values: Iterable[float]) -> dict[str, float]:
    """Return mean and 95 % interval (normal, 1.96 standard errors) of independent values."""
    x = np.array(list(values), dtype=float)
    error = 1.96 * x.std(ddof=1) / math.sqrt(len(x)) if len(x) > 1 else math.nan
    return {
        "mean": float(x.mean()),
        "low_95": float(x.mean() - error),
        "high_95": float(x.mean() + error),
        "cuts": len(x),
    }


def by_policy(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Return the rows of each policy, in order of appearance."""
    result: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        result.setdefault(row["policy"], []).append(row)
    return result


def summarise(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return mean and 95 % interval of every numeric score of each policy, within what its mean can be."""
    return [
        {"policy": policy, "score": score, **_possible(score, [float(row[score]) for row in own])}
        for policy, own in by_policy(rows).items()
        for score in own[0]
        if score not in ("policy", "seed") and not isinstance(own[0][score], str)
    ]


def _possible(score: str, values: Sequence[float]) -> dict[str, float]:
    """Return mean and interval: of a share between 0 and 1, and not below 0 for what is a size."""
    found = mean_with_interval(values)
    if min(values) >= 0.0:
        found["low_95"] = max(found["low_95"], 0.0)
    if score == "success":
        found["high_95"] = min(found["high_95"], 1.0)
    return found


def differences(
    rows: Iterable[Mapping[str, Any]], policy: str, scores: Sequence[str] = ("return", "success")
) -> list[dict[str, Any]]:
    """Return the paired differences of ``policy`` from every other on the same specimens, with 95 % intervals."""
    each = by_policy(rows)
    own = {row["seed"]: row for row in each[policy]}
    return [
        {
            "policy": policy,
            "baseline": other,
            "score": score,
            **mean_with_interval(float(own[row["seed"]][score]) - float(row[score]) for row in theirs),
        }
        for other, theirs in each.items()
        if other != policy
        for score in scores
    ]


def best_script(summary: Iterable[Mapping[str, Any]], candidates: Iterable[str]) -> str:
    """Return the candidate with the highest mean return."""
    returns = {row["policy"]: row["mean"] for row in summary if row["score"] == "return"}
    return max((name for name in candidates if name in returns), key=returns.__getitem__)
