"""Sequential comparison.

Look after every cut, and stop when it is decided, with a bound on the error all the same.

An outcome of a pair of cuts is a difference d between -``reach`` and ``reach``, such as of two returns.  Whoever
believes that its mean is at most m stakes a fixed share of what he has on every pair, at fair odds: his wealth is
multiplied by 1 + f (d - m) / (reach + m).  If he is right, the wealth exceeds 2 / error at *any* time with a
probability of error / 2 at most (Ville), for any distribution of d whatever; and so does the mean wealth of several
people with other shares f.  What no such wealth refutes is the interval: a confidence sequence (Waudby-Smith & Ramdas
2024, hedged capital, with bets that are fixed in advance).

What is tested, exactly: that the mean, over the pairs so far, of the means that each pair had given all that went
before it, is at most m.  Because the shares are fixed, this holds for means that drift from day to day, too.  The
interval as a whole covers a mean that stays.  No bound on outcomes, no such guarantee: a return that is bounded above
alone is clipped below at a stated floor, and the statement is about the clipped one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range

SequentialDecision = Literal["better", "worse", "equivalent", "undecided"]
DECISIONS: tuple[SequentialDecision, ...] = ("undecided", "better", "worse", "equivalent")
"""Possible decisions; the place of each is its number in arrays."""
RETURN_FLOOR = 0.0  # return below which returns count alike: a cut that harms as much as it gains [1]
RETURN_TOP = 1.0  # largest return [1]
MAX_CORRECTION = 0.5  # largest correction of a difference by a covariate [1]
_SHARES = 0.95 * 0.5 ** np.arange(4)  # of the wealth: from bold to cautious
_HALVINGS = 40  # of an interval that holds an end
_CAUTION = 0.2  # added to the sum of squares below the coefficient: as of some five covariates


@dataclass(frozen=True, kw_only=True)
class SequentialQuestion:
    """Question that a comparison is to answer."""

    error: float = 0.05  # bound on the probability of any wrong decision, whenever one looks
    smallest: float = 0.05  # smallest difference that matters: closer to zero, both are equivalent
    most: int = 400
    reach: float = 1.0  # largest size of a difference

    def __post_init__(self) -> None:
        in_range("reach", self.reach, 1e-9, 1e9, "1", "Give the largest size of a difference.")
        in_range("error", self.error, 1e-6, 0.5, "1", "Give 0.05.")
        in_range("smallest", self.smallest, 1e-3 * self.reach, 0.9 * self.reach, "1", "Give what would matter.")
        in_range("most", self.most, 2, 100_000, "1", "Give the pairs that can be had.")

    @property
    def bar(self) -> float:
        """Logarithm of the wealth that refutes one side."""
        return math.log(2.0 / self.error)


def log_wealth(differences: Array, mean: float, reach: float | Array) -> Array:
    """Return log wealth by pair against a mean of at most ``mean``.

    The differences, shape (..., n), are one after another, of one study or several; against a mean that is at *least* m
    give ``-d`` and ``-m``. ``mean`` is above -``reach``, the largest size of each difference, as is known before it.
    """
    gains = (differences - mean) / (reach + mean)
    wealth: Array = np.full(gains.shape, -np.inf)
    for share in _SHARES:
        np.logaddexp(wealth, np.cumsum(np.log1p(share * gains), axis=-1), out=wealth)
    return wealth - math.log(len(_SHARES))


def sequential_decisions(differences: Array, question: SequentialQuestion, room: float | Array = 0.0) -> Indices:
    """Return the decision number in :data:`DECISIONS` after each pair.

    The numbers have shape (..., n). The first that is not 0 is the decision; whoever goes on cutting may find another.
    ``room`` is how much farther each difference can reach, see :func:`corrected`.
    """
    reach = _checked_reach(differences, question, room)
    refuted = {
        (side, mean): log_wealth(side * differences, mean, reach) >= question.bar
        for side in (1.0, -1.0)
        for mean in (0.0, -question.smallest)
    }
    within = refuted[1.0, -question.smallest] & refuted[-1.0, -question.smallest]
    said: Indices = np.select([refuted[1.0, 0.0], refuted[-1.0, 0.0], within], [1, 2, 3], 0)
    return said


def stops(said: Indices) -> tuple[Indices, Indices]:
    """Return each study's stopping pair and decision, shape (...) each."""
    decided = said > 0
    at = np.where(decided.any(axis=-1), np.argmax(decided, axis=-1), said.shape[-1] - 1)
    return at + 1, np.take_along_axis(said, at[..., None], axis=-1)[..., 0]


