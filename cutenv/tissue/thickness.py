"""The natural bulge: depth of cut along the line, from a thin edge at the clamp to a thick crown and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from cutenv.validation import in_range

_SHARPNESS = 6.0  # n below: how suddenly the rise ends in the crown; 1 is logistic, infinity a kink
_FALL = 0.4  # length of the fall at the free end over that of the rise: a cut does not reach it


def bulge(y: ArrayLike, *, edge: float, crown: float, rise_length: float, length: float) -> NDArray[np.float64]:
    """Depth of cut B [m] at distances ``y`` [m] from the clamp, any shape.

    Exponential rise from the edge (so that dB/dy / B never exceeds 1/rise_length, which keeps the lag of the tip short
    against the change of stiffness), saturating at the crown, and a shorter fall toward the free end::

        (crown / B)^n = 1 + q (exp(-n y / rise) + exp(-n (length - y) / fall)),   q = (crown / edge)^n - 1

    Parameters
    ----------
    edge, crown, rise_length, length : float
        Depth at the clamp and at the crown, length over which a thin edge grows by a factor e, specimen length [m].
    """
    in_range("edge", edge, 1e-4, 0.05, "m", "The measured range of depth is 0.001 to 0.02 m.")
    in_range("crown", crown, edge, 0.1, "m", "The crown is no thinner than the edge.")
    in_range("rise_length", rise_length, 1e-4, 1.0, "m")
    n = _SHARPNESS
    y = np.asarray(y, dtype=np.float64)
    q = (crown / edge) ** n - 1.0
    tails = np.exp(-n * y / rise_length) + np.exp(-n * (length - y) / (_FALL * rise_length))
    return np.asarray(crown * (1.0 + q * tails) ** (-1.0 / n))


def rise_length_for(
    mean_depth: float, *, edge: float, crown: float, length: float, between: tuple[float, float]
) -> float:
    """The rise length [m] for which the mean of :func:`bulge` ``between`` two places [m] is ``mean_depth`` [m].

    Raises
    ------
    ValueError
        If no bulge between ``edge`` and ``crown`` has that mean.
    """
    y = np.linspace(*between, 481)  # even spacing, smooth integrand: the plain mean is the integral's

    def excess(rise: float) -> float:
        depth = bulge(y, edge=edge, crown=crown, rise_length=rise, length=length)
        return float(depth.mean() - mean_depth)

    low, high = 1e-3, 0.1
    if not excess(high) < 0.0 < excess(low):
        raise ValueError(
            f"mean_depth = {mean_depth:g} m cannot be had from a bulge of {edge:g} to {crown:g} m. "
            "Give a mean well inside that range."
        )
    return float(brentq(excess, low, high, xtol=1e-9))
