"""Metrics of the path of a cut: its distance to a drawn line, the area between them, lateral force.

A record with the places of the blade has them, beside a line.
"""

from __future__ import annotations

from typing import Any

from cutenv.scoring.metric import PATH_METRICS, metric
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.unavailable import Unavailable

_PATH: dict[str, Any] = {
    "among": PATH_METRICS,
    "validity": "cut as known: truth; else that of mean tissue behind this blade",
    "needs": ("position", "tip"),
    "invariances": ("time_shift",),
}
_IN_TASK = "cost of the task along a drawn line"


@metric("m", "lower", formula="integral of abs(d) da / L", source=_IN_TASK, **_PATH)
def mean_line_distance(cut: ScoredCut) -> float:
    """Mean distance between cut and line, over the target length."""
    return cut.path_map.mean_distance(cut.length)


@metric("m", "lower", formula="max of abs(d)", source=_IN_TASK, **_PATH)
def largest_line_distance(cut: ScoredCut) -> float:
    """Largest distance between cut and line."""
    return cut.path_map.farthest


@metric("m2", "lower", formula="integral of abs(d) (1 - curvature d / 2) da", source=_IN_TASK, **_PATH)
def line_area(cut: ScoredCut) -> float:
    """Area between cut and line."""
    return cut.path_map.area


@metric(
    "F", "lower", formula="max abs(lateral force)", source="limit of a rig", validity="any record with it",
    among=PATH_METRICS, invariances=("time_shift",),
)  # fmt: skip
def peak_lateral_force(cut: ScoredCut) -> float:
    """Largest force across the blade, to either side."""
    if cut.spoiled:
        raise Unavailable(cut.spoiled)
    if cut.trace.lateral_force is None:
        raise Unavailable("lateral force was not recorded")
    return float(abs(cut.trace.lateral_force).max())


def path_in_words(cut: ScoredCut) -> str:
    """Return mean and largest distance to the line in words; "" if there is no line.

    Raises
    ------
    Unavailable
        If the cut or the target is unknown.
    """
    if cut.line is None:
        return ""
    mean, largest = 1e3 * mean_line_distance(cut), 1e3 * largest_line_distance(cut)
    return f"{mean:.1f} mm off the line in the mean, {largest:.1f} mm at most"
