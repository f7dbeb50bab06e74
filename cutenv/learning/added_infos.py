"""Infos that data sets of a task have beside those of gentle cutting: meaning, component observed, or hidden state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import task_made_as


class AddedInfos(NamedTuple):
    """Infos that the data sets of one task add."""

    felt: Mapping[str, str]
    """Meaning of what is observed, by name with unit."""
    shown: tuple[str, ...]
    """Components of the observation that these are, in order."""
    hidden: Mapping[str, str]
    """Meaning of what only the simulator knows, by its name in ``info["truth"]``."""

    @property
    def meanings(self) -> dict[str, str]:
        """All meanings by name."""
        return {**self.felt, **self.hidden}


DEPTH_INFOS = AddedInfos(
    felt={
        "vertical_force_N": "measured vertical force at the decision, upwards",
        "blade_depth_m": "blade's lower end below the surface, as measured before the cut",
        "wanted_depth_m": "wanted depth at the blade",
    },
    shown=("vertical", "blade_depth", "wanted"),
    hidden={"floor_depth_m": "depth of the cut at the tip", "layer_m": "depth of the layer below"},
)
"""Added infos of cuts along a wanted depth."""
PATH_INFOS = AddedInfos(
    felt={
        "lateral_force_N": "measured force on the blade to its right, at the decision",
        "line_aside_m": "line to the left of the blade",
        "line_direction": "sine of the turn from blade to line, to the left",
        "line_bend_1_m": "curvature of the line at the blade, to the left",
    },
    shown=("lateral", "aside", "direction", "bend"),
    hidden={
        "blade_x_m": "place of the blade along the slab",
        "blade_y_m": "place of the blade across the slab, to the left",
        "tip_x_m": "place of the crack tip along the slab",
        "tip_y_m": "place of the crack tip across the slab, to the left",
        "aside_m": "distance of the tip to the left of the line, where the crack last turned",
    },
)
"""Added infos of cuts along a line."""
_NONE = AddedInfos(felt={}, shown=(), hidden={})


def infos_of(environment: str) -> AddedInfos:
    """Return what the data sets of an environment with this id add; nothing for one of gentle cutting."""
    return task_made_as(environment).infos or _NONE


def added_infos(environment: str, observation: np.ndarray, info: Mapping[str, Any]) -> dict[str, float]:
    """Return the added infos of one decision; nothing for an environment that adds none."""
    added, components = infos_of(environment), task_made_as(environment).task.all_components
    if added is _NONE:
        return {}
    seen = {one.name: value * one.scale for one, value in zip(components, observation.tolist(), strict=True)}
    felt = zip(added.felt, added.shown, strict=True)
    assert not {one.name for one in COMPONENTS}.intersection(added.shown), "an offset would be missing"
    return {name: seen[component] for name, component in felt} | {name: info["truth"][name] for name in added.hidden}
