"""Rows whose tolerance is the scatter of what they compare: two means, two standard deviations, two fitted lines.

Both sides are samples: a table's mean of a few cuts is known to its standard error and no better, nor is ours.  Two
samples of one population differ by more than is allowed here once in twenty rows, so that by chance some five of a
hundred rows miss; tolerances of so many per cent would hide that, or hide worse.  Cuts of one liver are correlated,
which both standard errors neglect: they are a little too small.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from scripts.validation.thesis.rows import Row

TWO_SIDED = 0.95  # share of pairs of samples of one population that shall agree

Array = NDArray[np.float64]


class Sample(NamedTuple):
    """Mean and population standard deviation (ddof = 0, as in the thesis) of n numbers, n perhaps an average."""

    mean: float
    sd: float
    n: float

    @classmethod
    def of(cls, values: Array) -> Sample:
        """Compute the sample statistics of numbers."""
        return cls(float(np.mean(values)), float(np.std(values)), len(values))

    @property
    def standard_error(self) -> float:
        """Standard error of the mean, by the unbiased variance."""
        return self.sd / math.sqrt(self.n - 1)

    @property
    def variance(self) -> float:
        """Unbiased variance."""
        return self.sd**2 * self.n / (self.n - 1)


def mean_row(what: str, reference: Sample, ours: Sample) -> Row:
    """Compare means: agree if they differ by less than two standard errors of their difference (Welch's t test)."""
    error = math.hypot(reference.standard_error, ours.standard_error)
    squares = (reference.standard_error**4 / (reference.n - 1)) + (ours.standard_error**4 / (ours.n - 1))
    allowed = _quantile(error**4 / squares) * error if error else 0.0
    return Row(
        what=f"{what}: mean",
        reference=f"{reference.mean:.1f}",
        ours=f"{ours.mean:.1f}",
        tolerance=f"{allowed:.1f}",
        agrees=bool(abs(ours.mean - reference.mean) <= allowed),
    )


def joint_row(what: str, references: Sequence[Sample], ours: Sequence[Sample]) -> Row:
    """Compare the means of all rows of a table together: agree if their sums differ by less than both errors explain.

    It finds what rows with wide tolerances hide one by one: that all of them err to one side.
    """
    sums = [sum(sample.mean for sample in samples) for samples in (references, ours)]
    error = math.hypot(*(sample.standard_error for sample in (*references, *ours)))
    allowed = _quantile(math.inf) * error / sums[0]
    ratio = sums[1] / sums[0]
    return Row(
        what=f"{what}: {len(ours)} means together, ours over the table's",
        reference="1.00",
        ours=f"{ratio:.2f}",
        tolerance=f"{allowed:.2f}",
        agrees=bool(abs(ratio - 1.0) <= allowed),
    )


def sd_row(what: str, reference: Sample, ours: Sample) -> Row:
    """Compare variances: agree if their ratio is one that two samples of a population show (F test)."""
    ratio = ours.variance / reference.variance
    degrees = (ours.n - 1, reference.n - 1)
    low, high = special.fdtri(*degrees, [(1 - TWO_SIDED) / 2, (1 + TWO_SIDED) / 2])
    return Row(
        what=f"{what}: SD",
        reference=f"{reference.sd:.1f}",
        ours=f"{ours.sd:.1f}",
        tolerance=f"{reference.sd * _as_sd(low, degrees):.1f} to {reference.sd * _as_sd(high, degrees):.1f}",
        agrees=bool(low <= ratio <= high),
    )


def _as_sd(variance_ratio: float, degrees: tuple[float, float]) -> float:
    """Return the ratio of population standard deviations; samples have one more number than degrees of freedom."""
    ours, reference = degrees
    return math.sqrt(variance_ratio * (ours / (ours + 1)) * ((reference + 1) / reference))


class Line(NamedTuple):
    """A line fitted by least squares; the errors are standard errors by the scatter of the n points about it."""

    slope: float
    slope_error: float
    intercept: float
    intercept_error: float
    n: int

    @classmethod
    def through(cls, x: Array, y: Array) -> Line:
        """Fit LEM = intercept + slope v, as in most of the thesis's equations."""
        fit = stats.linregress(x, y)
        return cls(fit.slope, fit.stderr, fit.intercept, fit.intercept_stderr, len(x))

    @classmethod
    def through_logarithms(cls, x: Array, y: Array) -> Line:
        """Fit LEM = intercept v^slope, as in equations 5.3 and 5.4."""
        fit = stats.linregress(np.log(x), np.log(y))
        coefficient = math.exp(fit.intercept)
        return cls(fit.slope, fit.stderr, coefficient, coefficient * fit.intercept_stderr, len(x))


def coefficient_rows(what: str, reference: Line, ours: Line, *, slope: str, intercept: str) -> list[Row]:
    """Compare coefficients in two rows: agree if they differ by less than both lines' scatter explains (t test)."""
    pairs = {
        slope: ((reference.slope, reference.slope_error), (ours.slope, ours.slope_error)),
        intercept: ((reference.intercept, reference.intercept_error), (ours.intercept, ours.intercept_error)),
    }
    rows = []
    for name, (theirs, mine) in pairs.items():
        allowed = _quantile(reference.n + ours.n - 4) * math.hypot(theirs[1], mine[1])
        rows.append(
            Row(
                what=f"{what}: {name}",
                reference=_with_interval(*theirs, reference.n - 2),
                ours=_with_interval(*mine, ours.n - 2),
                tolerance=f"{allowed:.3g}",
                agrees=bool(abs(mine[0] - theirs[0]) <= allowed),
            )
        )
    return rows


def _with_interval(value: float, error: float, degrees: int) -> str:
    half = _quantile(degrees) * error
    return f"{value:.2f} [{value - half:.2f}, {value + half:.2f}]"


def _quantile(degrees: float) -> float:
    return float(special.stdtrit(degrees, (1 + TWO_SIDED) / 2))
