"""Pages of a scored cut and of a summary of many, each a self-contained file."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from cutenv._base.atomic_file import atomic_write
from cutenv._base.unit_table import shown_unit
from cutenv.report.page import (
    Html,
    PageSection,
    Row,
    definitions,
    element,
    escaped,
    html_table,
    number,
    page,
    paragraph,
    picture,
    write_page,
)
from cutenv.report.score_figure import score_figure
from cutenv.scoring import METRICS, ScoreCard
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.trace import Trace

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
    card = scored.card
    sections = [
        PageSection("cut", "The cut", _drawing(scored)),
        PageSection("next", "What to try next", _advice(card)),
        PageSection("metrics", "Every metric", _metrics(card)),
        PageSection("meaning", "What the metrics mean", _meaning(card)),
    ]
    kind = "open" if card.overall_score is None else ("good" if card.overall_score >= 50.0 else "bad")
    if kind == "good" and _SPOILS & {fault.kind for fault in card.faults}:
        kind = "open"  # not shown in green, however gentle the rest was
    lead = Html(
        f'<div class="verdict {kind}">\n{paragraph("Score", "word")}\n{paragraph(_sentence(card), "headline")}\n'
        f"{paragraph(' '.join(note[0].upper() + note[1:] + '.' for note in card.notes))}\n{paragraph(DISCLAIMER)}</div>"
    )
    write_page(path, page(f"Score: {card.name}", _subtitle(scored), lead, sections))
    data = path.with_suffix(".json")
    write_page(data, Html(card.to_json() + "\n"))
    return data


def write_summary(folder: Path, records: Sequence[tuple[ScoredRecord, str]]) -> tuple[Path, Path]:
    """Write ``scores.csv`` and ``summary.html`` of several cuts, each with its page's name, into a folder.

    Returns
    -------
    table, page : Path
    """
    columns = [name for name in METRICS if any(r.card.metrics[name].value is not None for r, _ in records)]
    data = folder / "scores.csv"
    with atomic_write(data) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        units = [_column(name, records[0][0].card) for name in columns]
        writer.writerow(["name", "overall_score", "tip_source", *units, "faults"])
        for record, _ in records:
            card = record.card
            values = [card.metrics[name].value for name in columns]
            overall = "" if card.overall_score is None else f"{card.overall_score:.1f}"
            cells = ["" if value is None else f"{value:.6g}" for value in values]
            faults = "; ".join(fault.says for fault in card.faults)
            writer.writerow([card.name, overall, card.tip_source, *cells, faults])
    heads = [escaped(text) for text in ("cut", "score", "tip error [mm]", "peak force", "drops", "time [s]", "faults")]
    rows = []
    for record, name in records:
        card = record.card
        shown = [
            "" if card.overall_score is None else number(card.overall_score, 0),
            *(_cell(card, metric) for metric in ("tip_error", "peak_force", "force_drops", "duration")),
        ]
        link = Html(f'<a href="{escaped(name)}">{escaped(card.name)}</a>')
        faults = Html(
            '<span style="white-space:normal;display:block;text-align:left">'
            f"{escaped('; '.join(fault.says for fault in card.faults))}</span>"
        )
        rows.append(Row([link, *(escaped(cell) for cell in shown), faults]))
    target = folder / "summary.html"
    lead = Html(f'<div class="verdict open">{paragraph(DISCLAIMER)}</div>')
    sections = [PageSection("cuts", "Every cut", html_table("One row a cut", heads, rows))]
    write_page(target, page(f"{len(records)} scored cuts", records[0][0].card.reference, lead, sections))
    return data, target


def _column(name: str, card: ScoreCard) -> str:
    unit = card.unit(name).replace("/", "_per_").replace(" ", "_")
    return name if unit == "1" else f"{name}_{unit}"


def _cell(card: ScoreCard, name: str) -> str:
    value = card.metrics[name].value
    if value is None:
        return ""
    return _digits(shown_unit(card.unit(name)).from_si(value))


def _subtitle(scored: ScoredRecord) -> str:
    trace = scored.trace
    aimed = "" if scored.target_length is None else f", aimed at {1e3 * scored.target_length:.0f} mm"
    return f"{trace.duration:.1f} s at {trace.sample_rate:.0f} Hz{aimed}; tip: {scored.card.tip_source}."


def _sentence(card: ScoreCard) -> str:
    text = card.headline()
    return text[0].upper() + text[1:] + "."


def _drawing(scored: ScoredRecord) -> Html:
    numbered = [f"{i}: {fault.says}" for i, fault in enumerate(scored.card.faults, 1)]
    caption = "; ".join(numbered) + "." if numbered else "No fault was found."
    return picture(
        partial(score_figure, scored.trace, scored.card, scored.target_length),
        "Force of the cut with its loading segments, and the faults",
        escaped(caption),
    )


def _advice(card: ScoreCard) -> Html:
    if not card.faults:
        return paragraph("No fault was found to correct; look at the percentiles below.")
    return definitions([(fault.says, fault.try_next + ".") for fault in card.faults])


def _metrics(card: ScoreCard) -> Html:
    heads = [escaped(text) for text in ("", "value", "unit", "better", "better than [%]", "weight")]
    rows = []
    for name, scored in card.metrics.items():
        about = METRICS[name]
        unit = shown_unit(card.unit(name))
        title = escaped(name.replace("_", " "))
        if scored.value is None:
            gone = element("span", escaped(f"unavailable: {scored.unavailable}"), "chip")
            rows.append(Row([title, gone, escaped(""), escaped(""), escaped(""), escaped("")]))
            continue
        weight = card.weights.get(name)
        cells = [
            escaped(_digits(unit.from_si(scored.value))),
            escaped("" if unit.sign == "1" else unit.sign),
            escaped({"lower": "lower", "higher": "higher", "none": "not rewarded"}[about.direction]),
            _bar(scored.percentile),
            escaped("" if weight is None else number(weight, 2)),
        ]
        rows.append(Row([title, *cells], "own" if weight is not None else ""))
    return html_table("Metrics of the cut; those with a weight make the score", heads, rows)


def _bar(percentile: float | None) -> Html:
    if percentile is None:
        return escaped("")
    return Html(
        f'{number(percentile, 0)} <span style="display:inline-block;width:4rem;height:0.55rem;background:var(--line);'
        f'border-radius:0.3rem;vertical-align:middle"><span style="display:block;width:{percentile:.0f}%;height:100%;'
        'background:var(--accent);border-radius:0.3rem"></span></span>'
    )


def _meaning(card: ScoreCard) -> Html:
    known = [name for name, scored in card.metrics.items() if scored.value is not None]
    return definitions(
        [
            (
                name.replace("_", " "),
                f"{METRICS[name].meaning} {METRICS[name].formula}. Source: {METRICS[name].source}. "
                f"Valid: {METRICS[name].validity}.",
            )
            for name in known
        ]
    )


def _digits(value: float) -> str:
    """Return three significant digits in print typography; a number that is zero up to rounding is zero."""
    if abs(value) < 1e-9:
        return "0"
    whole = abs(value) >= 100.0
    return number(value, 0 if whole else 1 if abs(value) >= 10.0 else 2 if abs(value) >= 1.0 else 3)
