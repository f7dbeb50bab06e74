"""A metric against the marks of raters, and the agreement of the raters with each other; any number, on any scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import one_of
from cutenv.scoring.study.estimate import BOOTSTRAP_SIZE, Estimate, over_people, vanishes
from cutenv.scoring.study.reliability import intraclass_correlation

FEWEST_RATED = 4
"""Smallest number of rated cuts for a correlation: three lie in order by chance once in six times."""
_LARGEST_TABLE = 4_000_000  # resamples times cuts that are held in memory at once


@dataclass(frozen=True, kw_only=True)
class RaterCorrelation:
    """Correlation of a metric with marks; positive if what counts as better got the better marks.

    Attributes
    ----------
    rank, linear : Estimate
        Spearman's and Pearson's correlation.
    cuts, people : int
        Number of rated cuts, and of the people who made them.
    """

    rank: Estimate
    linear: Estimate
    cuts: int
    people: int


@dataclass(frozen=True, kw_only=True)
class RaterAgreement:
    """Agreement of raters over the cuts that all of them rated.

    Attributes
    ----------
    agreement : Estimate
        ICC(A,1): one rater's marks taken as they are; a severe rater counts as disagreement. It needs one scale.
    consistency : Estimate
        ICC(C,1): a severe rater does not count, another unit of the scale does.
    rank : Estimate
        Spearman's correlation, mean over the pairs of raters; for any scales.
    raters, cuts, people : int
        Numbers of raters, of the cuts that all rated, and of the people who made them.
    """

    agreement: Estimate
    consistency: Estimate
    rank: Estimate
    raters: int
    cuts: int
    people: int


def rater_correlation(
    values: ArrayLike,
    marks: ArrayLike,
    people: Sequence[str],
    *,
    better: Literal["higher", "lower"],
    best_mark: Literal["highest", "lowest"] = "highest",
    rng: np.random.Generator,
) -> RaterCorrelation:
    """Compute rank and linear correlation of a metric with marks, with intervals over people.

    Parameters
    ----------
    values, marks : array_like of shape (n,)
        Value and mark of each cut, in any unit and on any scale; NaN where a cut has none.
    people : sequence of str
        Who made each cut.
    better : {"higher", "lower"}
        Which values of the metric are better.
    best_mark : {"highest", "lowest"}
        Which end of the raters' scale is best.
    rng : numpy.random.Generator
        Source of the resamples.

    Returns
    -------
    RaterCorrelation

    Raises
    ------
    ValueError
        If fewer than four cuts have both, or values or marks do not differ; the message says which.
    """
    sign = 1.0 if one_of("better", better, ("higher", "lower")) == "higher" else -1.0
    sign *= 1.0 if one_of("best_mark", best_mark, ("highest", "lowest")) == "highest" else -1.0
    x, y = np.asarray(values, np.float64), np.asarray(marks, np.float64)
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    made_by = np.asarray(people)[both]
    if len(x) < FEWEST_RATED:
        raise ValueError(f"fewer than {FEWEST_RATED} cuts have a value and a mark ({len(x)})")
    for name, each in (("values", x), ("marks", y)):
        if vanishes(float(each.var()), each):
            raise ValueError(f"all {len(each)} {name} are alike")
    weights = _weights(made_by, rng)
    count = len(set(made_by.tolist()))
    rank = sign * _rank_correlation(weights, x, y)
    linear = sign * _correlation(weights, x[None] - x.mean(), y[None] - y.mean())
    return RaterCorrelation(
        rank=over_people(float(rank[0]), rank[1:], count),
        linear=over_people(float(linear[0]), linear[1:], count),
        cuts=len(x),
        people=count,
    )


def mean_mark(marks: ArrayLike) -> Array:
    """Return each cut's mean mark over its raters, who may use different scales.

    Parameters
    ----------
    marks : array_like of shape (n, k)
        Marks of n cuts by k raters; NaN where a rater gave none.

    Returns
    -------
    ndarray of shape (n,)
        Mean over the raters of a cut, each rater's marks taken as deviations from that rater's mean in standard
        deviations; NaN where nobody rated. Raters who gave every cut the same mark do not count.
    """
    table = np.asarray(marks, np.float64)
    known = np.isfinite(table)
    filled, rated = np.where(known, table, 0.0), np.maximum(known.sum(axis=0), 1)
    off = np.where(known, table - filled.sum(axis=0) / rated, 0.0)
    sd = np.sqrt((off**2).sum(axis=0) / rated)
    counts = known & (sd > 0.0)
    total, raters = (off / np.where(sd > 0.0, sd, 1.0)).sum(axis=1), counts.sum(axis=1)
    return np.where(raters > 0, total / np.maximum(raters, 1), np.nan)


def rater_agreement(marks: ArrayLike, people: Sequence[str], *, rng: np.random.Generator) -> RaterAgreement:
    """Compute the agreement of raters.

    Parameters
    ----------
    marks : array_like of shape (n, k)
        Marks of n cuts by k raters, 2 or more; NaN where a rater gave none. Cuts with a gap are left out.
    people : sequence of str
        Who made each cut.
    rng : numpy.random.Generator
        Source of the resamples.

    Returns
    -------
    RaterAgreement

    Raises
    ------
    ValueError
        If there are fewer than two raters or four cuts that all rated, or a rater gave every cut the same mark.

    Notes
    -----
    Intervals of the intraclass correlations are those of :func:`~cutenv.scoring.study.intraclass_correlation`: raters
    are a sample of raters, and cuts are taken as independent. That of the rank correlation is over people.
    """
    table = np.asarray(marks, np.float64)
    if table.ndim != 2 or table.shape[1] < 2:
        raise ValueError("agreement takes two raters or more")
    rated = np.isfinite(table).all(axis=1)
    table, made_by = table[rated], np.asarray(people)[rated]
    if len(table) < FEWEST_RATED:
        raise ValueError(f"fewer than {FEWEST_RATED} cuts were marked by all raters ({len(table)})")
    if any(vanishes(float(column.var()), column) for column in table.T):
        raise ValueError("a rater gave every cut the same mark")
    told = intraclass_correlation(table)
    weights = _weights(made_by, rng)
    pairs = [_rank_correlation(weights, table[:, i], table[:, j]) for i, j in combinations(range(table.shape[1]), 2)]
    rank, count = np.mean(pairs, axis=0), len(set(made_by.tolist()))
    return RaterAgreement(
        agreement=told.agreement,
        consistency=told.consistency,
        rank=over_people(float(rank[0]), rank[1:], count),
        raters=table.shape[1],
        cuts=len(table),
        people=count,
    )


def _weights(people: Array, rng: np.random.Generator) -> Array:
    """Return how often each cut counts: once in the first row, and in the others as often as its person is drawn."""
    names, person = np.unique(people, return_inverse=True)
    count = max(200, min(BOOTSTRAP_SIZE, _LARGEST_TABLE // len(people)))
    drawn = rng.multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=count)
    return np.vstack([np.ones(len(people)), drawn[:, person]])


def _rank_correlation(weights: Array, x: Array, y: Array) -> Array:
    return _correlation(weights, _ranks(weights, x), _ranks(weights, y))


def _ranks(weights: Array, values: Array) -> Array:
    """Return the ranks of values within each row's weighted sample, ties by their mean, about zero."""
    _, place = np.unique(values, return_inverse=True)
    at = np.zeros((len(values), int(place.max()) + 1))
    at[np.arange(len(values)), place] = 1.0
    total = weights @ at
    return np.asarray((np.cumsum(total, axis=1) - 0.5 * total)[:, place] - 0.5 * weights.sum(axis=1, keepdims=True))


def _correlation(weights: Array, x: Array, y: Array) -> Array:
    """Return the weighted linear correlation of each row; NaN where a row's values are all alike."""
    n = weights.sum(axis=1, keepdims=True)
    x, y = (each - (weights * each).sum(axis=1, keepdims=True) / n for each in (x, y))
    xx, yy, xy = ((weights * product).sum(axis=1) for product in (x * x, y * y, x * y))
    alike = (xx <= 1e-12 * xx.max()) | (yy <= 1e-12 * yy.max())
    return np.where(alike, np.nan, xy / np.sqrt(np.where(alike, 1.0, xx * yy)))
