"""Pages of a scored cut and of a summary of many, each a self-contained file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv._base.unit_table import shown_unit
from cutenv.report.page import number, write_page, write_table, write_text
from cutenv.report.score_figure import score_figure, summary_figure
from cutenv.scoring import MAP_METRICS, ScoreCard, all_metrics
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.score_notes import DOUBT
from cutenv.trace import Trace

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
        "largest_jump", "uncontrolled_share", "mean_lag", "work_over_fracture", "peak_force", "peak_force_per_depth",
        "mean_force_per_depth", "rms_force_per_depth", "force_time_integral",
    ),
    "Steadiness": (
        "force_rate", "force_jerk", "force_drops", "mean_force_drop", "force_variation", "crest_factor", "sparc",
        "log_dimensionless_jerk",
    ),
    "Time": ("duration", "idle_time", "reversals"),
}  # fmt: skip
"""Metrics of every record by what they tell, in the order of the page; those of the depth follow."""
_SPOILS = {"short", "overshoot", "force"}
"""Kinds of faults that no score compensates: a target missed, a force above the limit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredRecord:
    """Record with its score card."""

    trace: Trace
    card: ScoreCard
    target_length: float | None


def write_score_page(path: Path, scored: ScoredRecord) -> Path:
    """Write the page of one cut, and its card as JSON beside it.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    scored : ScoredRecord
        Record and card to write.

    Returns
    -------
    Path
        Path of the JSON: the page's with the suffix ``.json``.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    card, trace = scored.card, scored.trace
    kind = "open" if card.overall_score is None else ("good" if card.overall_score >= 50.0 else "bad")
    if kind == "good" and (_SPOILS & {f.kind for f in card.faults} or any(n.startswith(DOUBT) for n in card.notes)):
        kind = "open"  # not shown in green, however gentle the rest was
    aimed = "" if scored.target_length is None else f", aimed at {1e3 * scored.target_length:.0f} mm"
    length = f"{trace.duration:.1f} s at {trace.sample_rate:.0f} Hz"
    write_page(
        path,
        "score.html",
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


def write_summary(folder: Path, records: Sequence[tuple[ScoredRecord, str]]) -> tuple[Path, Path]:
    """Write ``scores.csv`` and ``summary.html`` of several cuts, each with its page's name, into a folder.

    Returns
    -------
    table, page : Path
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
    """Return the mean of a metric as shown, over the cuts that have it."""
    values = [value for card in cards if (value := card.metrics[name].value) is not None]
    return _digits(shown_unit(cards[0].unit(name)).from_si(sum(values) / len(values))) if values else ""


def _origin(trace: Trace) -> str:
    """Return who made a cut, when and in what, as far as the record tells."""
    facts = trace.metadata
    told = [str(facts[key]) for key in ("operator", "date", "specimen", "specimen_class") if facts.get(key)]
    return ", ".join(dict.fromkeys(told)) + "; " if told else ""


def _column(name: str, card: ScoreCard) -> str:
    unit = card.unit(name).replace("/", "_per_").replace(" ", "_")
    return name if unit == "1" else f"{name}_{unit}"


def _handy(card: ScoreCard, name: str) -> tuple[str, str]:
    """Return value and unit of a metric as shown; "" for a metric that is unavailable."""
    value, unit = card.metrics[name].value, shown_unit(card.unit(name))
    return "" if value is None else _digits(unit.from_si(value)), "" if unit.sign == "1" else unit.sign


def _digits(value: float) -> str:
    """Return three significant digits in print typography; a number that is zero up to rounding is zero."""
    if abs(value) < 1e-9:
        return "0"
    whole = abs(value) >= 100.0
    return number(value, 0 if whole else 1 if abs(value) >= 10.0 else 2 if abs(value) >= 1.0 else 3)


_SHARED: dict[str, Any] = {
    "disclaimer": DISCLAIMER,
    "handy": _handy,
    "leading": ON_TOP,
    "metrics": all_metrics(),
}
"""Context of both pages."""


def _shared(cards: Sequence[ScoreCard]) -> dict[str, Any]:
    """Return the context of a page; depth and path are groups of their own where a card has them."""
    added = {
        part.capitalize(): tuple(found)
        for part, found in MAP_METRICS.items()
        if any(name in card.metrics for card in cards for name in found)
    }
    return _SHARED | {"groups": METRIC_GROUPS | added}
