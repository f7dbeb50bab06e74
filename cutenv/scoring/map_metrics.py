"""Metrics of the map of a cut: depth beside a wanted depth and the layer below, or distance to a drawn line; forces.

A record with the height of the blade has those of the depth, and one with a measured depth beside a wanted one. A
record with the places of the blade has those of the path, beside a line.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.scoring.metric import MAP_METRICS, metric
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.validity import Unavailable
from cutenv.tissue.grid import SPACING

_FLOOR: dict[str, Any] = {
    "among": MAP_METRICS["depth"],
    "validity": "floor as known: truth; with height, that of mean tissue under this blade; else the recorded depth",
    "needs": ("position", "depth", "newtons", "tip"),
    "invariances": ("time_shift",),
}
_PATH: dict[str, Any] = {
    "among": MAP_METRICS["path"],
    "validity": "cut as known: truth; else that of mean tissue behind this blade",
    "needs": ("position", "tip"),
    "invariances": ("time_shift",),
}
_FORCE: dict[str, Any] = {
    "source": "limit of a rig",
    "validity": "any record with it",
    "invariances": ("time_shift",),
}
_DEPTH_TASK, _PATH_TASK = "cost of the task along a wanted depth", "cost of the task along a drawn line"


@metric("m", "lower", formula="integral of abs(D - D_wanted) da / L", source=_DEPTH_TASK, **_FLOOR)
def mean_depth_error(cut: ScoredCut) -> float:
    """Mean distance of the floor of the cut from the wanted depth, over the target length."""
    return cut.depth_map.mean_error(cut.length)


@metric("m", "lower", formula="root of the mean over the cut of (D - D_wanted)^2", source="ours", **_FLOOR)
def rms_depth_error(cut: ScoredCut) -> float:
    """Root mean square distance of the floor of the cut from the wanted depth."""
    return float(np.sqrt(np.mean(cut.depth_map.error**2)))


@metric("m", "lower", formula="max of abs(D - D_wanted)", source="ours", **_FLOOR)
def largest_depth_error(cut: ScoredCut) -> float:
    """Largest distance of the floor of the cut from the wanted depth."""
    return float(np.abs(cut.depth_map.error).max())


@metric("m2", "lower", formula="integral of max(D - D_wanted, 0) da", source=_DEPTH_TASK, **_FLOOR)
def too_deep_area(cut: ScoredCut) -> float:
    """Area cut below the wanted depth."""
    return cut.depth_map.deep


@metric("m2", "lower", formula="integral of max(D_wanted - D, 0) da", source=_DEPTH_TASK, **_FLOOR)
def uncut_area(cut: ScoredCut) -> float:
    """Area left uncut above the wanted depth, behind the tip."""
    return cut.depth_map.uncut


@metric("m2", "lower", formula="integral of max(D - D_layer, 0) da", source=_DEPTH_TASK, **_FLOOR)
def layer_area(cut: ScoredCut) -> float:
    """Area opened in the layer below."""
    return SPACING * float(cut.depth_map.opened.sum())


@metric("m", "lower", formula="max of D - D_layer, or 0", source=_DEPTH_TASK, **_FLOOR)
def layer_depth(cut: ScoredCut) -> float:
    """Largest depth into the layer below."""
    return float(cut.depth_map.opened.max())


@metric("F", "lower", formula="max V, upwards on the blade", among=MAP_METRICS["depth"], **_FORCE)
def peak_vertical_force(cut: ScoredCut) -> float:
    """Largest force with which the blade pressed down on the tissue."""
    return max(float(_usable(cut, cut.trace.vertical_force, "vertical").max()), 0.0)


@metric("m", "lower", formula="integral of abs(d) da / L", source=_PATH_TASK, **_PATH)
def mean_line_distance(cut: ScoredCut) -> float:
    """Mean distance between cut and line, over the target length."""
    return cut.path_map.mean_distance(cut.length)


@metric("m", "lower", formula="max of abs(d)", source=_PATH_TASK, **_PATH)
def largest_line_distance(cut: ScoredCut) -> float:
    """Largest distance between cut and line."""
    return cut.path_map.farthest


@metric("m2", "lower", formula="integral of abs(d) (1 - curvature d / 2) da", source=_PATH_TASK, **_PATH)
def line_area(cut: ScoredCut) -> float:
    """Area between cut and line."""
    return cut.path_map.area


@metric("F", "lower", formula="max abs(lateral force)", among=MAP_METRICS["path"], **_FORCE)
def peak_lateral_force(cut: ScoredCut) -> float:
    """Largest force across the blade, to either side."""
    return float(abs(_usable(cut, cut.trace.lateral_force, "lateral")).max())


def _usable(cut: ScoredCut, force: Array | None, name: str) -> Array:
    if cut.spoiled:
        raise Unavailable(cut.spoiled)
    if force is None:
        raise Unavailable(f"{name} force was not recorded")
    return force
