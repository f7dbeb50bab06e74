"""ScorePoints of a cut, part by part; the overall score is their sum, up to 100."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from cutenv.scoring.scored_cut import ScoredCut
from cutenv.task_quantities import (
    ANGLE_TOLERANCE,
    CLOSE,
    FORCE_LIMIT_PER_DEPTH,
    LAYER_LIMIT,
    LINE_LIMIT,
    OVERSHOOT_ALLOWED,
    RUN_ALLOWED,
    TIP_TOLERANCE,
    closeness,
    tip_error,
    wedge,
)

LIMIT_POINTS = 5.0
"""ScorePoints for a cut within the limits of the task."""
WAY_POINTS, ACCURACY_POINTS, SUCCESS_POINTS = 25.0, 10.0, 20.0
"""ScorePoints for the tip's way to the target, for a tip near it, and for a success."""
TISSUE_POINTS, STEADINESS_POINTS, TIME_POINTS = 25.0, 10.0, 5.0
"""ScorePoints for sparing the tissue, for a steady force, and for the time, of a success."""
MISSED = 0.375
"""Share of these that counts where the target was missed, so that every success has more than any failure."""
BEYOND_LIMIT = 0.16
"""Share of the points for the way that counts after a cut beyond a limit: less than a cut not begun has."""
DEADLINE = 30.0
"""Duration of a cut that has no points for the time [s]."""
TISSUE_HARMED = {
    "uncontrolled_share": (0.0, 1.0 / 0.7),
    "largest_jump": (RUN_ALLOWED, 0.020),
    "peak_force_per_depth": (600.0, 1000.0),
    "mean_lag": (0.008, 0.020),
}
"""Metrics that take points for the tissue: value up to which nothing is taken, and how far beyond it all is."""
MAP_POINTS = 30.0
"""Points for the depth of a cut along a wanted depth, or its path along a line; gentle cutting then has the others."""
MAP_COST = 0.44
"""Charge of the task for depth or path from which on there are no points; a point is then as dear as the others."""
RESTLESS = 2.0
"""RMS rate of the force over its peak that has no points for steadiness [1/s]."""
_LEAST_ANGLE = 0.5 * math.pi - ANGLE_TOLERANCE  # [rad]


@dataclass(frozen=True, kw_only=True)
class ScorePoints:
    """ScorePoints of one part of the overall score.

    Attributes
    ----------
    part : str
        Name of the part, or of the metric.
    points, most : float
        ScorePoints of this cut, and of the best.
    reason : str
        What they are given for, in words for people.
    """

    part: str
    points: float
    most: float
    reason: str


def task_points(cut: ScoredCut, metrics: Mapping[str, float]) -> tuple[ScorePoints, ...]:
    """Return the points of a cut whose tip and target are known, in the order of the task.

    Reaching the target and sparing the tissue dominate; a steady force and the time decide among successes. The
    quantities are those that the task's reward charges.

    Parameters
    ----------
    cut : ScoredCut
        The cut.
    metrics : mapping of str to float
        Values of the metrics that are available.

    Raises
    ------
    Unavailable
        If the tip or the target is unknown.
    """
    end, length = float(cut.tip[cut.end]), cut.length
    off = tip_error(end, length)
    way = min(max(end / length, 0.0), 1.0)
    fault = beyond_limit(cut, metrics)
    if fault:
        return (
            ScorePoints(
                part="way",
                points=BEYOND_LIMIT * WAY_POINTS * way,
                most=WAY_POINTS,
                reason=f"{fault}: little else counts",
            ),
        )
    success = is_success(cut)
    counts = way * (1.0 if success else MISSED)
    less = "" if success else f"; counts for less, because {_missed(cut)}"
    side = "short of" if end < length else "beyond"
    gained = (
        ScorePoints(part="limits", points=LIMIT_POINTS, most=LIMIT_POINTS, reason="not too long, not too much force"),
        ScorePoints(
            part="way", points=WAY_POINTS * way, most=WAY_POINTS, reason=f"{way:.0%} of the way to the target was cut"
        ),
        ScorePoints(
            part="accuracy",
            points=ACCURACY_POINTS * float(closeness(end, length)),
            most=ACCURACY_POINTS,
            reason=f"the cut ends {1e3 * off:.1f} mm {side} the target; from {1e3 * CLOSE:.0f} mm on there is nothing",
        ),
        ScorePoints(
            part="success", points=SUCCESS_POINTS * success, most=SUCCESS_POINTS, reason=_success(cut, success=success)
        ),
    )
    qualities = (
        ("tissue", TISSUE_POINTS, _tissue(metrics), "few and short runs, little pressing and dragging"),
        ("steadiness", STEADINESS_POINTS, _steadiness(metrics), "a force that changes slowly"),
        (
            "time",
            TIME_POINTS,
            1.0 - metrics.get("duration", DEADLINE) / DEADLINE,
            f"from {DEADLINE:.0f} s on there is nothing",
        ),
    )
    gentle = gained + tuple(
        ScorePoints(part=name, points=most * counts * _share(quality), most=most, reason=why + less)
        for name, most, quality, why in qualities
    )
    found = cut.judged_map
    if found is None:
        return gentle
    share = 1.0 - MAP_POINTS / 100.0
    of_map = MAP_POINTS * counts * _share(1.0 - found.cost(length) / MAP_COST)
    added = ScorePoints(part=found.part, points=of_map, most=MAP_POINTS, reason=f"{found.words(length)}{less}")
    gentle = tuple(dataclasses.replace(each, points=share * each.points, most=share * each.most) for each in gentle)
    return *gentle, added


