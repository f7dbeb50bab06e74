"""Quantities that the reward charges and the score reports under the same name, each defined once for both.

They work in Python and inside compiled kernels; all but :func:`wedge` take floats or arrays.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from cutenv._base.arrays import Array
from cutenv._engine.elementary import cotangent
from cutenv._engine.jit import njit_internal

T = TypeVar("T", float, Array)

TIP_TOLERANCE = 0.003
"""Tip error up to which a cut is a success [m]."""
CLOSE = 0.009
"""Tip error from which on the tip is not close to the target at all [m]."""
ANGLE_TOLERANCE = math.radians(10.0)
"""Deviation from upright up to which a cut is a success [rad]."""
OVERSHOOT_ALLOWED = 0.005
"""Overshoot of the tip beyond the target above which the task ends [m]."""
FORCE_LIMIT_PER_DEPTH = 1000.0
"""Force per depth at which a task ends for safety by default, and which a score counts as too much [N/m]."""
SHALLOWEST = 0.001
"""Smallest depth by which a force is divided in reward, score and policies: the smallest that was measured [m]."""
MEASURABLE_DEPTH = 0.5 * SHALLOWEST
"""Smallest depth of a measured profile; below it, no force per depth is computed [m]."""
SMALLEST_RUN = 0.3e-3
"""Advance of the estimated tip beyond the blade's own below which it is noise, not an unstable run [m]."""
RUN_ALLOWED = 0.004
"""Length of a run up to which it is no cost [m]."""


@njit_internal
def tip_error(tip: T, target: float) -> T:
    """Return the distance from the crack tip to the target [m]."""
    return abs(tip - target)


@njit_internal
def closeness(tip: T, target: float) -> T:
    """Return 1 for a crack tip at the target, less linearly with the tip error, down to 0."""
    close: T = np.maximum(1.0 - tip_error(tip, target) / CLOSE, 0.0)
    return close


@njit_internal
def overshoot(tip: T, target: float) -> T:
    """Return the distance by which the crack tip is beyond the target [m], 0 before it."""
    beyond: T = np.maximum(tip - target, 0.0)
    return beyond


@njit_internal
def lag(blade: T, tip: T) -> T:
    """Return the distance by which the crack tip is behind the blade [m], 0 if it is not."""
    behind: T = np.maximum(blade - tip, 0.0)
    return behind


@njit_internal
def wedge(angle: float, depth: float) -> float:
    """Return the width of the wedge that a blade at ``angle`` [rad] leaves uncut, in the unit of ``depth``."""
    return depth * cotangent(angle)


@njit_internal
def force_per_depth(force: T, depth: T) -> T:
    """Return the force on the blade over the depth of cut [N/m]."""
    return force / depth
