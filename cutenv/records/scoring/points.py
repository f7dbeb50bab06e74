"""Points of a cut, part by part.

The overall score is their sum, up to 100.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cutenv.records.measurement.strokes import strokes
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.sim.quantities import (
    ANGLE_TOLERANCE,
    CLOSE,
    FORCE_ALLOWED,
    FORCE_LIMIT_PER_DEPTH,
    LAG_ALLOWED,
    LAG_CHARGED,
    LAYER_LIMIT,
    LINE_LIMIT,
    OVERSHOOT_ALLOWED,
    TIME_SCALE,
    TIP_TOLERANCE,
    closeness,
    force_per_depth,
    lag,
    tip_error,
    wedge,
)

LIMIT_POINTS, WAY_POINTS, ACCURACY_POINTS, SUCCESS_POINTS = 5.0, 25.0, 10.0, 10.0
"""Points for a cut within the limits of the task, for the tip's way to the target, for a tip near it, for a success."""
CONTROL_POINTS, TISSUE_POINTS, TIME_POINTS = 25.0, 20.0, 5.0
"""Points of a success: for a blade that can stop where the tissue gives way, for sparing the tissue, for the time."""
HALVED = {"control": 0.2, "tissue": 0.05, "time": 0.05}
"""Charge of the task at which half of these points are left; a third at twice the charge, a quarter at three times."""
MISSED = 0.5  # charge of the task, in all, by which points count e times less where the target was missed
BEYOND_LIMIT = 0.9  # charge of a cut beyond a limit, as the task has one for an end for safety
CHARGED = {
    "haste": 0.06, "uncontrolled": 0.1, "jump": 0.03, "force": 0.012, "lag": 0.02, "backward": 0.1, "time": 0.1
}  # fmt: skip
"""Weights of the costs that the task charges for the way in which a cut was made."""
DEADLINE = 30.0  # time after which a cut of a person ends by default [s]
MAP_POINTS = 30.0
"""Points for the depth of a cut along a wanted depth, or its path along a line; the other parts then share the rest."""
MAP_COST = 0.44
"""Charge of the task for depth or path from which on there are no points; a point is then as dear as the others."""
MAP_MISSED = 0.375
"""Share of these that counts where the target was missed, so that every success has more than any failure."""
PER = {"run": 0.010, "force": 100.0, "lag": 0.010, "time": TIME_SCALE}
"""Run [m], force over time [N/m s], lag over time [m s] and time [s] that cost their weight once."""
_LEAST_ANGLE = 0.5 * math.pi - ANGLE_TOLERANCE  # [rad]


@dataclass(frozen=True, kw_only=True)
class ScorePoints:
    """Points of one part of the overall score.

    Attributes
    ----------
    points, most : float
        Points of this cut, and of the best.
    """

    part: str
    points: float
    most: float
    reason: str


def task_points(cut: ScoredCut, metrics: Mapping[str, float]) -> tuple[ScorePoints, ...]:
    """Return a cut's points in the task's order.

    A success has the points for its end whole, and in addition those for the way in which it was made: under control,
    gentle with the tissue, in time. Where the target was missed, the points for the end count the less, the more the
    task charges for the way; a cut beyond a limit is charged for that as well. Each quantity is one that the task's
    reward charges.
    """
    end, length = float(cut.tip[cut.end]), cut.length
    off = tip_error(end, length)
    way = min(max(end / length, 0.0), 1.0)
    charged = charges(cut, metrics)
    fault = beyond_limit(cut, metrics)
    success = not fault and is_success(cut)
    charge = sum(charged.values()) + (BEYOND_LIMIT if fault else 0.0)
    counts = 1.0 if success else math.exp(-charge / MISSED)
    missed = "" if success else fault or _missed(cut)
    less = "" if success else f"; {missed}, so it counts {counts:.0%}: {_WORDS[max(charged, key=charged.__getitem__)]}"
    side = "short of" if end < length else "beyond"
    gained = (
        ("limits", LIMIT_POINTS, float(not fault), fault or f"not too long, not too much force{less}"),
        ("way", WAY_POINTS, way, f"{way:.0%} of the way to the target was cut{less}"),
        (
            "accuracy",
            ACCURACY_POINTS,
            float(closeness(end, length)),
            f"the cut ends {1e3 * off:.1f} mm {side} the target; from {1e3 * CLOSE:.0f} mm on there is nothing{less}",
        ),
        ("success", SUCCESS_POINTS, float(success), fault or _success(cut, success=success)),
    )
    gentle = tuple(
        ScorePoints(part=name, points=counts * most * share, most=most, reason=why) for name, most, share, why in gained
    ) + tuple(
        ScorePoints(
            part=name,
            points=most * _left(sum(charged[each] for each in OF_PART[name]), HALVED[name]) if success else 0.0,
            most=most,
            reason=why if success else f"{why}; nothing, because {missed}",
        )
        for name, most, why in (
            ("control", CONTROL_POINTS, "a blade that can stop at once where the tissue gives way"),
            ("tissue", TISSUE_POINTS, "few and short runs, little pressing and dragging"),
            ("time", TIME_POINTS, "a cut that is soon made"),
        )
    )
    found = cut.judged_map
    if found is None:
        return gentle
    share = 1.0 - MAP_POINTS / 100.0
    counts *= way * (1.0 if success else MAP_MISSED)
    of_map = MAP_POINTS * counts * min(max(1.0 - found.cost(length) / MAP_COST, 0.0), 1.0)
    added = ScorePoints(part=found.part, points=of_map, most=MAP_POINTS, reason=f"{found.words(length)}{less}")
    gentle = tuple(dataclasses.replace(each, points=share * each.points, most=share * each.most) for each in gentle)
    return *gentle, added


