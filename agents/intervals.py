"""Interquartile means with stratified bootstrap intervals, after Agarwal et al. 2021 (their library: rliable).

*Deep Reinforcement Learning at the Edge of the Statistical Precipice*, NeurIPS 2021.  A score of an agent is an array
of shape (training runs, specimens) for each stratum, a class of specimens.  A resample draws training runs and, crossed
with them, specimens, both with replacement and within each stratum; a script has one run.  The interquartile mean is
that of the middle half of all cuts: outliers do not move it, and it wavers less than the median.  With three runs an
interval of runs is narrow by chance at times; that is said where intervals are shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

_TRIM = 0.25  # from either end
_TOGETHER = 100  # resamples at a time: what they need of memory


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float

    def holds(self, number: float) -> bool:
        """Whether a number lies within."""
        return self.low <= number <= self.high

    def meets(self, other: Interval) -> bool:
        """Whether two intervals have a number in common."""
        return self.low <= other.high and other.low <= self.high


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean of the middle half along the last axis; a quarter of the count, rounded down, is cut off at either end."""
    count = values.shape[-1]
    cut = int(_TRIM * count)
    if cut == 0:
        return values.mean(axis=-1)
    return np.partition(values, (cut, count - cut - 1), axis=-1)[..., cut : count - cut].mean(axis=-1)


def mean(values: np.ndarray) -> np.ndarray:
    """Mean along the last axis, as :func:`interquartile_mean` is called; for shares, whose middle half tells little."""
    return values.mean(axis=-1)


def stratified(
    strata: Sequence[np.ndarray],
    statistic: Callable[[np.ndarray], np.ndarray] = interquartile_mean,
    *,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """The statistic of all strata together, with its 95 % percentile interval.

    Parameters
    ----------
    strata : sequence of array, shape (training runs, specimens) each
        Finite numbers.
    statistic : callable
        Along the last axis: :func:`interquartile_mean` or :func:`mean`.
    resamples : int
        How many.
    seed : int
        Of the resampling; equal shapes are resampled equally.

    Raises
    ------
    ValueError
        For no strata, a stratum without two axes or without members, and for a NaN.
    """
    if not strata:
        raise ValueError("strata is empty; give the scores of one class of specimens at least.")
    for number, values in enumerate(strata):
        if values.ndim != 2 or not values.size or not np.isfinite(values).all():
            raise ValueError(
                f"strata[{number}] has shape {values.shape} and {np.isnan(values).sum()} NaN; give finite numbers, "
                "shape (training runs, specimens)."
            )
    rng = np.random.default_rng(seed)
    found = []
    for first in range(0, resamples, _TOGETHER):
        count = min(_TOGETHER, resamples - first)
        drawn = []
        for values in strata:
            runs, specimens = (rng.integers(size, size=(count, size)) for size in values.shape)
            drawn.append(values[runs[:, :, None], specimens[:, None, :]].reshape(count, -1))
        found.append(statistic(np.concatenate(drawn, axis=1)))
    low, high = np.percentile(np.concatenate(found), (2.5, 97.5))
    whole = np.concatenate([values.ravel() for values in strata])
    return Interval(float(statistic(whole)), float(low), float(high))
