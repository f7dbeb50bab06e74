"""Equivalence test of rig and simulator for one policy.

All measures, and the verdict over all of them.

Of the shift between rig and simulator, with its interval, two hypotheses are tested.  Is the shift *within* a
margin (equivalence: two one-sided tests)?  Is it *beyond* the margin?  Both can be open.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from cutenv.agents.sim_to_real.measures import RELATIVE, ComparedCut, Measure, measures_of
from cutenv.records.scoring.study.estimate import CONFIDENCE, values_of

FEWEST_SPECIMENS = 6
"""Smallest number of specimens: with five, no signed-rank interval reaches 95 %."""
_POWER = 0.842  # normal quantile of 80 %, the power for the number of specimens needed
_ALPHA = 1.0 - CONFIDENCE
_NOTHING = "it is 0 in every cut, on both sides"
_MAX_SPECIMENS = 1000  # largest number of specimens that is given as needed


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
        """Specimens needed for a decision with 80 % power; None above 1000."""
        clear = abs(self.margin - abs(self.value))
        error = 0.5 * (self.high - self.low) / 1.96
        if error == 0.0 or clear == 0.0:
            return self.number if error == 0.0 else None
        quantile = 1.645 if abs(self.value) < self.margin else 3.1  # beyond: Holm's first step of two dozen measures
        needed = math.ceil(self.number * ((quantile + _POWER) * error / clear) ** 2)
        return None if needed > _MAX_SPECIMENS else max(needed, self.number + 1)


def signed_rank_shift(differences: ArrayLike, margin: float) -> EffectEstimate:
    """Estimate the typical difference: Hodges-Lehmann, with Wilcoxon's interval.

    Parameters
    ----------
    differences : array_like of shape (n,)
        One difference for each specimen, 6 or more.
    margin : float
        Equivalence margin, positive, in their unit.

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
    """Return Wilcoxon's rank sum: how many Walsh averages exceed ``at``."""
    return float(np.sum(walsh > at) + 0.5 * np.sum(walsh == at))


def _chances(n: int) -> NDArray[np.float64]:
    """Return probabilities of rank sums 0 to n(n+1)/2 without shift."""
    chances = np.ones(1)
    for rank in range(1, n + 1):
        longer = np.zeros(len(chances) + rank)
        longer[: len(chances)] += 0.5 * chances
        longer[rank:] += 0.5 * chances
        chances = longer
    return chances


def _tail(n: int) -> Callable[[float], float]:
    """Return the tail probability function of rank sums."""
    chances = _chances(n)

    def at_least(rank_sum: float) -> float:
        return float(min(chances[math.floor(rank_sum) :].sum(), 1.0))

    return at_least


def mean_shift(value: float, error: float, degrees: float, margin: float, number: int) -> EffectEstimate:
    """Build a shift with t interval and t tests from a mean."""
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
    """Adjust P values of several hypotheses by Holm's method.

    The chance of any false rejection below 0.05 is then at most 5 %.  Source: Holm, Scandinavian Journal of Statistics
    6 (1979) 65-70; valid for dependent measures.
    """
    adjusted = [1.0] * len(chances)
    so_far = 0.0
    for place, k in enumerate(sorted(range(len(chances)), key=chances.__getitem__)):
        so_far = max(so_far, min((len(chances) - place) * chances[k], 1.0))
        adjusted[k] = so_far
    return adjusted


ALPHA = 0.05
_NAMED = 3  # number of measures named in one line
Answer = Literal["agree", "differ", "undecided"]


@dataclass(frozen=True)
class Inconclusive:
    """The reason why a measure cannot be compared."""

    reason: str


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One measure on both sides.

    Attributes
    ----------
    rig, simulator : float
        Means over the specimens that have it.
    noise : float
        Root mean square difference between two simulated cuts of a specimen, caused by sensor noise alone.
    shift : EffectEstimate
        Rig minus simulator.
    mean : EffectEstimate
        Mean difference, with its t interval.
    p_differ : float
        P value of the hypothesis that the shift is within its margin, adjusted for the number of measures.
    """

    measure: Measure
    rig: float
    simulator: float
    noise: float
    shift: EffectEstimate
    mean: EffectEstimate
    p_differ: float = 1.0

    @property
    def answer(self) -> Answer:
        """Result for this measure."""
        if self.shift.p_within < ALPHA:
            return "agree"
        return "differ" if self.p_differ < ALPHA else "undecided"

    def to_dict(self) -> dict[str, Any]:
        """Return a JSON-serialisable dictionary."""
        shift, mean = self.shift, self.mean
        return {
            "measure": self.measure.name,
            "unit": self.measure.unit,
            "answer": self.answer,
            "specimens": shift.number,
            "rig": self.rig,
            "simulator": self.simulator,
            "difference": shift.value,
            "difference_low_95": shift.low,
            "difference_high_95": shift.high,
            "mean_difference": mean.value,
            "mean_difference_low_95": mean.low,
            "mean_difference_high_95": mean.high,
            "margin": shift.margin,
            "noise": self.noise,
            "p_within_margin": shift.p_within,
            "p_beyond_margin_holm": self.p_differ,
        }


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Result over all measures.

    Attributes
    ----------
    answer : {"agree", "differ", "undecided"}
        "agree": every measure is within its margin; "differ": at least one is beyond it.
    differ, open : tuple of str
        Names of the measures that differ, and of those that are undecided.
    needed : int or None
        Number of specimens that would probably decide the open ones; None: more than 1000, or nothing is open.
    """

    answer: Answer
    differ: tuple[str, ...]
    open: tuple[str, ...]
    needed: int | None

    def __str__(self) -> str:
        if self.answer == "agree":
            return "agree: every measure is within its margin"
        if self.answer == "differ":
            return f"differ: {_listed(self.differ)}"
        enough = "more than 1000 specimens" if self.needed is None else f"about {self.needed} specimens"
        return f"undecided: {_listed(self.open)}; {enough} would do"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