def is_success(cut: ScoredCut) -> bool:
    """Return True for a tip near the target, under an upright blade, in a cut that ended as it should.

    Where a depth is wanted, the cut is as deep as wanted, and the layer below is not opened; where there is a line, the
    cut is near enough to it.

    Raises
    ------
    Unavailable
        If the tip or the target is unknown.
    """
    near = tip_error(float(cut.tip[cut.end]), cut.length) <= TIP_TOLERANCE
    upright = cut.trace.angle is None or abs(wedge(float(cut.angle[cut.end]), 1.0)) <= wedge(_LEAST_ANGLE, 1.0)
    ended = cut.trace.metadata.get("end", "finished") == "finished"
    return near and upright and ended and not _map_missed(cut)


def _map_missed(cut: ScoredCut) -> str:
    """Return what depth or path lack for a success, in words; "" for nothing, or where none is wanted."""
    found = cut.judged_map
    return "" if found is None else found.shortcoming(cut.length)


def _missed(cut: ScoredCut) -> str:
    """Return what was missed, in words."""
    near = tip_error(float(cut.tip[cut.end]), cut.length) <= TIP_TOLERANCE
    return (_map_missed(cut) if near else "") or "the target was missed"


def outcome_of(cut: ScoredCut, metrics: Mapping[str, float]) -> str:
    """Return the outcome of a cut in a few words.

    Raises
    ------
    Unavailable
        If the tip or the target is unknown.
    """
    off = 1e3 * (float(cut.tip[cut.end]) - cut.length)
    tolerance = 1e3 * TIP_TOLERANCE
    shown = abs(off) if abs(off) <= tolerance else max(abs(off), tolerance + 0.1)  # rounded, it does not look near
    place = f"{shown:.1f} mm {'short of' if off < 0.0 else 'beyond'} the target"
    if fault := beyond_limit(cut, metrics):
        return fault
    if is_success(cut):
        depth = () if cut.wanted is None else (cut.depth_map.words(cut.length),)
        path = () if cut.line is None else (cut.path_map.words(cut.length),)
        return ", ".join(("success", place, *depth, *path))
    return place if abs(off) > 1e3 * TIP_TOLERANCE else f"{place}, but {_success(cut, success=False)}"


def beyond_limit(cut: ScoredCut, metrics: Mapping[str, float]) -> str:
    """Return which limit of the task was exceeded, in words; "" if none was.

    Raises
    ------
    Unavailable
        If the tip or the target is unknown.
    """
    too_far = float(cut.tip[: cut.end + 1].max()) - cut.length
    told = cut.trace.metadata.get("end")
    if too_far > OVERSHOOT_ALLOWED or told == "overshoot":
        return f"the cut is {1e3 * max(too_far, OVERSHOOT_ALLOWED):.0f} mm too long"
    if metrics.get("peak_force_per_depth", 0.0) > FORCE_LIMIT_PER_DEPTH or told == "force_limit":
        return f"the force exceeded {FORCE_LIMIT_PER_DEPTH:.0f} N per metre of depth"
    opened = metrics.get("layer_depth", 0.0)
    if opened > LAYER_LIMIT or told == "layer":
        return f"the layer below is opened by {1e3 * max(opened, LAYER_LIMIT):.1f} mm"
    off = metrics.get("largest_line_distance", 0.0)
    if off > LINE_LIMIT or told == "off_line":
        return f"the cut is {1e3 * max(off, LINE_LIMIT):.1f} mm off the line"
    return ""


def _success(cut: ScoredCut, *, success: bool) -> str:
    if success:
        return "the target was reached"
    if tip_error(float(cut.tip[cut.end]), cut.length) > TIP_TOLERANCE:
        return f"the tip must end within {1e3 * TIP_TOLERANCE:.0f} mm of the target"
    ended = cut.trace.metadata.get("end", "finished")
    if ended != "finished":
        return f"the cut was not finished: {ended}"
    return _map_missed(cut) or "the blade must end upright"


def _tissue(metrics: Mapping[str, float]) -> float:
    """Return 1 for tissue that was spared, less for runs, pressing and dragging."""
    return 1.0 - sum(max(metrics.get(name, 0.0) - free, 0.0) / most for name, (free, most) in TISSUE_HARMED.items())


def _steadiness(metrics: Mapping[str, float]) -> float:
    """Return 1 for a force that does not change, less for its rate over its peak."""
    peak = metrics.get("peak_force", 0.0)
    return 1.0 - metrics.get("force_rate", 0.0) / peak / RESTLESS if peak > 0.0 else 0.0


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)
