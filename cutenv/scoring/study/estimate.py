"""A number with its interval, and the checks that every statistic of a study makes at its door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv.validation import array_in_range

Array = NDArray[np.float64]

CONFIDENCE = 0.95
"""Of every interval, unless another is asked for."""
FEWEST = 3
"""People (rows, groups) below which nothing is said about people."""
_LARGEST = 1e12
_NO_VARIATION = 1e-12  # of the largest value: less than that is rounding


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value and the ends of its interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


def series_of(name: str, series: Sequence[ArrayLike], *, fewest: int, people: int = FEWEST) -> tuple[Array, ...]:
    """One array for each person, checked: ``people`` or more, each with ``fewest`` finite values or more.

    Raises
    ------
    TypeError, ValueError
        Naming the person by place, the value and the cure.
    """
    columns = tuple(array_in_range(f"{name}[{i}]", each, -_LARGEST, _LARGEST, "1") for i, each in enumerate(series))
    if len(columns) < people:
        raise ValueError(f"{name} has {len(columns)} rows; give {people} or more: fewer say nothing about people.")
    for i, column in enumerate(columns):
        if column.ndim != 1 or len(column) < fewest:
            raise ValueError(f"{name}[{i}] has shape {column.shape}; give {fewest} values or more, shape (n,).")
    return columns


def values_of(name: str, values: ArrayLike, *, fewest: int) -> Array:
    """A checked array of finite values, shape (n,), n at least ``fewest``.

    Raises
    ------
    TypeError, ValueError
        Naming the field, the value and the cure.
    """
    array = array_in_range(name, values, -_LARGEST, _LARGEST, "1")
    if array.ndim != 1 or len(array) < fewest:
        raise ValueError(f"{name} has shape {array.shape}; give {fewest} values or more, shape (n,).")
    return array


def vanishes(square: float, values: Array) -> bool:
    """Whether a mean square is nothing but rounding, beside the values that it is of."""
    return square <= (_NO_VARIATION * float(np.abs(values).max())) ** 2
