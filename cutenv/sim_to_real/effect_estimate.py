"""Shift between rig and simulator with its interval, and the two hypotheses tested about it.

Is the shift *within* a margin (equivalence: two one-sided tests)?  Is it *beyond* the margin?  Both can be open.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from cutenv.scoring.study.estimate import CONFIDENCE, values_of

FEWEST_SPECIMENS = 6
"""Smallest number of specimens: with five, no signed-rank interval reaches 95 %."""
_POWER = 0.842  # normal quantile of 80 %, the power for the number of specimens needed
_ALPHA = 1.0 - CONFIDENCE
_MOST = 1000  # largest number of specimens that is given as needed


@dataclass(frozen=True, kw_only=True)
class EffectEstimate:
    """Rig minus simulator, in the measure's unit.

    Attributes
    ----------
    value, low, high : float
        Typical shift and its 95 % interval.
    margin : float
        Equivalence margin.
    p_within : float
        P value of the hypothesis that the shift is at least as large as the margin, either way: small means equivalent.
    p_beyond : float
        P value of the hypothesis that it is within the margin: small means different.  Before any correction.
    number : int
        Number of specimens.
    """

    value: float
    low: float
    high: float
    margin: float
    p_within: float
    p_beyond: float
    number: int

    @property
    def needed(self) -> int | None:
        """Specimens that would probably (80 %) decide if shift and spread stay; None if more than 1000 are needed."""
        clear = abs(self.margin - abs(self.value))
        error = 0.5 * (self.high - self.low) / 1.96
        if error == 0.0 or clear == 0.0:
            return self.number if error == 0.0 else None
        quantile = 1.645 if abs(self.value) < self.margin else 3.1  # beyond: Holm's first step of two dozen measures
        needed = math.ceil(self.number * ((quantile + _POWER) * error / clear) ** 2)
        return None if needed > _MOST else max(needed, self.number + 1)


def signed_rank_shift(differences: ArrayLike, margin: float) -> EffectEstimate:
    """Estimate the typical difference: Hodges-Lehmann (median of the means of pairs) with Wilcoxon's interval.

    Parameters
    ----------
    differences : array_like of shape (n,)
        One difference for each specimen, 6 or more.
    margin : float
        Equivalence margin, positive, in their unit.

    Returns
    -------
    Shift

    Raises
    ------
    TypeError, ValueError
        If there are too few, or one is not finite.

    Notes
    -----
    The mean is not robust here: a decision that falls one reading later lets a crack run a few millimetres, and now
    and then a whole cut ends differently.  One such cut would dominate the mean of a dozen and hide the typical effect.
    Such cuts still count: success and agreement of the ends are compared by the mean.  Source: Hollander, Wolfe &
    Chicken, Nonparametric Statistical Methods (2014), 3.1 to 3.3.  Ties count half.
    """
    d = values_of("differences", differences, fewest=FEWEST_SPECIMENS)
    i, j = np.triu_indices(len(d))
    walsh = np.sort(0.5 * (d[i] + d[j]))
    tail = _tail(len(d))
    # The interval drops as many of the smallest and largest Walsh averages as the tail probability allows.
    out = int(np.sum(np.cumsum(_chances(len(d))) <= 0.5 * _ALPHA))
    return EffectEstimate(
        value=float(np.median(walsh)),
        low=float(walsh[out - 1]),
        high=float(walsh[-out]),
        margin=margin,
        p_within=max(tail(_rank_sum(walsh, -margin)), tail(_rank_sum(-walsh, -margin))),
        p_beyond=min(2.0 * min(tail(_rank_sum(walsh, margin)), tail(_rank_sum(-walsh, margin))), 1.0),
        number=len(d),
    )


def _rank_sum(walsh: NDArray[np.float64], at: float) -> float:
    """Return Wilcoxon's sum of the ranks above ``at``: the number of Walsh averages above it."""
    return float(np.sum(walsh > at) + 0.5 * np.sum(walsh == at))


def _chances(n: int) -> NDArray[np.float64]:
    """Return the probability of each sum of ranks 0, 1, ..., n(n+1)/2 if nothing shifts (each rank by a fair coin)."""
    chances = np.ones(1)
    for rank in range(1, n + 1):
        longer = np.zeros(len(chances) + rank)
        longer[: len(chances)] += 0.5 * chances
        longer[rank:] += 0.5 * chances
        chances = longer
    return chances


def _tail(n: int) -> Callable[[float], float]:
    """Return the function that gives the probability of a sum of ranks at least as large."""
    chances = _chances(n)

    def at_least(rank_sum: float) -> float:
        return float(min(chances[math.floor(rank_sum) :].sum(), 1.0))

    return at_least


def mean_shift(value: float, error: float, degrees: float, margin: float, number: int) -> EffectEstimate:
    """Build a shift from a mean with its standard error: t interval, and t tests of both hypotheses."""
    reach = float(student.ppf(1.0 - 0.5 * _ALPHA, degrees)) * error
    above = [float(student.sf(_over(sign * value + margin, error), degrees)) for sign in (1.0, -1.0)]
    beyond = [float(student.sf(_over(sign * value - margin, error), degrees)) for sign in (1.0, -1.0)]
    return EffectEstimate(
        value=value, low=value - reach, high=value + reach, margin=margin,
        p_within=max(above), p_beyond=min(2.0 * min(beyond), 1.0), number=number,
    )  # fmt: skip


def _over(excess: float, error: float) -> float:
    return excess / error if error > 0.0 else math.copysign(math.inf, excess)


def holm(chances: Sequence[float]) -> list[float]:
    """Adjust P values of several hypotheses so that the chance of any false rejection below 0.05 is at most 5 %.

    Source: Holm, Scandinavian Journal of Statistics 6 (1979) 65-70; valid for dependent measures.
    """
    adjusted = [1.0] * len(chances)
    so_far = 0.0
    for place, k in enumerate(sorted(range(len(chances)), key=chances.__getitem__)):
        so_far = max(so_far, min((len(chances) - place) * chances[k], 1.0))
        adjusted[k] = so_far
    return adjusted
