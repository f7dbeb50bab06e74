"""Learning curves, CUSUM charts, and advice on next steps.

Curves are over the number of the cut; charts show when a person reaches a target. Advice is on the parts of the score
that cost most lately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.scoring.score_card import ScoreCard
from cutenv.records.scoring.study.estimate import CONFIDENCE, FEWEST_COMPARED, FEWEST_PEOPLE, series_of, values_of
from cutenv.records.scoring.technique import HOLD_BACK, KEEP_DEPTH, LEAD_OUTSIDE

FEWEST_IN_CURVE = 4
"""Smallest number of people for an interval of a learning curve: with fewer it is wider than the scale."""
SLACK, THRESHOLD = 0.5, 4.0  # defaults of :func:`cusum`, in standard deviations of single cuts


@dataclass(frozen=True, kw_only=True, eq=False)
class Cusum:
    """CUSUM chart of one person, in standard deviations, shape (n,).

    Attributes
    ----------
    total : ndarray
        Plain cumulative sum of the deviations from the target; it falls while cuts lie below.
    reaching : ndarray
        Learning curve CUSUM: starts at 0, assumes that the person is beyond the target, and grows while cuts are not.
    leaving : ndarray
        Page's CUSUM: grows while cuts lie beyond the target by more than the slack.
    threshold : float
        Limit at which either sum signals.
    """

    total: Array
    reaching: Array
    leaving: Array
    threshold: float

    @property
    def reached_at(self) -> int | None:
        """Number, from 1, of the cut reaching the target, or None."""
        return _first(self.reaching > self.threshold)

    @property
    def left_at(self) -> int | None:
        """Number, from 1, of the cut leaving the target, or None."""
        return _first(self.leaving > self.threshold)


@dataclass(frozen=True, kw_only=True, eq=False)
class LearningCurve:
    """Metric by number of the cut, over people.

    Every array of shape (n,).

    Attributes
    ----------
    mean, low, high : ndarray
        Mean over these people, and interval by Student's t; no interval (None) of fewer than four people.
    change, change_low, change_high : ndarray
        Paired change from each person's own first cut; 0 at the first.
    """

    number: NDArray[np.int_]
    people: NDArray[np.int_]
    mean: Array
    low: Array | None
    high: Array | None
    change: Array
    change_low: Array | None
    change_high: Array | None


def cusum(
    values: ArrayLike, target: float, scale: float, *, slack: float = SLACK, threshold: float = THRESHOLD, sign: int = 1
) -> Cusum:
    """Compute cumulative sums of deviations from a target.

    Parameters
    ----------
    values : array_like of shape (n,)
        Values of one person's cuts in order; n is 2 or more.
    target : float
        The level that a learner is to reach; in the unit of the values.
    scale : float
        Standard deviation of single cuts of one person, above 0; in the unit of the values.
    slack : float
        Half the distance, in standard deviations, between the target and the level to be detected; 0.05 to 3.
    threshold : float
        Limit at which a sum signals, in standard deviations, 1 to 20.
    sign : {1, -1}
        1 if small values are good ("beyond" is above the target), -1 if large ones are.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range.

    Notes
    -----
    With z = sign (value - target)/scale and slack k: ``leaving`` is Page's max(0, C + z - k) in the tabular form of
    Montgomery, Introduction to Statistical Quality Control, section 9.1 (equation 9.2). ``reaching`` is the
    learning curve CUSUM max(0, C - z + k): the person is taken to be at the target + 2k until the sum passes the
    threshold (Biau & Porcher, Statistics in Medicine 29 (2010) 1900-1909, doi 10.1002/sim.3947, one-sided). Sums are
    not reset after a signal. With the defaults a person at the target is detected after 8.4 cuts on average, and one
    who stays one standard deviation beyond it after 335 (average run lengths, for independent normal values).
    """
    column = values_of("values", values, fewest=2)
    at = in_range("target", target, -1e12, 1e12, "1")
    spread = in_range("scale", scale, 1e-12, 1e12, "1", "Give the standard deviation of one person's cuts.")
    k = in_range("slack", slack, 0.05, 3.0, "1", "In standard deviations; 0.5 is usual.")
    h = in_range("threshold", threshold, 1.0, 20.0, "1", "In standard deviations; 4 or 5 is usual.")
    if sign not in (1, -1):
        raise ValueError(f"sign must be 1 (small values are good) or -1, got {sign!r}.")
    z = sign * (column - at) / spread
    return Cusum(total=np.cumsum(z), reaching=_summed(-z + k), leaving=_summed(z - k), threshold=h)


def learning_curve(series: Sequence[ArrayLike], *, confidence: float = CONFIDENCE) -> LearningCurve:
    """Compute means over people by cut number, and paired changes.

    Parameters
    ----------
    series : sequence of array_like
        The values of each person's cuts in their order: 2 people or more, 2 cuts each or more. People may differ in
        number of cuts; the curve ends where fewer than 3 are left, of 2 people with the first who ends.

    Raises
    ------
    TypeError, ValueError
        If there are too few people or cuts.
    """
    columns = series_of("series", series, fewest=2, people=FEWEST_COMPARED)
    level = in_range("confidence", confidence, 0.5, 0.999, "1")
    people = min(len(columns), FEWEST_PEOPLE)
    last = sorted((len(column) for column in columns), reverse=True)[people - 1]
    rows = []
    for i in range(last):
        here = [column for column in columns if len(column) > i]
        values = np.array([column[i] for column in here])
        change = values - np.array([column[0] for column in here])
        rows.append((i + 1, len(here), *_interval(values, level), *_interval(change, level)))
    number, there, mean, low, high, change, change_low, change_high = np.array(rows).T
    enough = len(columns) >= FEWEST_IN_CURVE
    return LearningCurve(
        number=number.astype(int),
        people=there.astype(int),
        mean=mean,
        low=low if enough else None,
        high=high if enough else None,
        change=change,
        change_low=change_low if enough else None,
        change_high=change_high if enough else None,
    )


def _interval(values: Array, level: float) -> tuple[float, float, float]:
    half = float(student.ppf(0.5 * (1.0 + level), len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))
    mean = float(values.mean())
    return mean, mean - half, mean + half


def _summed(steps: Array) -> Array:
    """Return cumulative sums that are limited below at 0."""
    sums = np.zeros(len(steps))
    level = 0.0
    for i, step in enumerate(steps):
        level = max(0.0, level + float(step))
        sums[i] = level
    return sums


def _first(signals: NDArray[np.bool_]) -> int | None:
    found = np.flatnonzero(signals)
    return int(found[0]) + 1 if len(found) else None


RECENT = 3  # number of last cuts by which advice is given
_MAX_ADVICE = 3  # pieces of advice
_LITTLE = 0.1  # fraction of a part's points whose loss needs no advice
_CAUSES = {
    "target": (("limits", "way", "accuracy", "success"), ("short", "overshoot", "wedge", "force")),
    "control": (("control",), ("haste",)),
    "tissue": (("tissue",), ("lurch", "force")),
    "time": (("time",), ("pause",)),
    "depth": (("depth",), ("layer",)),
    "path": (("path",), ("line",)),
}
"""Parts of the score that go together, and the kinds of faults that cost their points."""
_ADVICE = {
    "target": "at the target, set the blade upright and draw back until nothing pulls: while you feel a pull, the cut "
    "ends behind the blade",
    "control": HOLD_BACK,
    "tissue": "advance more slowly and lean the blade: it presses less, and the tissue tears on less far",
    "time": "advance faster where the tissue hardly resists, and do not rest",
    "depth": KEEP_DEPTH,
    "path": LEAD_OUTSIDE,
}
_STEADY = "keep the pull steady: advance evenly, without jerks"
"""Advice for a record of force alone, whose parts are metrics of steadiness."""


@dataclass(frozen=True, kw_only=True)
class NextTry:
    """One thing to try next."""

    part: str  # part of the overall score that costs points, or "target" for those that the target gives
    points: float  # mean points of the last cuts, and points of the best cut
    most: float
    seen: str  # what was seen, in the last cut with that fault; "" if no single fault explains the loss
    cuts: int  # number of the last cuts in which it was seen
    advice: str


def mean_points(cards: Sequence[ScoreCard]) -> dict[str, tuple[float, float]]:
    """Return mean and maximum points by part, over scored cuts."""
    scored = [card for card in cards if card.overall_score is not None]
    most = {each.part: each.most for card in scored for each in card.points}
    return {
        part: (sum(each.points for card in scored for each in card.points if each.part == part) / len(scored), best)
        for part, best in most.items()
    }


def next_tries(cards: Sequence[ScoreCard]) -> tuple[NextTry, ...]:
    """Return up to three pieces of advice on the costliest parts of last cuts.

    The cards are of one person's cuts, in their order.
    """
    last = [card for card in cards if card.overall_score is not None][-RECENT:]
    by_part = mean_points(last)
    groups = {name: [by_part.pop(part) for part in parts if part in by_part] for name, (parts, _) in _CAUSES.items()}
    groups |= {part: [points] for part, points in by_part.items()}
    sums = [(name, sum(p for p, _ in own), sum(most for _, most in own)) for name, own in groups.items() if own]
    tries: list[NextTry] = []
    for name, points, most in sorted(sums, key=lambda row: row[1] - row[2]):
        if most - points < _LITTLE * most or len(tries) == _MAX_ADVICE:
            continue
        kinds = _CAUSES[name][1] if name in _CAUSES else ()
        faults = [(k, fault) for k, card in enumerate(last) for fault in card.faults if fault.kind in kinds]
        seen, cuts, advice = "", 0, _ADVICE.get(name, _STEADY)
        if faults:
            latest = faults[-1][1]
            cuts = len({k for k, fault in faults if fault.kind == latest.kind})
            seen, advice = latest.says, latest.try_next
        if advice not in {each.advice for each in tries}:
            tries.append(NextTry(part=name, points=points, most=most, seen=seen, cuts=cuts, advice=advice))
    return tuple(tries)


def outcome_counts(cards: Sequence[ScoreCard]) -> dict[str, int]:
    """Return counts of outcomes, empty if none is known."""
    known = [card for card in cards if card.outcome]
    success = sum(card.outcome.startswith("success") for card in known)
    beyond = sum(each.part == "limits" and each.points == 0.0 for card in known for each in card.points)
    return {"success": success, "missed": len(known) - success - beyond, "beyond a limit": beyond} if known else {}