class Agreement:
    """Comparison of a policy's cuts on rig and in simulator.

    Parameters
    ----------
    rig : sequence of ComparedCut
        One cut for each specimen.
    simulator : sequence of sequence of ComparedCut
        For each specimen two cuts or more that differ only by the noise of the force sensor.  A rig's cut is compared
        with their mean, and they with each other: that is the effect of noise alone.
    paired : bool
        True if both sides cut the same specimens.  A real rig's specimens are unknown to the simulator: then the
        sides are two samples (Welch's t), and nothing can be compared cut by cut.
    twins : bool
        True if the simulator's specimens are twins (:mod:`cutenv.agents.sim_to_real.specimen_twin`), which differ by
        what a record leaves open, too. That is then part of the noise.

    Raises
    ------
    ValueError
        If there are fewer than 6 specimens, or a specimen without two simulated cuts.

    Notes
    -----
    The margin of a measure is the largest of these: the effect of noise alone on a single cut (root mean square of
    the difference of two simulated ones: a rig whose typical cut lies within it cannot be distinguished), 1 % of the
    simulator's mean, the effect of a force sensor's zero that is off by its resolution of 0.05 N, a tenth of what the
    task tolerates (:mod:`cutenv.agents.sim_to_real.measures`); and, for the force over position, the effect of
    displacing a record by 0.3 mm against itself. Of twins, for a distance between two cuts of a specimen, that of two
    twins: a rig may be as far again.

    Several dozen measures are tested.  "agree" requires that every one of them is within its margin at 5 % (two
    one-sided tests): the probability of this verdict although one is beyond stays below 5 % without any correction
    (Berger 1982, intersection-union).  "differ" requires one that is beyond, and there chance has several dozen tries:
    Holm's correction keeps the probability of any false one below 5 %.
    """

    def __init__(
        self,
        rig: Sequence[ComparedCut],
        simulator: Sequence[Sequence[ComparedCut]],
        *,
        paired: bool = True,
        twins: bool = False,
    ) -> None:
        if len(rig) < FEWEST_SPECIMENS or len(simulator) < FEWEST_SPECIMENS or (paired and len(rig) != len(simulator)):
            raise ValueError(
                f"{len(rig)} specimens on the rig and {len(simulator)} in the simulator; give {FEWEST_SPECIMENS} or "
                "more of "
                "each" + ", and the same ones." * paired
            )
        if short := [place for place, cuts in enumerate(simulator) if len(cuts) < 2]:
            raise ValueError(f"specimen {short[0]} has fewer than 2 simulated cuts: noise cannot be estimated from it.")
        self.rig, self.simulator, self.paired = list(rig), [list(cuts) for cuts in simulator], paired
        self.twins = twins

    @functools.cached_property
    def findings(self) -> list[Finding]:
        """Every measure that can be compared, in the order of :data:`~cutenv.agents.sim_to_real.measures.MEASURES`."""
        found = [each for each in self._compared.values() if isinstance(each, Finding)]
        adjusted = holm([each.shift.p_beyond for each in found])
        return [dataclasses.replace(each, p_differ=p) for each, p in zip(found, adjusted, strict=True)]

    @property
    def not_compared(self) -> dict[str, str]:
        """Reasons why the other measures cannot be compared, by name."""
        return {name: each.reason for name, each in self._compared.items() if isinstance(each, Inconclusive)}

    @property
    def verdict(self) -> Verdict:
        """Result over all findings."""
        answers = {each.measure.name: each.answer for each in self.findings}
        differ = tuple(name for name, answer in answers.items() if answer == "differ")
        still = tuple(name for name, answer in answers.items() if answer == "undecided")
        needed = [each.shift.needed for each in self.findings if each.answer == "undecided"]
        enough = None if not needed or None in needed else max(each for each in needed if each is not None)
        return Verdict(
            answer="differ" if differ else "undecided" if still else "agree", differ=differ, open=still, needed=enough
        )

    @property
    def too_few(self) -> bool:
        """True if the specimens cannot make any measure's difference significant."""
        return self.paired and 2.0 * 0.5 ** len(self.rig) * len(self.findings) >= ALPHA

    @functools.cached_property
    def _compared(self) -> dict[str, Finding | Inconclusive]:
        measures = [each for each in measures_of(self.rig).values() if self.paired or not each.paired]
        return {each.name: self._pairs(each) if self.paired else self._samples(each) for each in measures}

    def _pairs(self, measure: Measure) -> Finding | Inconclusive:
        known: list[tuple[float, NDArray[np.float64]]] = []
        for cut, simulated in zip(self.rig, self.simulator, strict=True):
            own, theirs = measure.value(cut, simulated), _values(measure, simulated)
            if own is not None and len(theirs) >= 2:
                known.append((own, theirs))
        if len(known) < FEWEST_SPECIMENS:
            return Inconclusive(f"{len(known)} specimens have it on both sides, and {FEWEST_SPECIMENS} are needed")
        rig, simulator = np.array([own for own, _ in known]), np.array([theirs.mean() for _, theirs in known])
        noise, margin = _margin(measure, [theirs for _, theirs in known], self.simulator)
        if not (margin or rig.any()):
            return Inconclusive(_NOTHING)
        if self.twins and measure.paired:
            margin = max(margin, abs(float(simulator.mean())) * (not measure.share))
        differences = rig - simulator
        # Bonett & Price 2012: with one more of each kind, a share of 0 in a dozen is not certainty.
        counted = np.append(differences, [1.0, -1.0]) if measure.share else differences
        error = float(counted.std(ddof=1)) / math.sqrt(len(counted))
        mean = mean_shift(float(counted.mean()), error, len(counted) - 1, margin, len(known))
        return Finding(
            measure=measure,
            rig=float(rig.mean()),
            simulator=float(simulator.mean()),
            noise=noise,
            shift=mean if measure.share else signed_rank_shift(differences, margin),
            mean=mean,
        )

    def _samples(self, measure: Measure) -> Finding | Inconclusive:
        """Compare two samples that have no specimen in common."""
        rig = np.array([own for cut in self.rig if (own := measure.value(cut, [])) is not None])
        known = [theirs for cuts in self.simulator if len(theirs := _values(measure, cuts)) >= 2]
        if min(len(rig), len(known)) < FEWEST_SPECIMENS:
            return Inconclusive(f"{len(rig)} cuts of the rig and {len(known)} specimens of the simulator have it")
        simulator = np.array([theirs.mean() for theirs in known])
        noise, margin = _margin(measure, known, self.simulator)
        if not (margin or rig.any()):
            return Inconclusive(_NOTHING)
        counted = [np.append(each, [0.0, 1.0]) if measure.share else each for each in (rig, simulator)]
        parts = [float(each.var(ddof=1)) / len(each) for each in counted]
        square = sum(parts)
        spread = sum(part**2 / (len(each) - 1) for part, each in zip(parts, counted, strict=True))
        degrees = square**2 / spread if spread > 0.0 else float(len(rig))
        value = float(counted[0].mean() - counted[1].mean())
        shift = mean_shift(value, math.sqrt(square), degrees, margin, len(rig))
        return Finding(
            measure=measure, rig=float(rig.mean()), simulator=float(simulator.mean()), noise=noise, shift=shift,
            mean=shift,
        )  # fmt: skip


def _values(measure: Measure, cuts: Sequence[ComparedCut]) -> NDArray[np.float64]:
    """Return a measure of a specimen's simulated cuts, where defined."""
    found = [measure.value(cut, [other for other in cuts if other is not cut]) for cut in cuts]
    return np.array([value for value in found if value is not None])


def _margin(
    measure: Measure, simulated: Sequence[NDArray[np.float64]], cuts: Sequence[Sequence[ComparedCut]]
) -> tuple[float, float]:
    """Return noise's effect on a single cut, and the margin."""
    noise = math.sqrt(2.0 * float(np.mean([values.var(ddof=1) for values in simulated])))
    level = abs(float(np.mean([values.mean() for values in simulated])))
    relative = 0.0 if measure.share or measure.paired else RELATIVE * level
    harmless = [measure.harmless(each[0]) for each in cuts] if measure.harmless is not None else []
    known = [value for value in harmless if value is not None]
    return noise, max(noise, relative, measure.least_margin, float(np.mean(known)) if known else 0.0)
