"""Separation of two groups by a metric, with intervals over people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import gammaln, nctdtrinc
from scipy.stats import norm

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.scoring.study.estimate import (
    CONFIDENCE,
    FEWEST_COMPARED,
    Estimate,
    series_of,
    vanishes,
    without_intervals,
)

FEWEST_IN_A_GROUP = 4
"""Smallest number of people in a group for an interval: 3 against 3 separate fully by chance in 1 of 10 studies."""
_EDGE = 1e-9  # distance from 0 and 1, where Newcombe's variance vanishes


@dataclass(frozen=True, kw_only=True)
class Separation:
    """Difference between the first group and the second.

    The unit is a person, represented by the mean of the cuts.

    Attributes
    ----------
    superiority : Estimate
        Probability that a person of the first group has the larger mean, ties half: the area under the ROC curve,
        U/(mn) of Mann and Whitney. 0.5 is no separation, 0 and 1 are full ones.
    difference : Estimate
        Hedges' g: difference of the groups' means over the standard deviation between people of a group, corrected
        for small samples.
    people : tuple of int
        Number of people in the first group and in the second.
    """

    superiority: Estimate
    difference: Estimate
    people: tuple[int, int]


def separation(
    first: Sequence[ArrayLike], second: Sequence[ArrayLike], *, confidence: float = CONFIDENCE
) -> Separation:
    """Compute the separation of two groups of people.

    Parameters
    ----------
    first, second : sequence of array_like
        The values of each person's cuts, one or more; 2 people or more in each group; one unit. With fewer than 4 in a
        group there is no interval.

    Raises
    ------
    TypeError, ValueError
        If there are too few people, or nobody differs within the groups.

    Notes
    -----
    Cuts of one person are correlated: treated as independent they make intervals far too narrow, so each person is
    one value. Intervals of the probability: Newcombe, Statistics in Medicine 25 (2006) 559-573, method 5, doi
    10.1002/sim.2324, which holds for few people and full separation; of g: the noncentral t distribution of Hedges
    & Olkin, Statistical Methods for Meta-Analysis (1985), chapter 5, for approximately normal means. A bootstrap over
    people is not used: with six in a group its 95 % intervals covered the truth in 69 to 92 of 100 trials, and full
    separation gives an interval of zero width.
    """
    level = in_range("confidence", confidence, 0.5, 0.999, "1")
    a, b = (
        np.array([column.mean() for column in series_of(name, series, fewest=1, people=FEWEST_COMPARED)])
        for name, series in (("first", first), ("second", second))
    )
    found = Separation(
        superiority=_superiority(a, b, level), difference=_difference(a, b, level), people=(len(a), len(b))
    )
    return without_intervals(found) if min(found.people) < FEWEST_IN_A_GROUP else found


def _superiority(a: Array, b: Array, level: float) -> Estimate:
    m, n = len(a), len(b)
    theta = float(np.mean(a[:, None] > b) + 0.5 * np.mean(a[:, None] == b))
    z = float(norm.ppf(0.5 * (1.0 + level)))
    N = 0.5 * (m + n) - 1.0

    def excess(x: float) -> float:
        """Return the deviation from ``x`` beyond chance."""
        variance = x * (1.0 - x) / (m * n) * (1.0 + N * (1.0 - x) / (2.0 - x) + N * x / (1.0 + x))
        return abs(theta - x) - z * math.sqrt(variance)

    low = 0.0 if theta <= 0.0 else float(brentq(excess, 0.0, min(theta, 1.0 - _EDGE)))
    high = 1.0 if theta >= 1.0 else float(brentq(excess, max(theta, _EDGE), 1.0))
    return Estimate(value=theta, low=low, high=high)


def _difference(a: Array, b: Array, level: float) -> Estimate:
    m, n = len(a), len(b)
    df = m + n - 2
    variance = ((m - 1) * a.var(ddof=1) + (n - 1) * b.var(ddof=1)) / df
    if vanishes(variance, np.concatenate((a, b))):
        raise ValueError(
            f"nobody differs within the groups (first: {a[0]:g} for all, second: {b[0]:g}): the standardised "
            "difference needs spread. A metric that counts rare events may have none; choose another."
        )
    d = float((a.mean() - b.mean()) / math.sqrt(variance))
    scale = math.sqrt(1.0 / m + 1.0 / n)
    correction = math.exp(gammaln(0.5 * df) - gammaln(0.5 * (df - 1))) * math.sqrt(2.0 / df)
    low, high = (float(nctdtrinc(df, p, d / scale)) * scale for p in (0.5 * (1.0 + level), 0.5 * (1.0 - level)))
    return Estimate(value=correction * d, low=low, high=high)
