"""The natural bulge of a liver: depth of cut along the line, thin at the clamp, a thick crown, thin again."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.validation import in_range

_SHARPNESS = 6.0  # n below: sharpness of the transition from rise to crown; infinity is a kink
_FALL = 0.01  # length of the fall at the free end [m]: not even the blade reaches it


def bulge(y: ArrayLike, *, edge: float, crown: float, rise_length: float, length: float) -> NDArray[np.float64]:
    """Return the depth of cut B [m] at distances ``y`` [m] from the clamp, any shape.

    A straight rise from the edge, saturating at the crown, and a short fall toward the free end::

        1 / B^n = 1 / crown^n + 1 / rise(y)^n + 1 / fall(length - y)^n

    with n = 6, rise(y) = edge + (crown - edge) y / rise_length, and fall likewise over 1 cm.  With this profile the
    stiffness changes slowly over the length by which the blade leads the tip: a crack that runs into ever stiffer
    tissue would have no energy to go on.

    Parameters
    ----------
    edge, crown, rise_length, length : float
        Depth at the clamp and at the crown, length over which it grows from the one to the other, specimen length [m].
    """
    in_range("edge", edge, 1e-4, 0.05, "m", "The measured range of depth is 0.001 to 0.02 m.")
    in_range("crown", crown, edge, 0.1, "m", "The crown is no thinner than the edge.")
    in_range("rise_length", rise_length, 1e-3, 1.0, "m")
    y = np.asarray(y, dtype=np.float64)
    slope = crown - edge
    sides = (edge + slope * y / rise_length, edge + slope * np.maximum(length - y, 0.0) / _FALL)
    total = 1.0 + sum((crown / side) ** _SHARPNESS for side in sides)
    return np.asarray(crown * total ** (-1.0 / _SHARPNESS))