def confidence_sequence(
    differences: Array, question: SequentialQuestion, room: float | Array = 0.0
) -> tuple[Array, Array]:
    """Return the mean's interval ends after every pair, shape (n,). ``room`` is as for :func:`sequential_decisions`."""
    reach = np.broadcast_to(_checked_reach(differences, question, room), differences.shape)
    count = range(1, len(differences) + 1)
    low = [_end(differences[:k], reach[:k], question.bar) for k in count]
    high = [-_end(-differences[:k], reach[:k], question.bar) for k in count]
    return np.array(low), np.array(high)


def _end(differences: Array, reach: Array, bar: float) -> float:
    """Return the largest mean refuted as an upper bound, by halving."""
    high = float(reach.min())
    low = -high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if log_wealth(differences, middle, reach)[-1] >= bar:
            low = middle
        else:
            high = middle
    return low


def _checked_reach(differences: Array, question: SequentialQuestion, room: float | Array) -> float | Array:
    beyond = float(np.max(np.abs(differences) - room, initial=0.0))
    if not beyond <= question.reach * (1.0 + 1e-9):
        raise ValueError(
            f"differences: {beyond:g} is beyond reach = {question.reach:g}. Clip them, or give their reach."
        )
    return question.reach + room


def corrected(differences: Array, covariates: Array) -> tuple[Array, Array]:
    """Return differences less a covariate's part, and their room.

    The coefficient is from earlier pairs alone. A fair coin must give the covariate its sign after its size is fixed:
    two cuts lie beside each other, the coin says which policy cuts where, and the covariate is what a forecast that
    does not know of the coin says of the first policy's place less that of the other's. Then its mean is zero given all
    that went before, whatever the forecast is worth, and so the mean of a difference stays what it was: a bad forecast
    costs pairs, never validity.

    All have shape (..., n), every pair one after another; a covariate that is not known is 0. The room is the size of
    each correction, at most :data:`MAX_CORRECTION`: by that much farther a difference can reach, so that less is staked
    on it. Where a mean drifts, such pairs count for less in it.
    """

    def before(values: Array) -> Array:
        return np.asarray(np.cumsum(values, axis=-1) - values)

    coefficient = before(differences * covariates) / (before(covariates**2) + _CAUTION)
    correction = np.clip(coefficient * covariates, -MAX_CORRECTION, MAX_CORRECTION)
    return differences - correction, np.abs(correction)


@dataclass(frozen=True, kw_only=True)
class PlannedPairs:
    """Number of pairs for a question, by simulated studies."""

    median: float  # median of the pairs to a decision, and its 95 % interval, by the choice of the pilot pairs
    low: float
    high: float
    nine_in_ten: float  # pairs within which nine in ten studies end
    chances: dict[str, float]  # probability of each decision
    # pairs of a fixed design with a t test, planned to find ``smallest`` with the same error and a power of 0.9
    fixed: int


def fixed_design(sd: float, question: SequentialQuestion, power: float = 0.9) -> int:
    """Return a t test's number of pairs, by normal approximation.

    The test finds a mean of ``smallest`` with this power.
    """
    from scipy.stats import norm

    quantiles = float(norm.isf(0.5 * question.error) + norm.ppf(power))
    return max(2, math.ceil((quantiles * sd / question.smallest) ** 2 + 2.0))  # 2: t instead of normal


def planned_pairs(pilot: Array, question: SequentialQuestion, *, seed: int = 0, studies: int = 400) -> PlannedPairs:
    """Return how many pairs a question needs, by a pilot.

    The pilot are the differences of 20 pairs or more, such as simulated ones. Each of the simulated studies draws its
    pairs from one resample of the pilot in twenty.
    """
    in_range("pilot pairs", len(pilot), 20, 1_000_000, "1", "Simulate 20 or more.")
    rng = np.random.default_rng(seed)
    medians = []
    for _ in range(20):
        again = pilot[rng.integers(len(pilot), size=len(pilot))]
        drawn = again[rng.integers(len(pilot), size=(studies, question.most))]
        medians.append(float(np.median(stops(sequential_decisions(drawn, question))[0])))
    drawn = pilot[rng.integers(len(pilot), size=(4 * studies, question.most))]
    at, said = stops(sequential_decisions(drawn, question))
    low, high = np.percentile(medians, (2.5, 97.5))
    return PlannedPairs(
        median=float(np.median(at)),
        low=float(low),
        high=float(high),
        nine_in_ten=float(np.percentile(at, 90)),
        chances={name: float(np.mean(said == k)) for k, name in enumerate(DECISIONS)},
        fixed=fixed_design(float(pilot.std(ddof=1)), question),
    )