OF_PART = {"control": ("haste",), "tissue": ("uncontrolled", "jump", "force", "lag", "backward"), "time": ("time",)}
"""Charges by which each part of the way in which a cut was made is scored."""
_WORDS = {
    "haste": "too fast to stop", "uncontrolled": "the tissue ran", "jump": "long runs", "force": "pressed hard",
    "lag": "dragged along", "backward": "backed up", "time": "it took long",
}  # fmt: skip


def charges(cut: ScoredCut, metrics: Mapping[str, float]) -> dict[str, float]:
    """Return the task's charges for a cut's way, by :data:`CHARGED`."""
    runs, lasts = cut.jumps, cut.weights
    pressed = np.maximum(force_per_depth(cut.newtons, cut.depth) - FORCE_ALLOWED, 0.0)
    dragged = np.clip(lag(cut.position, cut.tip) - LAG_ALLOWED, 0.0, LAG_CHARGED)
    back = [cut.position[stroke.start] - cut.position[stroke.stop - 1] for stroke in strokes(cut.trace)]
    quantities = {
        "haste": metrics.get("haste", 0.0),
        "uncontrolled": float(runs.sum()) / cut.length,
        "jump": float(((runs / PER["run"]) ** 2).sum()),
        "force": float(lasts @ pressed) / PER["force"],
        "lag": float(lasts @ dragged) / PER["lag"],
        "backward": sum(max(float(way), 0.0) for way in back) / cut.length,
        "time": metrics.get("duration", DEADLINE) / PER["time"],
    }
    return {name: weight * quantities[name] for name, weight in CHARGED.items()}


def _left(charged: float, halved: float) -> float:
    """Return the share left by a charge, half at ``halved``."""
    return halved / (halved + charged)


def is_success(cut: ScoredCut) -> bool:
    """Return True for a tip on target, upright, properly ended.

    Where a depth is wanted, the cut is as deep as wanted, and the layer below is not opened; where there is a line, the
    cut is near enough to it.
    """
    near = tip_error(float(cut.tip[cut.end]), cut.length) <= TIP_TOLERANCE
    upright = cut.trace.angle is None or abs(wedge(float(cut.angle[cut.end]), 1.0)) <= wedge(_LEAST_ANGLE, 1.0)
    ended = cut.trace.metadata.get("end", "finished") == "finished"
    return near and upright and ended and not _map_missed(cut)


def _map_missed(cut: ScoredCut) -> str:
    """Return in words depth's or path's shortcoming, or ""."""
    found = cut.judged_map
    return "" if found is None else found.shortcoming(cut.length)


def _missed(cut: ScoredCut) -> str:
    """Return what was missed, in words."""
    near = tip_error(float(cut.tip[cut.end]), cut.length) <= TIP_TOLERANCE
    return (_map_missed(cut) if near else "") or "the target was missed"


def outcome_of(cut: ScoredCut, metrics: Mapping[str, float]) -> str:
    """Return a cut's outcome in a few words."""
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
    """Return the exceeded limit of the task in words; "" if none was."""
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
