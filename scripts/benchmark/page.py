"""Page with the table of a benchmark: one file that opens without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.protocol import ENTRIES
from cutenv.report.page import (
    Html,
    PageSection,
    Row,
    definitions,
    escaped,
    folded,
    html_table,
    joined,
    page,
    paragraph,
    picture,
    write_page,
)
from cutenv.report.training_figures import Bar, returns_figure

if TYPE_CHECKING:
    from benchmark.summary import Table

_CHIPS = {"learned": "learned", "best script": "best script", "upper bound: sees hidden state": "upper bound"}
_ROLES = {"learned": "agent", "best script": "script", "upper bound: sees hidden state": "bound"}
_NOT_SAID = (
    "Cuts are simulated: these policies have not been measured on a rig. Intervals cover specimens and a few "
    "training runs, not the assumptions of the model; the sweep of constants covers some of those. No agent was "
    "trained or chosen on the held-out specimens, and no run but a comparison like this one cuts them. Mixed ones are "
    "drawn of liver and of vascular tissue from the same seeds."
)


def write_page_of(path: Path, standings: Table, about: str, origin: Mapping[str, Any]) -> None:
    """Write the page of a comparison; ``about`` explains the numbers, ``origin`` is their provenance."""
    sections = [
        PageSection("table", "Standings", joined(paragraph(about), _main(standings), _picture(standings))),
        PageSection("classes", "By class of specimens", _plain("Return, interquartile mean", *standings.classes())),
        PageSection("ablations", "What each ablation costs", _ablations(standings)),
        PageSection("robustness", "Where a constant is not what it was in training", _robustness(standings)),
        PageSection("metrics", "Every metric of the score card", _metrics(standings)),
        PageSection("meaning", "Limits of these results", paragraph(_NOT_SAID)),
        PageSection("facts", "Facts", definitions(_facts(standings, origin), "facts")),
    ]
    write_page(
        path,
        page(
            "Gentle cutting: benchmark of policies",
            f"Protocol {standings.protocol.version}",
            _lead(standings),
            sections,
        ),
    )


def _lead(standings: Table) -> Html:
    sentences = standings.verdicts()
    won = [sentence for sentence in sentences if ": beats it" in sentence]
    kind, word = ("good", "An agent beats the best script") if won else ("bad", "No agent beats the best script")
    if not sentences:
        trained = set(standings.contestants) & set(ENTRIES)
        kind, word = "open", "No script to compare with" if trained else "No agent has been trained"
    said = "\n".join(paragraph(sentence) for sentence in sentences)
    return Html(f'<div class="verdict {kind}">\n{paragraph(word, "word")}\n{said}\n</div>')


def _main(standings: Table) -> Html:
    heading, rows = standings.main()
    shown = []
    for name, kind, *cells in rows:
        chip = f' <span class="chip">{_CHIPS[kind]}</span>' if kind in _CHIPS else ""
        shown.append(Row([Html(f"{escaped(name)}{chip}"), *map(_cell, cells)], "own" if kind == "learned" else ""))
    caption = f"Held-out specimens of class {standings.headline}, the best return first"
    return html_table(caption, [escaped(name) for name in (heading[0], *heading[2:])], shown)


def _cell(text: str) -> Html:
    """Format a number, with its interval in small type."""
    number, _, interval = text.partition(" [")
    if not interval:
        return escaped(text)
    number, interval = (part.replace("-", "\u2212") for part in (number, interval))  # minus signs as in print
    return Html(f'{escaped(number)} <span class="interval">[{escaped(interval)}</span>')


def _plain(caption: str, heading: Sequence[str], rows: Sequence[Sequence[str]]) -> Html:
    shown = [Row([escaped(name), *map(_cell, cells)], "own" if name in ENTRIES else "") for name, *cells in rows]
    return html_table(caption, [escaped(name) for name in heading], shown)


def _picture(standings: Table) -> Html:
    bars = []
    for name in standings.contestants:
        line = standings.line(name, standings.headline, "return")
        assert line is not None, "every contestant has a return"
        role = _ROLES.get(standings.kind(name), "other")
        bars.append(Bar(name, role, line.interval.value, line.interval.low, line.interval.high))
    spoken = ", ".join(f"{bar.policy} {bar.mean:.2f} [{bar.low:.2f}, {bar.high:.2f}]" for bar in bars)
    caption = "Interquartile mean of the return with its interval. Blue dot: learned; orange square: best script; "
    return picture(
        partial(returns_figure, bars),
        f"Interquartile mean of the return: {spoken}.",
        escaped(caption + "open green diamond: upper bound, which is shown the hidden state."),
    )


def _ablations(standings: Table) -> Html:
    heading, rows = standings.ablations()
    if not rows:
        return paragraph("No ablation has been trained.")
    explained = paragraph(
        "The same agent with one part changed, paired by specimen and training seed. Below 0 the part was useful."
    )
    return joined(explained, _plain("Mean paired differences with 95 % intervals", heading, rows))


def _robustness(standings: Table) -> Html:
    heading, rows = standings.robustness()
    if not rows:
        return paragraph("No constant has been swept.")
    explained = paragraph(
        "Each constant at both ends of its range, the others as in training; no policy is trained for it or informed. "
        "The first row changes none: a loss is the difference from it. In all rows the specimens are the "
        f"first {standings.protocol.sweep_specimens} of class {standings.headline}."
    )
    return joined(explained, _plain("Return, interquartile mean with 95 % interval", heading, rows))


def _metrics(standings: Table) -> Html:
    explained = paragraph("Interquartile means, in the unit of the name; the intervals are in summary.csv.")
    return joined(explained, folded("The table", _plain("Metrics of the score card", *standings.metrics())))


def _facts(standings: Table, origin: Mapping[str, Any]) -> list[tuple[str, str]]:
    p = standings.protocol
    return [
        ("environment", p.environment),
        ("classes", ", ".join(p.classes)),
        ("held-out specimens of each", str(p.specimens)),
        ("their seeds", f"{p.test_seeds[0]} to {p.test_seeds[-1]}"),
        ("training seeds", ", ".join(map(str, p.training_seeds))),
        ("minutes of each training", f"{p.training_minutes:g}, on one core"),
        ("resamples", str(p.resamples)),
        ("commits of the runs", ", ".join(origin["commits"]) or "none"),
        *((f"{name} version", version) for name, version in origin["versions"].items()),
    ]
