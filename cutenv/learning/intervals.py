"""Interquartile means with stratified bootstrap intervals, after Agarwal et al. 2021 (their library: rliable).

*Deep Reinforcement Learning at the Edge of the Statistical Precipice*, NeurIPS 2021.  A score of an agent is an array
of shape (training runs, specimens) for each stratum, a class of specimens.  A resample draws training runs and, crossed
with them, specimens within each stratum, all with replacement; a script has one run.  Tasks in rliable have separate
runs; strata share theirs: a run is the same agent in all strata, and is drawn in all or in none.
The interquartile mean is that of the middle half of all cuts: robust against outliers, and less variable than the
median.  With three runs an interval over runs is sometimes too narrow by chance; this is stated where intervals are
shown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import trim_mean

_TOGETHER = 100  # resamples computed at a time, to limit memory


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Return the mean of the middle half along the last axis; a quarter, rounded down, is removed at either end."""
    middle: np.ndarray = trim_mean(values, 0.25, axis=-1)
    return middle


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float

    def holds(self, number: float) -> bool:
        """Return True if a number is within the interval."""
        return self.low <= number <= self.high

    def meets(self, other: Interval) -> bool:
        """Return True if two intervals overlap."""
        return self.low <= other.high and other.low <= self.high


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean along the last axis: a statistic for shares, whose middle half means little."""
    found: np.ndarray = values.mean(axis=-1)
    return found


def stratified(
    strata: Sequence[np.ndarray],
    statistic: Callable[[np.ndarray], np.ndarray] = interquartile_mean,
    *,
    same_specimens: bool = False,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """Compute the statistic of all strata together, with its 95 % percentile interval.

    Parameters
    ----------
    strata : sequence of array, shape (training runs, specimens) each
        Arrays of finite numbers; the rows of all strata are the same runs.
    statistic : callable
        Function along the last axis: :func:`interquartile_mean` or :func:`mean`.
    same_specimens : bool
        Whether the columns of all strata are paired too, as when one seed gives a specimen of each class.
    resamples : int
        Number of bootstrap resamples.
    seed : int
        Seed of the resampling; equal shapes are resampled equally.

    Raises
    ------
    ValueError
        For no strata, a stratum without two axes or without members, a NaN, and for strata of different runs or, with
        ``same_specimens``, different numbers of specimens.
    """
    if not strata:
        raise ValueError("strata is empty; give the scores of one class of specimens at least.")
    for number, values in enumerate(strata):
        if values.ndim != 2 or not values.size or not np.isfinite(values).all():
            raise ValueError(
                f"strata[{number}] has shape {values.shape} and {np.isnan(values).sum()} NaN; give finite numbers, "
                "shape (training runs, specimens)."
            )
    together = slice(None) if same_specimens else slice(1)
    if len({values.shape[together] for values in strata}) > 1:
        raise ValueError(
            f"strata have shapes {', '.join(str(values.shape) for values in strata)}; give the same training runs in "
            f"each{', and the same specimens' if same_specimens else ''}."
        )
    rng = np.random.default_rng(seed)
    found = []
    for first in range(0, resamples, _TOGETHER):
        count = min(_TOGETHER, resamples - first)
        runs, drawn = _draw(rng, count, strata[0].shape[0]), []
        specimens = _draw(rng, count, strata[0].shape[1])
        for number, values in enumerate(strata):
            if number and not same_specimens:
                specimens = _draw(rng, count, values.shape[1])
            drawn.append(values[runs[:, :, None], specimens[:, None, :]].reshape(count, -1))
        found.append(statistic(np.concatenate(drawn, axis=1)))
    low, high = np.percentile(np.concatenate(found), (2.5, 97.5))
    whole = np.concatenate([values.ravel() for values in strata])
    return Interval(float(statistic(whole)), float(low), float(high))


def _draw(rng: np.random.Generator, resamples: int, size: int) -> np.ndarray:
    """Return the members of each resample, drawn with replacement, shape (resamples, size)."""
    return rng.integers(size, size=(resamples, size))
