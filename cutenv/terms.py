"""What a reward charges and a score reports under the same name: one line of code for both.

In Python and inside compiled kernels; all but :func:`wedge` take floats or arrays.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cutenv.compiled import for_kernels
from cutenv.elementary import cotangent

Array = NDArray[np.float64]
T = TypeVar("T", float, Array)

TIP_TOLERANCE = 0.003
"""Tip error of a success, and scale of its cost [m]."""
ANGLE_TOLERANCE = math.radians(10.0)
"""From upright, of a success [rad]."""
FORCE_LIMIT_PER_DEPTH = 1000.0
"""Where a task ends for safety by default, and what a score calls too much [N/m]."""
SHALLOWEST = 0.001
"""Floor of the depth that a force is divided by, in reward, score and policies: the least that was measured [m]."""
MEASURABLE_DEPTH = 0.5 * SHALLOWEST
"""Least depth that a measured profile shows, and below which a measurement takes no force per depth [m]."""
SMALLEST_RUN = 0.3e-3
"""Advance of an estimated tip beyond the blade's own, below which it is noise and not an unstable run [m]."""
RUN_WINDOW = 0.020
"""Time over which such a run is looked for, longer than the sensor's noise [s]."""


@for_kernels
def tip_error(tip: T, target: float) -> T:
    """How far the crack tip is from the target [m]."""
    return abs(tip - target)


@for_kernels
def overshoot(tip: T, target: float) -> T:
    """How far the crack tip is beyond the target [m]."""
    beyond: T = np.maximum(tip - target, 0.0)
    return beyond


@for_kernels
def lag(blade: T, tip: T) -> T:
    """How far the crack tip is behind the blade [m]."""
    behind: T = np.maximum(blade - tip, 0.0)
    return behind


@for_kernels
def wedge(angle: float, depth: float) -> float:
    """How wide a wedge a blade leaning at ``angle`` [rad] leaves uncut, in the unit of ``depth``."""
    return depth * cotangent(angle)


@for_kernels
def force_per_depth(force: T, depth: T) -> T:
    """Force on the blade over the depth of the cut [N/m]."""
    return force / depth
