"""Reliability of a metric, and agreement of raters.

Reliability (ICC) is the spread of a metric between people against the spread between the cuts of one person. Marks of
raters, any number of them and on any scale, are compared with a metric and with each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import f as fisher

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range, one_of
from cutenv.records.scoring.study.estimate import (
    BOOTSTRAP_SIZE,
    CONFIDENCE,
    FEWEST_COMPARED,
    FEWEST_PEOPLE,
    Estimate,
    over_people,
    series_of,
    vanishes,
    without_intervals,
)


@dataclass(frozen=True, kw_only=True)
class Intraclass:
    """Intraclass correlations of a full table, with intervals.

    Notation of McGraw & Wong (1996), then Shrout & Fleiss (1979): ``one_way`` is ICC(1), or ICC(1,1); ``agreement``
    ICC(A,1), or ICC(2,1); ``consistency`` ICC(C,1), or ICC(3,1). Those of means over the k columns end in
    ``_of_means``: ICC(k), ICC(A,k), ICC(C,k), or ICC(1,k), ICC(2,k), ICC(3,k).

    Attributes
    ----------
    one_way : Estimate
        Columns of different rows have nothing in common: measurements are nested in rows.
    agreement : Estimate
        Columns are a sample (sessions, raters); a shift between them counts as disagreement.
    consistency : Estimate
        A shift between columns, such as learning from one session to the next, does not count.
    """

    one_way: Estimate
    agreement: Estimate
    consistency: Estimate
    one_way_of_means: Estimate
    agreement_of_means: Estimate
    consistency_of_means: Estimate
    rows: int
    columns: int


@dataclass(frozen=True, kw_only=True)
class OneWay:
    """Reliability by one-way analysis, with different numbers of cuts.

    Attributes
    ----------
    single : Estimate
        Reliability of one cut: share of the variance that is between people; a negative value means none.
    mean : Estimate
        Reliability of a person's mean over ``cuts`` cuts.
    cuts : float
        Harmonic mean of the numbers of cuts.
    between_sd, within_sd : float
        Standard deviation between people, and between one person's cuts; in the metric's unit.
    """

    single: Estimate
    mean: Estimate
    cuts: float
    people: int
    total: int
    between_sd: float
    within_sd: float

    def cuts_for(self, reliability: float = 0.8) -> float:
        """Return the number of cuts for a mean's reliability (Spearman-Brown).

        Infinite if single cuts have none; `reliability` is 0.01 to 0.99.
        """
        wanted = in_range("reliability", reliability, 0.01, 0.99, "1")
        rho = self.single.value
        return float("inf") if rho <= 0.0 else wanted * (1.0 - rho) / ((1.0 - wanted) * rho)


def intraclass_correlation(ratings: ArrayLike, *, confidence: float = CONFIDENCE) -> Intraclass:
    """Compute intraclass correlations of a complete table, with F intervals.

    Parameters
    ----------
    ratings : array_like of shape (n, k)
        A row for each person (2 or more; with 2 there is no interval), a column for each session or rater (2 or more);
        any one unit.
    confidence : float
        Level of the intervals, 0.5 to 0.999.

    Raises
    ------
    TypeError, ValueError
        If the table is too small, has gaps, or its rows do not differ.

    Notes
    -----
    McGraw & Wong, Psychological Methods 1 (1996) 30-46, Tables 4 and 7, doi 10.1037/1082-989X.1.1.30; Shrout &
    Fleiss, Psychological Bulletin 86 (1979) 420-428. In the degrees of freedom of ICC(A,1)'s interval (Satterthwaite)
    a negative estimate is replaced by 0.
    """
    table = array_in_range("ratings", ratings, -1e12, 1e12, "1", "Leave out rows with gaps.")
    if table.ndim != 2 or table.shape[0] < FEWEST_COMPARED or table.shape[1] < 2:
        raise ValueError(
            f"ratings has shape {table.shape}; give {FEWEST_COMPARED} rows (people) or more and 2 columns (sessions) "
            "or more."
        )
    n, k = table.shape
    rows, columns, grand = table.mean(axis=1), table.mean(axis=0), float(table.mean())
    # The paper's mean squares: rows, within rows, columns, error.
    MSR = k * float(np.sum((rows - grand) ** 2)) / (n - 1)
    MSW = float(np.sum((table - rows[:, None]) ** 2)) / (n * (k - 1))
    MSC = n * float(np.sum((columns - grand) ** 2)) / (k - 1)
    residual = table - rows[:, None] - columns + grand
    MSE = float(np.sum(residual**2)) / ((n - 1) * (k - 1))
    _check_rows_differ("ratings", MSR, table)
    p = 0.5 * (1.0 + in_range("confidence", confidence, 0.5, 0.999, "1"))
    error = (n - 1) * (k - 1)
    one, one_mean = _of_ratio(MSR, MSW, k, _quantile(p, n - 1, n * (k - 1)), _quantile(p, n * (k - 1), n - 1))
    consistent, consistent_mean = _of_ratio(MSR, MSE, k, _quantile(p, n - 1, error), _quantile(p, error, n - 1))
    agreement = _agreement((MSR, MSC, MSE), (n, k), p)
    found = Intraclass(
        one_way=one,
        agreement=agreement,
        consistency=consistent,
        one_way_of_means=one_mean,
        agreement_of_means=Estimate(
            value=(MSR - MSE) / (MSR + (MSC - MSE) / n),
            low=None if agreement.low is None else _of_mean(agreement.low, k),
            high=None if agreement.high is None else _of_mean(agreement.high, k),
        ),
        consistency_of_means=consistent_mean,
        rows=n,
        columns=k,
    )
    return without_intervals(found) if n < FEWEST_PEOPLE else found


def one_way_reliability(series: Sequence[ArrayLike], *, confidence: float = CONFIDENCE) -> OneWay:
    """Compute reliability of single cuts and means.

    People may differ in number of cuts.

    Parameters
    ----------
    series : sequence of array_like
        The values of each person's cuts: 2 people or more, 2 cuts each or more; any one unit. With fewer than 3 people
        there is no interval.
    confidence : float
        Level of the intervals, 0.5 to 0.999.

    Raises
    ------
    TypeError, ValueError
        If there are too few people or cuts, or people's means do not differ at all.

    Notes
    -----
    Analysis of variance by unweighted means, so that each person has the same weight: with equal numbers it is ICC(1)
    and its exact interval, else an approximate one. Thomas & Hultquist, Annals of Statistics 6 (1978) 582-587,
    doi 10.1214/aos/1176344202.
    """
    columns = series_of("series", series, fewest=2, people=FEWEST_COMPARED)
    p = 0.5 * (1.0 + in_range("confidence", confidence, 0.5, 0.999, "1"))
    sizes = np.array([len(column) for column in columns])
    n, total = len(columns), int(sizes.sum())
    means = np.array([column.mean() for column in columns])
    k = n / float(np.sum(1.0 / sizes))
    MSB = k * float(means.var(ddof=1))
    MSW = sum(float(np.sum((column - column.mean()) ** 2)) for column in columns) / (total - n)
    _check_rows_differ("series", MSB, np.concatenate(columns))
    single, mean = _of_ratio(MSB, MSW, k, _quantile(p, n - 1, total - n), _quantile(p, total - n, n - 1))
    found = OneWay(
        single=single,
        mean=mean,
        cuts=k,
        people=n,
        total=total,
        between_sd=float(np.sqrt(max(MSB - MSW, 0.0) / k)),
        within_sd=float(np.sqrt(MSW)),
    )
    return without_intervals(found) if n < FEWEST_PEOPLE else found


def _of_ratio(MSR: float, MSE: float, k: float, F_low: float, F_high: float) -> tuple[Estimate, Estimate]:
    """Return single and mean correlations from F = MSR/MSE and quantiles."""
    single = Estimate(
        value=(MSR - MSE) / (MSR + (k - 1.0) * MSE),
        low=(MSR - F_low * MSE) / (MSR + (k - 1.0) * F_low * MSE),
        high=(F_high * MSR - MSE) / (F_high * MSR + (k - 1.0) * MSE),
    )
    mean = Estimate(value=1.0 - MSE / MSR, low=1.0 - F_low * MSE / MSR, high=1.0 - MSE / (F_high * MSR))
    return single, mean


def _agreement(mean_squares: tuple[float, float, float], shape: tuple[int, int], p: float) -> Estimate:
    (MSR, MSC, MSE), (n, k) = mean_squares, shape
    rho = (MSR - MSE) / (MSR + (k - 1) * MSE + k / n * (MSC - MSE))
    if MSE <= 0.0 and MSC <= 0.0:
        return Estimate(value=1.0, low=1.0, high=1.0)
    known = max(rho, 0.0)
    a = k * known / (n * (1.0 - known))
    b = 1.0 + k * known * (n - 1) / (n * (1.0 - known))
    v = (a * MSC + b * MSE) ** 2 / ((a * MSC) ** 2 / (k - 1) + (b * MSE) ** 2 / ((n - 1) * (k - 1)))
    F_low, F_high = _quantile(p, n - 1, v), _quantile(p, v, n - 1)
    rest = k * MSC + (k * n - k - n) * MSE
    return Estimate(
        value=rho,
        low=n * (MSR - F_low * MSE) / (F_low * rest + n * MSR),
        high=n * (F_high * MSR - MSE) / (rest + n * F_high * MSR),
    )


def _quantile(p: float, numerator: float, denominator: float) -> float:
    return float(fisher.ppf(p, numerator, denominator))


def _of_mean(rho: float, k: float) -> float:
    """Return the mean's correlation over k by Spearman-Brown."""
    return k * rho / (1.0 + (k - 1.0) * rho)


