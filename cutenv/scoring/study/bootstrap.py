"""Estimates with intervals by a bootstrap over people: a person is drawn with all cuts, because they are alike."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv.scoring.study.estimate import CONFIDENCE, Estimate

FEWEST_FOR_AN_INTERVAL = 5
"""Smallest number of people with an interval; with fewer that of the experts' mean held the truth too rarely."""
BOOTSTRAP_SIZE = 4000
"""Number of times that the people are drawn again."""
_MENTIONED = 0.05  # share of resamples without a value from which it is mentioned
_TOO_MANY = 0.5  # share of resamples without a value from which there is no interval


def over_people(value: float, replicates: Array, people: int) -> Estimate:
    """Return a value with its interval from the values of the resamples.

    Parameters
    ----------
    value : float
        Value of the people themselves.
    replicates : ndarray of shape (n,)
        Values of the resamples; NaN where a resample has none.
    people : int
        Number of people; of two groups, that of the smaller one.

    Returns
    -------
    Estimate

    Notes
    -----
    Expanded percentile interval of Hesterberg, The American Statistician 69 (2015) 371-386, section 5.3, doi
    10.1080/00031305.2015.1089789: the plain percentiles are too narrow for few people, so the tails are moved out by
    Student's t and by sqrt(n/(n - 1)). How often it holds the truth is printed by ``scripts/pass_mark_coverage.py``.
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
