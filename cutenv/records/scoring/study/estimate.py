"""A value with its confidence interval, and input checks.

There is an interval if people are enough for one. The checks are those of a study's statistics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    T = TypeVar("T", bound=DataclassInstance)


CONFIDENCE = 0.95  # default level of confidence of every interval
FEWEST_PEOPLE = 3  # smallest number of people (rows) for an interval
FEWEST_COMPARED = 2  # smallest number of people (rows) for any statistics about people
FEWEST_RELIABLE = 5
"""Smallest number of people for a study's reliability.

Of two people who are equally good, with two cuts each, one pair in ten has a reliability above 0.8 by chance; of
five, one group in sixty.
"""
_MAX_VALUE = 1e12
_NO_VARIATION = 1e-12  # relative to the largest value: less is rounding


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Value with its confidence interval over people, if possible.

    Attributes
    ----------
    low, high : float or None
        Ends of the interval; None if there is none.
    note : str
        Reason why there is no interval, or a warning about it; "" if there is nothing to say.
    """

    value: float
    low: float | None = None
    high: float | None = None
    note: str = ""

    def __str__(self) -> str:
        interval = "" if self.low is None or self.high is None else f" [{self.low:.3g}, {self.high:.3g}]"
        return f"{self.value:.3g}{interval}"

    def excludes(self, value: float) -> bool:
        """Return True if the interval exists and excludes a value."""
        return self.low is not None and self.high is not None and not self.low <= value <= self.high


def without_intervals(found: T) -> T:
    """Return a result without its estimates' intervals."""
    values = {part.name: getattr(found, part.name) for part in fields(found)}
    return replace(found, **{name: Estimate(value=v.value) for name, v in values.items() if isinstance(v, Estimate)})


def series_of(name: str, series: Sequence[ArrayLike], *, fewest: int, people: int = FEWEST_PEOPLE) -> tuple[Array, ...]:
    """Return a checked array for each person.

    At least ``people`` are needed, each with at least ``fewest`` finite values.
    """
    columns = tuple(array_in_range(f"{name}[{i}]", each, -_MAX_VALUE, _MAX_VALUE, "1") for i, each in enumerate(series))
    if len(columns) < people:
        raise ValueError(f"{name} has {len(columns)} rows; give {people} or more: fewer are too few for statistics.")
    for i, column in enumerate(columns):
        if column.ndim != 1 or len(column) < fewest:
            raise ValueError(f"{name}[{i}] has shape {column.shape}; give {fewest} values or more, shape (n,).")
    return columns


def values_of(name: str, values: ArrayLike, *, fewest: int) -> Array:
    """Return at least ``fewest`` finite values as array, shape (n,)."""
    array = array_in_range(name, values, -_MAX_VALUE, _MAX_VALUE, "1")
    if array.ndim != 1 or len(array) < fewest:
        raise ValueError(f"{name} has shape {array.shape}; give {fewest} values or more, shape (n,).")
    return array


def vanishes(square: float, values: Array) -> bool:
    """Return True if a mean square is only rounding error."""
    return square <= (_NO_VARIATION * float(np.abs(values).max())) ** 2


FEWEST_FOR_AN_INTERVAL = 5
"""Smallest number of people with an interval; with fewer that of the experts' mean held the truth too rarely."""
BOOTSTRAP_SIZE = 4000  # number of times that the people are drawn again
_MENTIONED = 0.05  # share of resamples without a value from which it is mentioned
_TOO_MANY = 0.5  # share of resamples without a value from which there is no interval


def over_people(value: float, replicates: Array, people: int) -> Estimate:
    """Return a value with its interval from resamples.

    A resample without a value is NaN; `people` is their number, of two groups that of the smaller one.

    Expanded percentile interval of Hesterberg, The American Statistician 69 (2015) 371-386, section 5.3, doi
    10.1080/00031305.2015.1089789: the plain percentiles are too narrow for few people, so the tails are moved out by
    Student's t and by sqrt(n/(n - 1)). How often it holds the truth is printed by
    ``scripts/validation/scoring/pass_mark_coverage.py``.
    """
    if people < FEWEST_FOR_AN_INTERVAL:
        return Estimate(value=value, note=f"no interval: it takes {FEWEST_FOR_AN_INTERVAL} people, here {people}")
    known = replicates[np.isfinite(replicates)]
    without = 1.0 - len(known) / len(replicates)
    share = f"{100.0 * without:.0f} % of the resamples have no such value"
    if without > _TOO_MANY:
        return Estimate(value=value, note=f"no interval: {share}")
    note = f"uncertain interval: {share}" if without > _MENTIONED else ""
    reach = math.sqrt(people / (people - 1.0)) * float(student.ppf(0.5 * (1.0 + CONFIDENCE), people - 1))
    tail = float(norm.cdf(-reach))
    low, high = np.quantile(known, (tail, 1.0 - tail))
    # The value itself lies inside, also where rounding or few distinct resamples put an end beside it.
    return Estimate(value=value, low=min(float(low), value), high=max(float(high), value), note=note)
