"""Scatter of a property: between pieces of tissue, between cuts of one piece, and along a cut (variogram)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cutenv._base.arrays import Array

LAGS = np.linspace(0.0, 0.08, 17)
"""Borders of the distance classes of the variogram [m]."""
SHORTEST_LENGTH, LONGEST_LENGTH = 0.005, 0.1
"""Range of the correlation lengths searched [m]: a unit hides shorter ones, a cut does not show longer ones."""
CENTRES = 0.5 * (LAGS[1:] + LAGS[:-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Variogram:
    """Variogram: half the mean squared difference of a logarithm between two positions of one cut, over their distance.

    Differences within a cut do not contain what the whole cut has in common, and do not depend on the length of the
    cut relative to the correlation length, unlike a standard deviation within the cut.

    Attributes
    ----------
    squares : ndarray of shape (n_cuts, n_lags)
        Sums of half the squared differences.
    pairs : ndarray of shape (n_cuts, n_lags)
        Number of pairs.
    """

    squares: Array
    pairs: Array

    @classmethod
    def of(
        cls, positions: Sequence[Array], values: Sequence[Array], errors: Sequence[Array] | None = None
    ) -> Variogram:
        """Compute it from ``values`` (positive) at ``positions`` [m] of each cut, less relative standard ``errors``."""
        errors = errors or [np.zeros(len(x)) for x in positions]
        squares, pairs = np.zeros((2, len(positions), len(CENTRES)))
        for n, (x, value, error) in enumerate(zip(positions, values, errors, strict=True)):
            i, j = np.triu_indices(len(x), 1)
            distance, difference = np.abs(x[i] - x[j]), np.diff(np.log(value)[[i, j]], axis=0)[0]
            noise = error[i] ** 2 + error[j] ** 2
            squares[n] = np.histogram(distance, LAGS, weights=0.5 * (difference**2 - noise))[0]
            pairs[n] = np.histogram(distance, LAGS)[0]
        return cls(squares=squares, pairs=pairs)

    def mean(self, counts: Array) -> tuple[Array, Array]:
        """Return the mean over cuts, each taken ``counts`` times, shape (n_lags,), 0 without pairs; and the pairs."""
        pairs = counts @ self.pairs
        return counts @ self.squares / np.maximum(pairs, 1.0), pairs


def fit_variances(variograms: Sequence[Variogram], counts: Array, length: float) -> tuple[Array, float]:
    """Fit each property's variance of the logarithm along a cut, for a given correlation length.

    gamma(d) = variance (1 - exp(-d^2 / (2 length^2))), as for sampled specimens; least squares, weighted with the
    number of pairs.

    Returns
    -------
    variances : ndarray of shape (n_properties,)
    misfit : float
        Weighted sum of squares, each property's relative to its own size.
    """
    shape = 1.0 - np.exp(-0.5 * (CENTRES / length) ** 2)
    variances, misfit = [], 0.0
    for variogram in variograms:
        gamma, pairs = variogram.mean(counts)
        total = float(pairs @ gamma**2)
        variance = float(pairs @ (gamma * shape)) / max(float(pairs @ shape**2), 1e-30)
        variances.append(variance)
        if total > 0.0:
            misfit += float(pairs @ (gamma - variance * shape) ** 2) / total
    return np.array(variances), misfit


def correlation_length(variograms: Sequence[Variogram], counts: Array) -> float:
    """Return the correlation length [m] with which :func:`fit_variances` fits best."""

    def misfit(log_length: float) -> float:
        return fit_variances(variograms, counts, math.exp(log_length))[1]

    grid = np.linspace(math.log(SHORTEST_LENGTH), math.log(LONGEST_LENGTH), 16)
    best = int(np.argmin([misfit(each) for each in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    return math.exp(float(minimize_scalar(misfit, bounds=around, method="bounded", options={"xatol": 1e-3}).x))


def cv_of(log_variance: float) -> float:
    """Return the coefficient of variation of a lognormal number from the variance of its logarithm; 0 if negative."""
    return math.sqrt(math.expm1(max(log_variance, 0.0)))


class Places:
    """Positions along several cuts [m], prepared for the variance of a field's mean over them."""

    def __init__(self, positions: Sequence[Array]) -> None:
        squares = [((x[:, None] - x[None, :]) ** 2).ravel() for x in positions]
        self._squares = np.concatenate([np.zeros(0), *squares])
        self._cut = np.repeat(np.arange(len(positions)), [len(each) for each in squares])
        self._pairs = np.array([max(len(each), 1) for each in squares])

    def mean_variances(self, variance: float, length: float) -> Array:
        """Return the variance of the mean of a field over each cut's positions, shape (n_cuts,); 0 without any."""
        correlation = np.exp(-0.5 * self._squares / length**2)
        return np.asarray(variance * np.bincount(self._cut, correlation, len(self._pairs)) / self._pairs)


def mean_field_variance(positions: Array, variance: float, length: float) -> float:
    """Return the variance of the mean of a field over ``positions`` [m] of one cut, part of that between cuts."""
    return float(Places([positions]).mean_variances(variance, length)[0])


def nested_variances(values: Array, groups: NDArray[np.intp], counts: Array) -> tuple[float, float]:
    """Estimate variances between and within groups by one-way random-effects analysis, groups of any size.

    Parameters
    ----------
    values : ndarray of shape (n,)
        One value for each cut.
    groups : ndarray of int of shape (n,)
        Index of each cut's piece of tissue.
    counts : ndarray of shape (n,)
        Number of times that each is taken (a bootstrap resample), otherwise 1.

    Returns
    -------
    between, within : float
        Unbiased, so ``between`` may be negative; NaN for lack of groups or of members.
    """
    sizes = np.bincount(groups, counts)
    present = sizes > 0
    sums = np.bincount(groups, counts * values)
    means = sums[present] / sizes[present]
    n, k = float(counts.sum()), int(present.sum())
    total = float(counts @ values**2)
    explained = float(sizes[present] @ means**2)
    within = (total - explained) / (n - k) if n > k else math.nan
    if k < 2 or not n > k:
        return math.nan, within
    mean_square = (explained - float(counts @ values) ** 2 / n) / (k - 1)
    typical = (n - float(sizes[present] @ sizes[present]) / n) / (k - 1)
    return (mean_square - within) / typical, within
