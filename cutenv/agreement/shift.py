"""How far one side lies from the other, with interval, and the two questions that are asked of it.

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

FEWEST = 6
"""Specimens below which nothing is said: with five, no signed-rank interval has 95 %."""
_POWER = 0.842  # normal quantile of 80 %, with which a number of specimens is to be enough
_ALPHA = 1.0 - CONFIDENCE
_MOST = 1000  # specimens; more is no answer to "how many"


@dataclass(frozen=True, kw_only=True)
class Shift:
    """Rig minus simulator, in the measure's unit.

    Attributes
    ----------
    value, low, high : float
        Typical shift and its 95 % interval.
    margin : float
        What counts as no difference.
    p_within : float
        Of the hypothesis that the shift is as large as the margin or larger, either way: small says equivalent.
    p_beyond : float
        Of the hypothesis that it is within the margin: small says different.  Before any correction.
    number : int
        Of specimens.
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
        """Specimens that would probably (80 %) decide if shift and spread stay; None if more than 1000 would."""
        clear = abs(self.margin - abs(self.value))
        error = 0.5 * (self.high - self.low) / 1.96
        if error == 0.0 or clear == 0.0:
            return self.number if error == 0.0 else None
        quantile = 1.645 if abs(self.value) < self.margin else 3.1  # beyond: Holm's first step of two dozen measures
        needed = math.ceil(self.number * ((quantile + _POWER) * error / clear) ** 2)
        return None if needed > _MOST else max(needed, self.number + 1)


def signed_rank_shift(differences: ArrayLike, margin: float) -> Shift:
    """The typical difference: Hodges and Lehmann's, the median of the means of pairs, with Wilcoxon's interval.

    Parameters
    ----------
    differences : array_like of shape (n,)
        One for each specimen, 6 or more.
    margin : float
        Positive, in their unit.

    Returns
    -------
    Shift

    Raises
    ------
    TypeError, ValueError
        If there are too few, or one is not finite.

    Notes
    -----
    Why not the mean: a decision that falls one reading later lets a crack run a few millimetres away, and now and then
    a whole cut ends otherwise.  That one cut would rule the mean of a dozen, and hide what happens to all.  Such cuts
    are not lost: success and agreement of the ends count them, by the mean.  Source: Hollander, Wolfe & Chicken,
    Nonparametric Statistical Methods (2014), 3.1 to 3.3.  Ties count half.
    """
    d = values_of("differences", differences, fewest=FEWEST)
    i, j = np.triu_indices(len(d))
    walsh = np.sort(0.5 * (d[i] + d[j]))
    tail = _tail(len(d))
    # Of so many sums from the end, the interval leaves out the first whose tail is still small enough.
    out = int(np.sum(np.cumsum(_chances(len(d))) <= 0.5 * _ALPHA))
    return Shift(
        value=float(np.median(walsh)),
        low=float(walsh[out - 1]),
        high=float(walsh[-out]),
        margin=margin,
        p_within=max(tail(_rank_sum(walsh, -margin)), tail(_rank_sum(-walsh, -margin))),
        p_beyond=min(2.0 * min(tail(_rank_sum(walsh, margin)), tail(_rank_sum(-walsh, margin))), 1.0),
        number=len(d),
    )


def _rank_sum(walsh: NDArray[np.float64], at: float) -> float:
    """Wilcoxon's sum of the ranks above ``at``: as many as there are means of pairs above it."""
    return float(np.sum(walsh > at) + 0.5 * np.sum(walsh == at))


def _chances(n: int) -> NDArray[np.float64]:
    """Chance of each sum of ranks 0, 1, ..., n(n+1)/2 if nothing shifts: every rank is in it or not, by a coin."""
    chances = np.ones(1)
    for rank in range(1, n + 1):
        longer = np.zeros(len(chances) + rank)
        longer[: len(chances)] += 0.5 * chances
        longer[rank:] += 0.5 * chances
        chances = longer
    return chances


def _tail(n: int) -> Callable[[float], float]:
    """Chance of a sum of ranks as large as that, or larger."""
    chances = _chances(n)

    def at_least(rank_sum: float) -> float:
        return float(min(chances[math.floor(rank_sum) :].sum(), 1.0))

    return at_least


def mean_shift(value: float, error: float, degrees: float, margin: float, number: int) -> Shift:
    """A mean with its standard error: t interval, and both questions by t tests."""
    reach = float(student.ppf(1.0 - 0.5 * _ALPHA, degrees)) * error
    above = [float(student.sf(_over(sign * value + margin, error), degrees)) for sign in (1.0, -1.0)]
    beyond = [float(student.sf(_over(sign * value - margin, error), degrees)) for sign in (1.0, -1.0)]
    return Shift(
        value=value, low=value - reach, high=value + reach, margin=margin,
        p_within=max(above), p_beyond=min(2.0 * min(beyond), 1.0), number=number,
    )  # fmt: skip


def _over(excess: float, error: float) -> float:
    return excess / error if error > 0.0 else math.copysign(math.inf, excess)


def holm(chances: Sequence[float]) -> list[float]:
    """P values of several hypotheses, adjusted so that all of those below 0.05 are wrong at once in 5 % at most.

    Source: Holm, Scandinavian Journal of Statistics 6 (1979) 65-70; measures that go together do no harm to it.
    """
    adjusted = [1.0] * len(chances)
    so_far = 0.0
    for place, k in enumerate(sorted(range(len(chances)), key=chances.__getitem__)):
        so_far = max(so_far, min((len(chances) - place) * chances[k], 1.0))
        adjusted[k] = so_far
    return adjusted