def _check_rows_differ(name: str, MSR: float, values: Array) -> None:
    if vanishes(MSR, values):
        raise ValueError(f"{name}: the people do not differ in their means; a correlation needs people who differ.")


FEWEST_RATED = 4  # smallest number of rated cuts for a correlation: three lie in order by chance once in six times
_LARGEST_TABLE = 4_000_000  # resamples times cuts that are held in memory at once


@dataclass(frozen=True, kw_only=True)
class RaterCorrelation:
    """Correlation of a metric with marks, positive if better got better."""

    rank: Estimate
    linear: Estimate
    cuts: int
    people: int


@dataclass(frozen=True, kw_only=True)
class RaterAgreement:
    """Agreement of raters over cuts rated by all.

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
    """Compute rank and linear correlation of metric and marks.

    Parameters
    ----------
    values, marks : array_like of shape (n,)
        Value and mark of each cut, in any unit and on any scale; NaN where a cut has none.
    best_mark : {"highest", "lowest"}
        Which end of the raters' scale is best.

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
    """Return mean marks over raters with different scales, shape (n,).

    Of n cuts by k raters; NaN where a rater gave none. Each rater's marks are taken as deviations from that rater's
    mean in standard deviations; NaN where nobody rated. Raters who gave every cut the same mark do not count.
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

    Raises
    ------
    ValueError
        If there are fewer than two raters or four cuts that all rated, or a rater gave every cut the same mark.

    Notes
    -----
    Intervals of the intraclass correlations are those of :func:`~cutenv.records.scoring.study.intraclass_correlation`:
    raters are a sample of raters, and cuts are taken as independent. That of the rank correlation is over people.
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
    """Return cut weights: ones first, then draws of people."""
    names, person = np.unique(people, return_inverse=True)
    count = max(200, min(BOOTSTRAP_SIZE, _LARGEST_TABLE // len(people)))
    drawn = rng.multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=count)
    return np.vstack([np.ones(len(people)), drawn[:, person]])


def _rank_correlation(weights: Array, x: Array, y: Array) -> Array:
    return _correlation(weights, _ranks(weights, x), _ranks(weights, y))


def _ranks(weights: Array, values: Array) -> Array:
    """Return weighted ranks by row about zero, ties averaged."""
    _, place = np.unique(values, return_inverse=True)
    at = np.zeros((len(values), int(place.max()) + 1))
    at[np.arange(len(values)), place] = 1.0
    total = weights @ at
    return np.asarray((np.cumsum(total, axis=1) - 0.5 * total)[:, place] - 0.5 * weights.sum(axis=1, keepdims=True))


def _correlation(weights: Array, x: Array, y: Array) -> Array:
    """Return weighted linear correlations by row, NaN for constant values."""
    n = weights.sum(axis=1, keepdims=True)
    x, y = (each - (weights * each).sum(axis=1, keepdims=True) / n for each in (x, y))
    xx, yy, xy = ((weights * product).sum(axis=1) for product in (x * x, y * y, x * y))
    alike = (xx <= 1e-12 * xx.max()) | (yy <= 1e-12 * yy.max())
    return np.where(alike, np.nan, xy / np.sqrt(np.where(alike, 1.0, xx * yy)))
