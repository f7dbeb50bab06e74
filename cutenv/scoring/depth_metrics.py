"""Metrics of the depth of a cut: its error beside a wanted depth, what is opened in the layer below, vertical force.

A record with the height of the blade has them, and one with a measured depth beside a wanted one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv.scoring.metric import DEPTH_METRICS, metric
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.unavailable import Unavailable
from cutenv.tissue.grid import SPACING

_FLOOR: dict[str, Any] = {
    "among": DEPTH_METRICS,
    "validity": "floor as known: truth; with height, that of mean tissue under this blade; else the recorded depth",
    "needs": ("position", "depth", "newtons", "tip"),
    "invariances": ("time_shift",),
}
_IN_TASK = "cost of the task along a wanted depth"


@metric("m", "lower", formula="integral of abs(D - D_wanted) da / L", source=_IN_TASK, **_FLOOR)
def mean_depth_error(cut: ScoredCut) -> float:
    """Mean distance of the floor of the cut from the wanted depth, over the target length."""
    return (cut.depth_map.deep + cut.depth_map.uncut) / cut.length


@metric("m", "lower", formula="root of the mean over the cut of (D - D_wanted)^2", source="ours", **_FLOOR)
def rms_depth_error(cut: ScoredCut) -> float:
    """Root mean square distance of the floor of the cut from the wanted depth."""
    return float(np.sqrt(np.mean(cut.depth_map.error**2)))


@metric("m", "lower", formula="max of abs(D - D_wanted)", source="ours", **_FLOOR)
def largest_depth_error(cut: ScoredCut) -> float:
    """Largest distance of the floor of the cut from the wanted depth."""
    return float(np.abs(cut.depth_map.error).max())


@metric("m2", "lower", formula="integral of max(D - D_wanted, 0) da", source=_IN_TASK, **_FLOOR)
def too_deep_area(cut: ScoredCut) -> float:
    """Area cut below the wanted depth."""
    return cut.depth_map.deep


@metric("m2", "lower", formula="integral of max(D_wanted - D, 0) da", source=_IN_TASK, **_FLOOR)
def uncut_area(cut: ScoredCut) -> float:
    """Area left uncut above the wanted depth, behind the tip."""
    return cut.depth_map.uncut


@metric("m2", "lower", formula="integral of max(D - D_layer, 0) da", source=_IN_TASK, **_FLOOR)
def layer_area(cut: ScoredCut) -> float:
    """Area opened in the layer below."""
    return SPACING * float(cut.depth_map.opened.sum())


@metric("m", "lower", formula="max of D - D_layer, or 0", source=_IN_TASK, **_FLOOR)
def layer_depth(cut: ScoredCut) -> float:
    """Largest depth into the layer below."""
    return float(cut.depth_map.opened.max())


@metric(
    "F", "lower", formula="max V, upwards on the blade", source="limit of a rig", validity="any record with it",
    among=DEPTH_METRICS, invariances=("time_shift",),
)  # fmt: skip
def peak_vertical_force(cut: ScoredCut) -> float:
    """Largest force with which the blade pressed down on the tissue."""
    if cut.spoiled:
        raise Unavailable(cut.spoiled)
    if cut.trace.vertical_force is None:
        raise Unavailable("vertical force was not recorded")
    return max(float(cut.trace.vertical_force.max()), 0.0)


def depth_in_words(cut: ScoredCut) -> str:
    """Return mean error of the depth and depth into the layer in words; "" if no depth is wanted.

    Raises
    ------
    Unavailable
        If the floor or the target is unknown.
    """
    if cut.wanted is None:
        return ""
    off = f"{1e3 * mean_depth_error(cut):.1f} mm off the wanted depth in the mean"
    opened = 0.0 if cut.layer_depth is None else layer_depth(cut)
    return off if math.isclose(opened, 0.0, abs_tol=1e-9) else f"{off}, {1e3 * opened:.1f} mm into the layer below"
