"""Pages of a scored cut, and of a summary of many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.unit_table import shown_unit
from cutenv.display.report.page import (
    PHONE_WIDTH,
    label,
    new_figure,
    number,
    plain_axes,
    write_page,
    write_table,
    write_text,
)
from cutenv.records.measurement import loading_segments
from cutenv.records.scoring import MAP_METRICS, DepthMap, PathMap, ScoreCard, all_metrics
from cutenv.records.scoring.doubts import DOUBT
from cutenv.records.scoring.score_card import DISCLAIMER
from cutenv.sim.quantities import FARTHEST_TOLERANCE, FORCE_LIMIT_PER_DEPTH, TIP_TOLERANCE
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_FORCE, _RAMP, _FAULT, _LIMIT, _TARGET, _SPEED, _ANGLE = (
    "0.55", "#0072b2", "#d55e00", "#b00020", "#009e73", "#0072b2", "#8a3ffc",
)  # fmt: skip
_POINTS = 3000  # points of a line: more than a figure has pixels


def score_figure(trace: Trace, card: ScoreCard, target_length: float | None, width: float) -> Figure:
    """Draw one cut with its card, against position or time; width [in]."""
    along = trace.position is not None
    deep = along and card.depth_map is not None
    steered = along and card.path_map is not None
    rows = 1 + along + (trace.angle is not None) + deep + steered
    figure = new_figure(width, 3.4 + 1.1 * (rows - 1))
    panels = np.atleast_1d(figure.subplots(rows, 1, sharex=True, height_ratios=[3.0, *[1.0] * (rows - 1)]))
    step = max(1, len(trace) // _POINTS)
    x = _places(trace)
    force = panels[0]
    force.plot(x[::step], trace.force[::step], color=_FORCE, linewidth=0.9, label="force")
    _draw_ramps(force, trace, x)
    _draw_limits(force, trace, x, target_length)
    _draw_faults(force, trace, card, x)
    unit = "N" if trace.force_unit == "N" else "normalised"
    force.set_ylabel(f"force [{unit}]")
    if trace.position is not None:
        speed = 100.0 * trace.blade_speed
        panels[1].plot(x[::step], speed[::step], color=_SPEED, linewidth=0.9)
        panels[1].set_ylabel("speed\n[cm/s]")
    if trace.angle is not None:
        turned = panels[2 if along else 1]
        turned.plot(x[::step], np.degrees(trace.angle[::step]), color=_ANGLE, linewidth=1.2)
        turned.set_ylabel("angle\n[°]")
        turned.set_ylim(min(40.0, math.degrees(trace.angle.min()) - 5.0), 95.0)
    if deep and card.depth_map is not None:
        _draw_depth(panels[-1 - steered], card.depth_map)
    if steered and card.path_map is not None:
        _draw_path(panels[-1], card.path_map)
    panels[-1].set_xlabel("blade [cm]" if along else "time [s]")
    for axes in panels:
        plain_axes(axes)
    columns = 2 if width < PHONE_WIDTH else 5
    figure.legend(loc="outside upper left", ncols=columns, frameon=False, fontsize=9)
    return figure


def _draw_depth(axes: Axes, found: DepthMap) -> None:
    """Draw floor, wanted depth, layer below and surface of a cut."""
    x = 100.0 * found.position
    lowest = float(found.depth.max())
    axes.plot(x, 1e3 * found.depth, color=_SPEED, linewidth=1.4, label="floor of the cut")
    if found.wanted is not None:
        lowest = max(lowest, float(found.wanted.max()))
        axes.plot(x, 1e3 * found.wanted, color=_TARGET, linewidth=1.2, linestyle="--", label="wanted depth")
    if found.layer is not None:
        lowest = max(lowest, found.layer + 0.001)
        axes.axhspan(1e3 * found.layer, 1.1e3 * lowest, color=_FAULT, alpha=0.2, linewidth=0.0, label="layer below")
    axes.set_ylim(1.1e3 * lowest, 0.0)
    axes.set_ylabel("depth\n[mm]")


def _draw_path(axes: Axes, found: PathMap) -> None:
    x = 100.0 * SPACING * np.arange(len(found.aside))
    axes.axhline(0.0, color=_TARGET, linewidth=1.2, linestyle="--", label="line")
    axes.plot(x, 1e3 * found.aside, color=_SPEED, linewidth=1.4, label="cut, left of the line")
    most = 1e3 * max(FARTHEST_TOLERANCE, found.farthest)
    axes.set_ylim(-1.1 * most, 1.1 * most)
    axes.set_ylabel("off the\nline [mm]")


def summary_figure(cuts: Sequence[tuple[str, ScoreCard]], width: float) -> Figure:
    """Draw overall scores of many cuts by operator, filled for success."""
    people = list(dict.fromkeys(operator for operator, _ in cuts))
    figure = new_figure(width, 0.9 + 0.26 * len(people))
    axes = figure.subplots()
    for operator, card in cuts:
        if card.overall_score is not None:
            filled = "full" if card.outcome.startswith("success") else "none"
            row = people.index(operator)
            axes.plot(card.overall_score, -row, "o", color=_RAMP, markersize=6, alpha=0.8, fillstyle=filled)
    axes.set_yticks(
        -np.arange(len(people)), [label(each or ("no code" if len(people) > 1 else "cuts")) for each in people]
    )
    axes.set_ylim(-len(people) + 0.4, 0.6)
    axes.set_xlim(-2.0, 102.0)
    axes.set_xlabel("overall score")
    plain_axes(axes, "x")
    return figure


def _places(trace: Trace) -> Array:
    """Return the force's abscissa: blade position [cm], or time [s]."""
    return trace.time if trace.position is None else 100.0 * trace.position


