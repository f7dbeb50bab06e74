"""Metrics of the outcome: distance from the target, unstable growth, work."""

from __future__ import annotations

import math

import numpy as np

from cutenv import task_quantities
from cutenv.scoring.metric import metric
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.unavailable import Unavailable

_FLAT = 0.1  # sine of the angle below which no blade cuts
_TIP = ("position", "depth", "newtons", "tip")
_VALID_TIP = "tip as known: truth; after a return stroke, to 0.3 mm; or estimated, to 1 or 2 mm, one in ten beyond 5 mm"


@metric(
    "m", "lower", formula="|a_end - L|", source="terminal cost of the task", validity=_VALID_TIP,
    needs=(*_TIP, "target_length"), invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def tip_error(cut: ScoredCut) -> float:
    """Distance of the crack tip from the target at the end."""
    return task_quantities.tip_error(float(cut.tip[cut.end]), cut.length)


@metric(
    "m", "lower", formula="max(a - L, 0)", source="cost of the task", validity=_VALID_TIP,
    needs=(*_TIP, "target_length"), invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def overshoot(cut: ScoredCut) -> float:
    """Largest distance of the crack tip beyond the target."""
    return float(task_quantities.overshoot(float(cut.tip[: cut.end + 1].max()), cut.length))


@metric(
    "1", "lower", formula="cot(theta_end)", source="terminal cost of the task", validity="45 to 90 degrees",
    needs=("angle",), invariances=("time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"),
)  # fmt: skip
def wedge(cut: ScoredCut) -> float:
    """Width of the wedge that an inclined blade leaves uncut at the end, over its depth."""
    angle = float(cut.angle[cut.end])
    if math.sin(angle) < _FLAT:
        raise Unavailable(f"the blade lies flat, at {math.degrees(angle):.0f} degrees")
    return abs(float(task_quantities.wedge(angle, 1.0)))


@metric(
    "1", "lower", formula="sum of jumps / advance of the tip", source="law of cutting, unstable growth",
    validity=_VALID_TIP, needs=_TIP, invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def uncontrolled_share(cut: ScoredCut) -> float:
    """Fraction of the cut that the crack ran by itself (unstable growth)."""
    advance = float(cut.tip[-1] - min(cut.tip[0], 0.0))
    if advance < 1e-3:
        raise Unavailable("the tip advances less than 1 mm")
    return min(float(cut.jumps.sum()) / advance, 1.0)


@metric(
    "m", "lower", formula="max of jumps", source="law of cutting, unstable growth", validity=_VALID_TIP, needs=_TIP,
    invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def largest_jump(cut: ScoredCut) -> float:
    """Longest unstable run of the crack."""
    return float(cut.jumps.max())


@metric(
    "m", "lower", formula="mean of x - a while the blade advances", source="law of cutting", validity=_VALID_TIP,
    needs=_TIP, invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def mean_lag(cut: ScoredCut) -> float:
    """Mean distance of the tip behind the blade: tissue that is dragged along."""
    return cut.mean(task_quantities.lag(cut.position, cut.tip))


@metric(
    "1", "lower", formula="integral of F dx / (R integral of B da)", source="thesis, 6.1-6.4", validity=_VALID_TIP,
    needs=_TIP, invariances=("time_shift", "resampling", "rest_after", "units"),
)  # fmt: skip
def work_over_fracture(cut: ScoredCut) -> float:
    """Work of the blade over the fracture energy of the cut area; R is the truth, or else pig liver's mean."""
    F, x = cut.newtons, cut.position
    work = float(0.5 * (F[1:] + F[:-1]) @ np.diff(x))
    area = cut.profile.area(min(float(cut.tip[0]), 0.0), float(cut.tip[-1]))
    if area < 1e-6:
        raise Unavailable("less than 1 mm2 was cut")
    R = cut.tissue.fracture_resistance if cut.truth is None else cut.truth.resistance
    return work / (R * area)
