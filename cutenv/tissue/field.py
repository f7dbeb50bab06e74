"""Smooth random fields along the cut line: squared-exponential correlation, by Karhunen-Loeve expansion."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_NEGLIGIBLE = 1e-9  # variance of a mode, relative to the largest, below which it is left out


@lru_cache(maxsize=16)
def field_modes(n_points: int, spacing: float, correlation_length: float) -> NDArray[np.float64]:
    """Modes, shape (n_modes, n_points): z @ modes is a unit Gaussian field if z is standard normal.

    The covariance is exp(-d^2 / (2 correlation_length^2)); computed once, so that a draw is one small product.
    """
    y = np.arange(n_points) * spacing
    covariance = np.exp(-0.5 * ((y[:, None] - y[None, :]) / correlation_length) ** 2)
    variance, shape = np.linalg.eigh(covariance)
    kept = variance > _NEGLIGIBLE * variance[-1]
    modes = np.ascontiguousarray((shape[:, kept] * np.sqrt(variance[kept])).T)
    modes.setflags(write=False)
    return modes


def lognormal_sigma(cv: float) -> float:
    """Standard deviation of the logarithm of a lognormal number with coefficient of variation ``cv``."""
    return float(np.sqrt(np.log1p(cv**2)))
