"""Smooth random fields along the cut line: squared-exponential correlation, as a moving average of white noise."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from cutenv._base.arrays import Array
from cutenv._engine.elementary import exp, log

_KNOTS = 2  # per correlation length: the covariance is then accurate to 3e-9 (Poisson summation over the knots)
_REACH = 4  # correlation lengths beyond which a knot's weight is below 2e-7


@lru_cache(maxsize=16)
def field_modes(n_points: int, spacing: float, correlation_length: float) -> Array:
    """Return the modes of a Gaussian field, shape (n_modes, n_points): z @ modes has unit variance for normal z.

    The covariance is exp(-d^2 / (2 correlation_length^2)).  Each mode is the weight exp(-d^2 / correlation_length^2) of
    one number of white noise, every half correlation length; cached, so that sampling is one small product.
    """
    knot = correlation_length / _KNOTS
    first = -_REACH * _KNOTS
    last = math.ceil((n_points - 1) * spacing / knot) + _REACH * _KNOTS
    modes = np.array(
        [
            [exp(-(((i * spacing - k * knot) / correlation_length) ** 2)) for i in range(n_points)]
            for k in range(first, last + 1)
        ]
    )
    variance = np.zeros(n_points)
    for mode in modes:  # summed in order, so that every machine gets the same result
        variance += mode**2
    modes /= np.sqrt(variance)
    modes.setflags(write=False)
    return modes


def lognormal_sigma(cv: float) -> float:
    """Return the standard deviation of the logarithm of a lognormal number with coefficient of variation ``cv``."""
    return math.sqrt(log(1.0 + cv * cv))
