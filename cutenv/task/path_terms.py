"""Declarations that ``cutenv/PathCut-v1`` adds to those of gentle cutting: observation, costs, end, constants."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.parameter import check_parameters, parameter
from cutenv.task.map_costs import map_fields
from cutenv.task.observation import COMPONENTS, Component
from cutenv.task.reward import ENDS, TERMS
from cutenv.task_quantities import LINE_LIMIT, PATH_COSTS, PER_MILLIMETRE  # noqa: F401  a formula of a cost needs it

TURN_SCALE = 1.5
"""Rate of turn of action 1 [rad/s]: more than the sharpest bend of a line at full speed asks for."""
LINE_AHEAD = (0.005, 0.010, 0.020)
"""Distances ahead of the blade at which the line is observed [m]."""
PATH_TERMS = tuple(cost.name for cost in PATH_COSTS)
"""Names of the costs of the path."""
ALL_PATH_TERMS = (*TERMS, *PATH_TERMS)
"""Names of all terms of the reward of ``cutenv/PathCut-v1``."""

_ASIDE, _DIRECTION, _BEND = 0.005, 0.5, 25.0  # scales

PATH_COMPONENTS = (
    Component(name="lateral", meaning="force on the blade to its right, now", unit="N", scale=5.0),
    Component(name="lateral_mean", meaning="its mean since the last decision", unit="N", scale=5.0),
    Component(name="lateral_peak", meaning="largest size of it since the last decision", unit="N", scale=5.0),
    Component(name="aside", meaning="line to the left of the blade, at the blade", unit="m", scale=_ASIDE),
    Component(
        name="direction", meaning="sine of the turn from blade to line there, to the left", unit="1", scale=_DIRECTION
    ),
    Component(name="bend", meaning="curvature of the line there, to the left", unit="1/m", scale=_BEND),
    Component(
        name="aside_near", meaning="line to the left of the blade's course, 5 mm further", unit="m", scale=_ASIDE
    ),
    Component(name="direction_near", meaning="direction there", unit="1", scale=_DIRECTION),
    Component(name="bend_near", meaning="curvature there", unit="1/m", scale=_BEND),
    Component(
        name="aside_further", meaning="line to the left of the blade's course, 10 mm further", unit="m", scale=_ASIDE
    ),
    Component(name="direction_further", meaning="direction there", unit="1", scale=_DIRECTION),
    Component(name="bend_further", meaning="curvature there", unit="1/m", scale=_BEND),
    Component(
        name="aside_far", meaning="line to the left of the blade's course, 20 mm further", unit="m", scale=_ASIDE
    ),
    Component(name="direction_far", meaning="direction there", unit="1", scale=_DIRECTION),
    Component(name="bend_far", meaning="curvature there", unit="1/m", scale=_BEND),
    Component(name="last_turn", meaning="last action: turn", unit="1", scale=1.0),
)
"""Components of the observation that follow the 12 of gentle cutting, in order."""
ALL_PATH_COMPONENTS = (*COMPONENTS, *PATH_COMPONENTS)
"""All components of the observation of ``cutenv/PathCut-v1``."""

OFF_LINE = len(ENDS)
"""Code of the end for safety that the path adds: the cut came too far from the line."""
PATH_ENDS = (*ENDS, "off_line")
"""Names of the ends by code; code 0: not ended."""


@dataclass(frozen=True, kw_only=True)
class PathConstants:
    """Constants of the path: weights of its costs, limit of the distance, sensor of the lateral force."""

    line_limit: float = parameter(
        LINE_LIMIT, unit="m", low=0.0005, high=0.03, provenance="choice",
        source="distance between cut and line at which a cut ends for safety", sensitivity=(0.005, 0.015),
    )  # fmt: skip
    lateral_noise: float = parameter(
        0.02, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    lateral_resolution: float = parameter(
        0.05, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    weight_off_line: float = parameter(
        PATH_COSTS[0].weight, unit="1", low=0.0, high=100.0, provenance="choice", source=PATH_COSTS[0].per
    )
    weight_farthest: float = parameter(
        PATH_COSTS[1].weight, unit="1", low=0.0, high=100.0, provenance="choice", source=PATH_COSTS[1].per
    )

    def __post_init__(self) -> None:
        check_parameters(self)


PATH_MAP: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *((name, "f8") for name in PathConstants.__dataclass_fields__),
            ("counts", "i8"),  # number of points of the line in the sums below
            ("passed_area", "f8"),  # area between cut and line up to these points [m2],
            ("passed_farthest", "f8"),  # largest distance [m],
            ("passed_distance", "f8"),  # and the integral of the distance along the line [m2]
            ("area", "f8"),  # the same with what the tip has passed since its crack last turned
            ("farthest", "f8"),
            ("distance", "f8"),
            ("begun", "f8"),  # length of line that was cut at the start [m]
            ("line", "i8"),  # number of the line
            *map_fields(PATH_COSTS),
        ],
    )
)
"""Record of a cut's line, and of the map by which its path is assessed."""

assert all(math.isclose(*both) for both in zip(LINE_AHEAD, (0.005, 0.010, 0.020), strict=True)), "as the texts say"
