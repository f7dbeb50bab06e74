"""Grid of points along the cut line at which a specimen is described."""

from __future__ import annotations

from typing import overload

import numpy as np

from cutenv._base.arrays import Array

LENGTH = 0.15
"""Length of a specimen [m]."""

# Linear interpolation between points errs by less than 0.1 % of K at the shortest admitted correlation length (15 mm),
# and a specimen's profile fits into 7 kB, inside a first-level cache.
SPACING = 0.5e-3
"""Distance between the points of a specimen's profiles [m]."""

POINTS_PER_METRE = 1.0 / SPACING
N_POINTS = round(LENGTH / SPACING) + 1


@overload
def depth_below(depth: Array, position: float) -> float: ...
@overload
def depth_below(depth: Array, position: Array) -> Array: ...
def depth_below(depth: Array, position: float | Array) -> float | Array:
    """Return the depth of cut [m] at positions from the clamp [m], of their shape; `depth` is given every 0.5 mm."""
    return np.interp(position, np.arange(len(depth)) * SPACING, depth)
