"""Declarations that ``cutenv/DepthCut-v1`` adds to those of gentle cutting: observation, costs, end, constants."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.parameter import check_parameters, parameter
from cutenv.task.map_costs import map_fields
from cutenv.task.observation import COMPONENTS, Component
from cutenv.task.reward import ENDS, TERMS
from cutenv.task_quantities import DEPTH_COSTS, LAYER_LIMIT, PER_MILLIMETRE  # noqa: F401  a formula of a cost needs it
from cutenv.tissue.grid import N_POINTS

DESCENT_SCALE = 0.010
"""Speed downwards of descent action 1 [m/s]."""
LOOK_AHEAD = (0.005, 0.010, 0.020)
"""Distances ahead of the blade at which the wanted depth is observed [m]."""
DEPTH_TERMS = tuple(cost.name for cost in DEPTH_COSTS)
"""Names of the costs of the depth."""
ALL_TERMS = (*TERMS, *DEPTH_TERMS)
"""Names of all terms of the reward of ``cutenv/DepthCut-v1``."""

DEPTH_COMPONENTS = (
    Component(name="vertical", meaning="vertical force now, upwards", unit="N", scale=5.0),
    Component(name="vertical_mean", meaning="its mean since the last decision", unit="N", scale=5.0),
    Component(name="vertical_max", meaning="its maximum since the last decision", unit="N", scale=5.0),
    Component(
        name="blade_depth", meaning="blade's lower end below the surface, as measured beforehand", unit="m", scale=0.02
    ),
    Component(name="descent_speed", meaning="of the blade, downwards", unit="m/s", scale=DESCENT_SCALE),
    Component(name="wanted", meaning="wanted depth at the blade", unit="m", scale=0.02),
    Component(name="wanted_near", meaning="5 mm further", unit="m", scale=0.02),
    Component(name="wanted_further", meaning="10 mm further", unit="m", scale=0.02),
    Component(name="wanted_far", meaning="20 mm further", unit="m", scale=0.02),
    Component(name="last_descent", meaning="last action: descent", unit="1", scale=1.0),
)
"""Components of the observation that follow the 12 of gentle cutting, in order."""
ALL_COMPONENTS = (*COMPONENTS, *DEPTH_COMPONENTS)
"""All components of the observation of ``cutenv/DepthCut-v1``."""

LAYER = len(ENDS)
"""Code of the end for safety that depth adds: the layer below was opened too deep."""
DEPTH_ENDS = (*ENDS, "layer")
"""Names of the ends by code; code 0: not ended."""


@dataclass(frozen=True, kw_only=True)
class DepthConstants:
    """Constants of the depth: weights of its costs, limit of the layer, sensor of the vertical force."""

    layer_limit: float = parameter(
        LAYER_LIMIT, unit="m", low=0.0001, high=0.03, provenance="choice",
        source="depth into the layer below at which a cut ends for safety", sensitivity=(0.001, 0.005),
    )  # fmt: skip
    vertical_noise: float = parameter(
        0.02, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    vertical_resolution: float = parameter(
        0.05, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    weight_too_deep: float = parameter(
        DEPTH_COSTS[0].weight, unit="1", low=0.0, high=100.0, provenance="choice", source=DEPTH_COSTS[0].per
    )
    weight_uncut: float = parameter(
        DEPTH_COSTS[1].weight, unit="1", low=0.0, high=100.0, provenance="choice", source=DEPTH_COSTS[1].per
    )
    weight_layer_area: float = parameter(
        DEPTH_COSTS[2].weight, unit="1", low=0.0, high=100.0, provenance="choice", source=DEPTH_COSTS[2].per
    )
    weight_layer_depth: float = parameter(
        DEPTH_COSTS[3].weight, unit="1", low=0.0, high=100.0, provenance="choice", source=DEPTH_COSTS[3].per
    )

    def __post_init__(self) -> None:
        check_parameters(self)


DEPTH: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *((name, "f8") for name in DepthConstants.__dataclass_fields__),
            ("level_wanted", "i8"),  # 1: the wanted depth is the specimen's own profile, level 0 of the blade
            ("wanted", "f8", (N_POINTS,)),  # depth below the surface [m]
            ("counted", "f8", (N_POINTS,)),  # depth of the floor as it is in the sums below [m]; -1: not yet
            ("deep", "f8"),  # sums over the map, see OF_MAP
            ("uncut", "f8"),
            ("layer", "f8"),
            ("deepest", "f8"),
            ("counts", "i8"),  # number of points in the map
            *map_fields(DEPTH_COSTS),
        ],
    )
)
"""Record of a cut's wanted depth and of the map by which its depth is assessed."""

assert all(math.isclose(*both) for both in zip(LOOK_AHEAD, (0.005, 0.010, 0.020), strict=True)), "as the texts say"