def _draw_ramps(axes: Axes, trace: Trace, x: Array) -> None:
    """Draw loading segments, each ended by a drop."""
    try:
        segments = loading_segments(trace)
    except ValueError:  # a record too short or too coarse for segments is still drawn
        return
    for i, segment in enumerate(segments):
        ends = [segment.start, segment.stop - 1]
        half = 0.5 * segment.force_rise
        force = [segment.force - half, segment.force + half]
        axes.plot(x[ends], force, color=_RAMP, linewidth=1.6, label=None if i else "loading")
        if segment.drop > 0.0:
            top = float(x[ends[1]])
            axes.plot(
                [top, top], [force[1], force[1] - segment.drop], ":", color=_RAMP, linewidth=1.2,
                label=None if i else "drop",
            )  # fmt: skip


def _draw_limits(axes: Axes, trace: Trace, x: Array, target_length: float | None) -> None:
    if trace.depth is not None and trace.force_unit == "N":
        limit = FORCE_LIMIT_PER_DEPTH * trace.depth
        if trace.force.max() > 0.5 * float(limit.max()):  # a distant one would flatten the drawing
            order = np.argsort(x)[:: max(1, len(x) // _POINTS)]
            axes.plot(x[order], limit[order], color=_LIMIT, linewidth=1.0, linestyle="--", label="limit")
    if target_length is not None and trace.position is not None:
        low, high = 100.0 * (target_length - TIP_TOLERANCE), 100.0 * (target_length + TIP_TOLERANCE)
        axes.axvspan(low, high, color=_TARGET, alpha=0.18, linewidth=0.0, label="target of the tip")


def _draw_faults(axes: Axes, trace: Trace, card: ScoreCard, x: Array) -> None:
    top = float(trace.force.max())
    for i, fault in enumerate(card.faults):
        place = float(np.interp(fault.time, trace.time, x))
        force = float(np.interp(fault.time, trace.time, trace.force))
        axes.plot(place, force, "v", color=_FAULT, markersize=8, label=None if i else "fault")
        axes.annotate(
            label(str(i + 1)), (place, force), (0, 9), textcoords="offset points", ha="center", fontsize=9, color=_FAULT
        )
    axes.set_ylim(top=max(1.12 * top, 0.1 * abs(top) + 1e-9))


ON_TOP = {
    "tip_error": "from tip to target",
    "overshoot": "cut too far",
    "largest_jump": "longest run",
    "peak_force": "peak force",
    "duration": "time",
}
"""Metrics on top of the page, in words."""
METRIC_GROUPS = {
    "Target": ("tip_error", "overshoot", "wedge"),
    "Tissue": (
        "largest_jump", "uncontrolled_share", "haste", "mean_lag", "work_over_fracture", "peak_force",
        "peak_force_per_depth", "mean_force_per_depth", "rms_force_per_depth", "force_time_integral",
    ),
    "Steadiness": (
        "force_rate", "force_jerk", "force_drops", "mean_force_drop", "force_variation", "crest_factor", "sparc",
        "log_dimensionless_jerk",
    ),
    "Time": ("duration", "idle_time", "reversals"),
}  # fmt: skip
"""Metrics of every record by what they tell, in the order of the page; those of the depth follow."""
_SPOILS = {"short", "overshoot", "force", "layer", "line"}
"""Kinds of faults that no score compensates: a target missed, a limit exceeded."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredRecord:
    """Record with its score card."""

    trace: Trace
    card: ScoreCard
    target_length: float | None


def write_score_page(path: Path, scored: ScoredRecord, *, language: str = "en") -> Path:
    """Write the page of one cut, and its card as JSON, whose path is returned."""
    card, trace = scored.card, scored.trace
    kind = "open" if card.overall_score is None else ("good" if card.overall_score >= 50.0 else "bad")
    if kind == "good" and (_SPOILS & {f.kind for f in card.faults} or any(n.startswith(DOUBT) for n in card.notes)):
        kind = "open"  # not shown in green, however gentle the rest was
    aimed = "" if scored.target_length is None else f", aimed at {1e3 * scored.target_length:.0f} mm"
    length = f"{trace.duration:.1f} s at {trace.sample_rate:.0f} Hz"
    write_page(
        path,
        "score.html",
        language=language,
        subtitle=f"{_origin(trace)}{length}{aimed}; tip: {card.tip_source}.",
        kind=kind,
        score_figure=score_figure,
        doubt=DOUBT,
        directions={"lower": "lower", "higher": "higher", "none": "not rewarded"},
        sentence=lambda text: text[0].upper() + text[1:] + ".",
        **vars(scored),
        **_shared([card]),
    )
    data = path.with_suffix(".json")
    write_text(data, card.to_json() + "\n")
    return data


def write_summary(
    folder: Path, records: Sequence[tuple[ScoredRecord, str]], *, language: str = "en"
) -> tuple[Path, Path]:
    """Write ``scores.csv`` and ``summary.html`` of several cuts into a folder.

    Each cut comes with its page's name. The page is in a language, the table in English. Return the paths of table and
    page.
    """
    valued = {name for r, _ in records for name, scored in r.card.metrics.items() if scored.value is not None}
    columns = [name for name in all_metrics() if name in valued]
    data = folder / "scores.csv"
    cards = [record.card for record, _ in records]
    rows = [
        ["name", "overall_score", "outcome", "tip_source", *(_column(name, cards[0]) for name in columns), "faults"]
    ]
    for card in cards:
        values = [card.metrics[name].value if name in card.metrics else None for name in columns]
        overall = "" if card.overall_score is None else f"{card.overall_score:.1f}"
        cells = ["" if value is None else f"{value:.6g}" for value in values]
        faults = "; ".join(fault.says for fault in card.faults)
        rows.append([card.name, overall, card.outcome, card.tip_source, *cells, faults])
    write_table(data, rows)
    target = folder / "summary.html"
    scores = [card.overall_score for card in cards if card.overall_score is not None]
    known = [card.outcome for card in cards if card.outcome]
    successes = sum(outcome.startswith("success") for outcome in known)
    said = f"{successes} of {len(known)} cuts succeeded." if known else ""
    write_page(
        target,
        "summary.html",
        language=language,
        subtitle=f"Force alone compares with {cards[0].reference}." if not known and cards[0].reference else "",
        headline=f"Mean score {number(sum(scores) / len(scores), 0)} of 100. {said}".rstrip() if scores else said,
        summary_figure=summary_figure,
        cuts=[(str(r.trace.metadata.get("operator") or ""), r.card) for r, _ in records],
        records=records,
        mean_score=number(sum(scores) / len(scores), 0) if scores else "",
        successes=f"{successes} of {len(known)}" if known else "",
        means=[_mean(cards, name) for name in ("tip_error", "largest_jump", "peak_force", "duration")],
        **_shared(cards),
    )
    return data, target


def _mean(cards: Sequence[ScoreCard], name: str) -> str:
    values = [value for card in cards if (value := card.metrics[name].value) is not None]
    return _digits(shown_unit(cards[0].unit(name)).from_si(sum(values) / len(values))) if values else ""


def _origin(trace: Trace) -> str:
    """Return who made a cut, when and in what, if recorded."""
    facts = trace.metadata
    told = [str(facts[key]) for key in ("operator", "date", "specimen", "specimen_class") if facts.get(key)]
    return ", ".join(dict.fromkeys(told)) + "; " if told else ""


def _column(name: str, card: ScoreCard) -> str:
    unit = card.unit(name).replace("/", "_per_").replace(" ", "_")
    return name if unit == "1" else f"{name}_{unit}"


def _handy(card: ScoreCard, name: str) -> tuple[str, str]:
    """Return a metric's shown value and unit, "" if unavailable."""
    value, unit = card.metrics[name].value, shown_unit(card.unit(name))
    return "" if value is None else _digits(unit.from_si(value)), "" if unit.sign == "1" else unit.sign


def _digits(value: float) -> str:
    """Return three significant digits as printed; a value that rounds to zero is zero."""
    if abs(value) < 1e-9:
        return "0"
    whole = abs(value) >= 100.0
    return number(value, 0 if whole else 1 if abs(value) >= 10.0 else 2 if abs(value) >= 1.0 else 3)


_SHARED: dict[str, Any] = {"disclaimer": DISCLAIMER, "handy": _handy, "leading": ON_TOP, "metrics": all_metrics()}
"""Context of both pages."""


def _shared(cards: Sequence[ScoreCard]) -> dict[str, Any]:
    """Return the context of a page, with groups for depth and path."""
    added = {
        part.capitalize(): tuple(found)
        for part, found in MAP_METRICS.items()
        if any(name in card.metrics for card in cards for name in found)
    }
    return _SHARED | {"groups": METRIC_GROUPS | added}
