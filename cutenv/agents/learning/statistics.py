"""Statistics of scores.

Means with 95 % intervals, paired differences of policies, interquartile means, and tables.

Differences are on the same specimens.  Tables are CSV files.  Interquartile means with
stratified bootstrap intervals are after Agarwal et al. 2021 (their library: rliable).

*Deep Reinforcement Learning at the Edge of the Statistical Precipice*, NeurIPS 2021.  A score of an agent is an array
of shape (training runs, specimens) for each stratum, a class of specimens.  A resample draws training runs and, crossed
with them, specimens within each stratum, all with replacement; a script has one run.  Tasks in rliable have separate
runs; strata share theirs: a run is the same agent in all strata, and is drawn in all or in none.
The interquartile mean is that of the middle half of all cuts: robust against outliers, and less variable than the
median.  With three runs an interval over runs is sometimes too narrow by chance; this is stated where intervals are
shown.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import trim_mean

from cutenv._base.output import atomic_write


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows to CSV, atomically; missing values become empty cells."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with atomic_write(path) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=names, restval="")
        writer.writeheader()
        writer.writerows(rows)


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return a CSV file's rows as text, none without a file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_rows(path: Path) -> list[dict[str, float]]:
    """Read rows of numbers from CSV; absent files and cells give none."""
    return [{name: float(value) for name, value in row.items() if value} for row in rows_of(path)]


def mean_with_interval(values: Iterable[float]) -> dict[str, float]:
    """Return mean and 95 % interval (normal, 1.96 standard errors)."""
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
    """Return each score's mean and possible 95 % interval by policy."""
    return [
        {"policy": policy, "score": score, **_possible(score, [float(row[score]) for row in own])}
        for policy, own in by_policy(rows).items()
        for score in own[0]
        if score not in ("policy", "seed") and not isinstance(own[0][score], str)
    ]


def _possible(score: str, values: Sequence[float]) -> dict[str, float]:
    """Clip mean and interval to 0 to 1 (shares) or from 0 (sizes)."""
    found = mean_with_interval(values)
    if min(values) >= 0.0:
        found["low_95"] = max(found["low_95"], 0.0)
    if score == "success":
        found["high_95"] = min(found["high_95"], 1.0)
    return found


def differences(
    rows: Iterable[Mapping[str, Any]], policy: str, scores: Sequence[str] = ("return", "success")
) -> list[dict[str, Any]]:
    """Return the paired differences of ``policy`` from every other, with 95 % intervals."""
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


_TOGETHER = 100  # resamples computed at a time, to limit memory


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Return the interquartile mean along the last axis, quarters rounded down."""
    middle: np.ndarray = trim_mean(values, 0.25, axis=-1)
    return middle


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float

    def holds(self, number: float) -> bool:
        """Return True if a number is within the interval."""
        return self.low <= number <= self.high

    def meets(self, other: Interval) -> bool:
        """Return True if two intervals overlap."""
        return self.low <= other.high and other.low <= self.high


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean along the last axis, for shares."""
    found: np.ndarray = values.mean(axis=-1)
    return found


def stratified(
    strata: Sequence[np.ndarray],
    statistic: Callable[[np.ndarray], np.ndarray] = interquartile_mean,
    *,
    same_specimens: bool = False,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """Return the statistic of all strata, with 95 % percentile interval.

    ``strata`` are finite numbers of shape (training runs, specimens); their rows are the same runs and, with
    ``same_specimens``, their columns are paired too.  The ``statistic`` is along the last axis:
    :func:`interquartile_mean` or :func:`mean`.  Equal shapes are resampled equally.

    Raises ValueError for no strata, a stratum without two axes or without members, a NaN, and for strata of different
    runs or, with ``same_specimens``, different numbers of specimens.
    """
    if not strata:
        raise ValueError("strata is empty; give the scores of one class of specimens at least.")
    for number, values in enumerate(strata):
        if values.ndim != 2 or not values.size or not np.isfinite(values).all():
            raise ValueError(
                f"strata[{number}] has shape {values.shape} and {np.isnan(values).sum()} NaN; give finite numbers, "
                "shape (training runs, specimens)."
            )
    together = slice(None) if same_specimens else slice(1)
    if len({values.shape[together] for values in strata}) > 1:
        raise ValueError(
            f"strata have shapes {', '.join(str(values.shape) for values in strata)}; give the same training runs in "
            f"each{', and the same specimens' if same_specimens else ''}."
        )
    rng = np.random.default_rng(seed)
    found = []
    for first in range(0, resamples, _TOGETHER):
        count = min(_TOGETHER, resamples - first)
        runs, drawn = _draw(rng, count, strata[0].shape[0]), []
        specimens = _draw(rng, count, strata[0].shape[1])
        for number, values in enumerate(strata):
            if number and not same_specimens:
                specimens = _draw(rng, count, values.shape[1])
            drawn.append(values[runs[:, :, None], specimens[:, None, :]].reshape(count, -1))
        found.append(statistic(np.concatenate(drawn, axis=1)))
    low, high = np.percentile(np.concatenate(found), (2.5, 97.5))
    whole = np.concatenate([values.ravel() for values in strata])
    return Interval(float(statistic(whole)), float(low), float(high))


def _draw(rng: np.random.Generator, resamples: int, size: int) -> np.ndarray:
    """Return resampled indices, with replacement, shape (resamples, size)."""
    return rng.integers(size, size=(resamples, size))
