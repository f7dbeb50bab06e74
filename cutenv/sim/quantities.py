"""Quantities that the reward charges and the score reports.

Each is defined once for both, under the same name.

They work in Python and inside compiled kernels; all but :func:`wedge` take floats or arrays.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from cutenv._base.arrays import Array
from cutenv._engine.declared import Formula
from cutenv._engine.elementary import cotangent
from cutenv._engine.jit import njit_internal

T = TypeVar("T", float, Array)

TIP_TOLERANCE = 0.003  # tip error up to which a cut is a success [m]
CLOSE = 0.009  # tip error from which on the tip is not close to the target at all [m]
ANGLE_TOLERANCE = math.radians(10.0)  # deviation from upright up to which a cut is a success [rad]
OVERSHOOT_ALLOWED = 0.005  # overshoot of the tip beyond the target above which the task ends [m]
# Force per depth at which a task ends for safety by default, and which a score counts as too much [N/m].
FORCE_LIMIT_PER_DEPTH = 1000.0
FORCE_ALLOWED = 400.0  # force per depth of cut up to which no force cost is charged [N/m]
LAG_ALLOWED = 0.010  # lag of the tip behind the blade up to which no lag cost is charged [m]
# Largest excess lag that is charged [m]: in a soft and tough specimen no blade can keep the tip nearer.
LAG_CHARGED = 0.010
DECELERATION = 0.1  # deceleration of a stopping blade, in the cost of haste [m/s2]
TIME_SCALE = 30.0  # time that costs its weight once [s]
# Smallest depth by which a force is divided in reward, score and policies: the smallest that was measured [m].
SHALLOWEST = 0.001
# Smallest depth of a measured profile; below it, no force per depth is computed [m].
MEASURABLE_DEPTH = 0.5 * SHALLOWEST
# Advance of the estimated tip beyond the blade's own below which it is noise, not an unstable run [m].
SMALLEST_RUN = 0.3e-3
RUN_ALLOWED = 0.004  # length of a run up to which it is no cost [m]
DEPTH_TOLERANCE = 0.0015  # mean error of the depth of cut up to which a cut along a wanted depth is a success [m]
LAYER_TOLERANCE = 0.0005  # depth to which a success may open the layer below [m]
# Depth into the layer below at which a task ends for safety by default, and which a score counts as too deep [m].
LAYER_LIMIT = 0.003
LINE_TOLERANCE = 0.001  # mean distance between cut and line up to which a cut along a line is a success [m]
FARTHEST_TOLERANCE = 0.003  # largest distance between cut and line up to which a cut along a line is a success [m]
# Distance between cut and line at which a task ends for safety by default, and which a score counts as too far [m].
LINE_LIMIT = 0.008


@njit_internal
def tip_error(tip: T, target: float) -> T:
    """Return the tip's distance to the target [m]."""
    return abs(tip - target)


@njit_internal
def closeness(tip: T, target: float) -> T:
    """Return 1 at the target, falling linearly with tip error to 0."""
    close: T = np.maximum(1.0 - tip_error(tip, target) / CLOSE, 0.0)
    return close


@njit_internal
def overshoot(tip: T, target: float) -> T:
    """Return the tip's distance beyond the target [m], or 0."""
    beyond: T = np.maximum(tip - target, 0.0)
    return beyond


@njit_internal
def lag(blade: T, tip: T) -> T:
    """Return the tip's distance behind the blade [m], or 0."""
    behind: T = np.maximum(blade - tip, 0.0)
    return behind


@njit_internal
def wedge(angle: float, depth: float) -> float:
    """Return the uncut wedge's width at ``angle`` [rad], in ``depth`` units."""
    return depth * cotangent(angle)


@njit_internal
def force_per_depth(force: T, depth: T) -> T:
    """Return force over depth of cut [N/m]."""
    return force / depth


@njit_internal
def too_deep(depth: T, wanted: T) -> T:
    """Return the depth beyond the wanted one [m], or 0."""
    deeper: T = np.maximum(depth - wanted, 0.0)
    return deeper


@njit_internal
def left_uncut(depth: T, wanted: T) -> T:
    """Return the depth missing to the wanted one [m], or 0."""
    left: T = np.maximum(wanted - depth, 0.0)
    return left


@njit_internal
def into_layer(depth: T, boundary: float) -> T:
    """Return the cut depth below ``boundary`` [m], or 0 above it."""
    opened: T = np.maximum(depth - boundary, 0.0)
    return opened


PER_MILLIMETRE = 0.001  # error of the depth, and distance to the line, that costs its weight once [m]


@dataclass(frozen=True, kw_only=True)
class WholeCutTerm:
    """One cost of a map of the cut.

    ``weight`` times a quantity of the whole cut, charged as it grows.

    What shrinks is refunded.  The map has a number for each point that the tip has passed, as the depth of the floor;
    the formulas are of sums over it.
    """

    name: str
    title: str
    text: str
    weight: float
    per: str
    value: Formula  # the quantity, of what the task sums up, as OF_MAP


OF_MAP = ("deep", "uncut", "layer", "deepest", "target")
"""Quantities of the map: areas cut too deep, left uncut and opened in the layer below [m2]; largest depth into that
layer [m]; target length [m]."""

# Costs of the depth, in order; none is charged for a cut as deep as wanted.
DEPTH_COSTS = (
    WholeCutTerm(
        name="too_deep",
        title="cut too deep",
        text="area below the wanted depth / (L x 1 mm)",
        weight=0.1,
        per="per mm too deep along the whole cut",
        value=lambda deep, target: deep / (target * PER_MILLIMETRE),
    ),
    WholeCutTerm(
        name="uncut",
        title="left uncut",
        text="area above the wanted depth, behind the tip, / (L x 1 mm)",
        weight=0.1,
        per="per mm too shallow along the whole cut",
        value=lambda uncut, target: uncut / (target * PER_MILLIMETRE),
    ),
    WholeCutTerm(
        name="layer_area",
        title="layer opened",
        text="area opened in the layer below / (L x 1 mm)",
        weight=0.2,
        per="per mm of the layer below opened along the whole cut",
        value=lambda layer, target: layer / (target * PER_MILLIMETRE),
    ),
    WholeCutTerm(
        name="layer_depth",
        title="depth into the layer",
        text="largest depth into the layer below / 1 mm",
        weight=0.05,
        per="per mm of the deepest place in the layer below",
        value=lambda deepest: deepest / PER_MILLIMETRE,
    ),
)


OF_PATH = ("area", "farthest", "target")
"""Quantities of the map along a line: area between cut and line [m2], largest distance of the cut to the line [m],
target length [m]."""

# Costs of the path, in order; none is charged for a cut on the line.
PATH_COSTS = (
    WholeCutTerm(
        name="off_line",
        title="off the line",
        text="area between cut and line / (L x 1 mm)",
        weight=0.2,
        per="per mm of distance to the line along the whole cut",
        value=lambda area, target: area / (target * PER_MILLIMETRE),
    ),
    WholeCutTerm(
        name="farthest",
        title="farthest from the line",
        text="largest distance between cut and line / 1 mm",
        weight=0.05,
        per="per mm of the largest distance to the line",
        value=lambda farthest: farthest / PER_MILLIMETRE,
    ),
)


def map_cost(costs: tuple[WholeCutTerm, ...], of_map: Mapping[str, float]) -> float:
    """Return the weighted sum of costs for the quantities of a map."""
    return math.fsum(
        cost.weight * cost.value(**{name: of_map[name] for name in inspect.signature(cost.value).parameters})
        for cost in costs
    )
