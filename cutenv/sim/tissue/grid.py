"""Grid of points along the cut line: depth of cut and random fields."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv._engine.elementary import exp, log

LENGTH = 0.15  # length of a specimen [m]

# Linear interpolation between points errs by less than 0.1 % of K at the shortest admitted correlation length (15 mm),
# and a specimen's profile fits into 7 kB, inside a first-level cache.
SPACING = 0.5e-3  # distance between the points of a specimen's profiles [m]

POINTS_PER_METRE = 1.0 / SPACING
N_POINTS = round(LENGTH / SPACING) + 1


@overload
def depth_below(depth: Array, position: float) -> float: ...
@overload
def depth_below(depth: Array, position: Array) -> Array: ...
def depth_below(depth: Array, position: float | Array) -> float | Array:
    """Return depth of cut [m] at positions [m], from 0.5 mm steps."""
    return np.interp(position, np.arange(len(depth)) * SPACING, depth)


_SHARPNESS = 6.0  # n below: sharpness of the transition from rise to crown; infinity is a kink
_FALL = 0.01  # length of the fall at the free end [m]: not even the blade reaches it


def bulge(y: ArrayLike, *, edge: float, crown: float, rise_length: float, length: float) -> Array:
    """Return depth of cut B [m] at ``y`` [m] from the clamp.

    A straight rise from the edge, saturating at the crown, and a short fall toward the free end::

        1 / B^n = 1 / crown^n + 1 / rise(y)^n + 1 / fall(length - y)^n

    with n = 6, rise(y) = edge + (crown - edge) y / rise_length, and fall likewise over 1 cm; all lengths in [m].  With
    this profile the stiffness changes slowly over the length by which the blade leads the tip: a crack that runs into
    ever stiffer tissue would have no energy to go on.
    """
    in_range("edge", edge, 1e-4, 0.05, "m", "The measured range of depth is 0.001 to 0.02 m.")
    in_range("crown", crown, edge, 0.1, "m", "The crown is no thinner than the edge.")
    in_range("rise_length", rise_length, 1e-3, 1.0, "m")
    y = np.asarray(y, dtype=np.float64)
    slope = crown - edge
    sides = (edge + slope * y / rise_length, edge + slope * np.maximum(length - y, 0.0) / _FALL)
    total = 1.0 + sum((crown / side) ** _SHARPNESS for side in sides)
    return np.asarray(crown * total ** (-1.0 / _SHARPNESS))


_KNOTS = 2  # per correlation length: the covariance is then accurate to 3e-9 (Poisson summation over the knots)
_REACH = 4  # correlation lengths beyond which a knot's weight is below 2e-7


@lru_cache(maxsize=16)
def field_modes(n_points: int, spacing: float, correlation_length: float) -> Array:
    """Return a Gaussian field's modes, (n_modes, n_points), of unit variance.

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
    """Return sigma of a lognormal number with coefficient of variation ``cv``."""
    return math.sqrt(log(1.0 + cv * cv))
