"""Crossover: everybody cuts under two conditions, half in either order."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.scoring.study.estimate import CONFIDENCE, FEWEST_PEOPLE, Estimate, values_of
from cutenv.records.scoring.study.study import NotEstimable, Study, if_estimable

FEWEST_IN_AN_ORDER = 2
"""Smallest number of people in each order, for a difference that is free of the change from first to second."""
_OVERALL = "overall_score"


@dataclass(frozen=True, kw_only=True)
class Crossover:
    """Within-person difference between two conditions, and change over time.

    Attributes
    ----------
    difference : Estimate
        Difference between the conditions, the mean of both orders. With one order alone, the plain paired difference.
    order : Estimate or None
        Change from a person's first half to the second, whatever the conditions: learning, fatigue and other specimens.
        None if all had the same order: then it is part of the difference, and nobody can tell them apart.
    carry_over : Estimate or None
        Difference between the orders in the mean of both halves: what the first condition leaves behind, or people who
        differ. Few people do not show it, and it should not decide which analysis is made.
    people : tuple of int
        Number of people who began with the first condition, and with the second.
    """

    conditions: tuple[str, str]
    difference: Estimate
    order: Estimate | None
    carry_over: Estimate | None
    people: tuple[int, int]


def crossover(values: Mapping[str, Sequence[tuple[str, float]]], *, confidence: float = CONFIDENCE) -> Crossover:
    """Compare two conditions within people.

    Parameters
    ----------
    values : mapping of str to sequence of (str, float)
        Condition and value of each of a person's cuts, in the order in which they were made; by person. Who cut under
        one condition only is left out.

    Raises
    ------
    TypeError, ValueError
        If there are not two conditions, somebody cut them in turns, or fewer than 3 people cut both.

    Notes
    -----
    Each person is one value per condition, the mean of the cuts. Hills & Armitage, British Journal of Clinical
    Pharmacology 8 (1979) 7-20: half the difference between the orders' mean differences is that of the conditions, half
    their sum that of the halves; Student's t with the variance pooled over the orders.
    """
    level = in_range("confidence", confidence, 0.5, 0.999, "1")
    conditions = sorted({condition for cuts in values.values() for condition, _ in cuts})
    if len(conditions) != 2:
        raise ValueError(f"a crossover has two conditions; here are {len(conditions)}: {', '.join(conditions)}.")
    first, second = conditions
    halves: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for person, cuts in values.items():
        order = [condition for condition, _ in cuts]
        if set(order) != {first, second}:
            continue
        if sum(a != b for a, b in pairwise(order)) > 1:
            raise ValueError(
                f"{person} cut {first!r} and {second!r} in turns. A crossover has one after the other: order the cuts "
                "by when they were made."
            )
        means = [
            float(values_of(person, [value for condition, value in cuts if condition == each], fewest=1).mean())
            for each in conditions
        ]
        halves[order[0] == first].append((means[0], means[1]))
    people = len(halves[True]), len(halves[False])
    if sum(people) < FEWEST_PEOPLE:
        raise ValueError(f"{sum(people)} people cut under both conditions; give {FEWEST_PEOPLE} or more.")
    ahead, behind = (np.reshape(halves[key], (-1, 2)) for key in (True, False))
    differences = ahead[:, 0] - ahead[:, 1], behind[:, 0] - behind[:, 1]
    named = (first, second)
    if min(people) < FEWEST_IN_AN_ORDER:
        paired = _contrast([np.concatenate(differences)], [1.0], level)
        return Crossover(conditions=named, difference=paired, order=None, carry_over=None, people=people)
    means_of_both = ahead.mean(axis=1), behind.mean(axis=1)
    return Crossover(
        conditions=named,
        difference=_contrast(differences, [0.5, 0.5], level),
        order=_contrast(differences, [-0.5, 0.5], level),
        carry_over=_contrast(means_of_both, [1.0, -1.0], level),
        people=people,
    )


def condition_of(metadata: Mapping[str, object]) -> str:
    """Return a record's crossover condition, "" for other records.

    A cut that was given up has none: the course has it repeated.
    """
    counts = metadata.get("crossover") is True and metadata.get("end") != "given up"
    return str(metadata.get("feedback", "")) if counts else ""


def crossovers(study: Study) -> dict[str, Crossover | NotEstimable]:
    """Return crossovers of score and metrics, {} without conditions."""
    cuts = [cut for cut in study.cuts if cut.condition]
    if not cuts:
        return {}
    found: dict[str, Crossover | NotEstimable] = {}
    for metric in dict.fromkeys((_OVERALL, *(each.metric for each in study.findings))):
        series: dict[str, list[tuple[str, float]]] = {}
        for cut in cuts:
            value = cut.card.overall_score if metric == _OVERALL else cut.card.metrics[metric].value
            if value is not None:
                series.setdefault(cut.operator, []).append((cut.condition, value))
        found[metric] = if_estimable(crossover, series)
    return found


def _contrast(samples: Sequence[Array], weights: Sequence[float], level: float) -> Estimate:
    """Return a weighted sum of means, with pooled-variance interval."""
    degrees = sum(len(sample) - 1 for sample in samples)
    pooled = sum(float(((sample - sample.mean()) ** 2).sum()) for sample in samples) / degrees
    value = float(sum(w * sample.mean() for w, sample in zip(weights, samples, strict=True)))
    error = math.sqrt(pooled * sum(w * w / len(sample) for w, sample in zip(weights, samples, strict=True)))
    reach = float(student.ppf(0.5 * (1.0 + level), degrees)) * error
    return Estimate(value=value, low=value - reach, high=value + reach)
