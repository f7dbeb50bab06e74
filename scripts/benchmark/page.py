"""Page with the table of a benchmark: one file that opens without a network."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.protocol import ENTRIES
from cutenv.report.page import write_page
from cutenv.report.training_figures import Bar, returns_figure

if TYPE_CHECKING:
    from benchmark.summary import Table

_ROLES = {"learned": "agent", "best script": "script", "upper bound: sees hidden state": "bound"}


def write_page_of(path: Path, standings: Table, about: str, origin: Mapping[str, Any]) -> None:
    """Write the page of a comparison; ``about`` explains the numbers, ``origin`` is their provenance."""
    verdicts = standings.verdicts()
    won = any(": beats it" in sentence for sentence in verdicts)
    kind, word = ("good", "An agent beats the best script") if won else ("bad", "No agent beats the best script")
    if not verdicts:
        trained = set(standings.contestants) & set(ENTRIES)
        kind, word = "open", "No script to compare with" if trained else "No agent has been trained"
    write_page(
        path,
        Path(__file__).with_name("leaderboard.html"),
        standings=standings,
        about=about,
        origin=origin,
        kind=kind,
        word=word,
        verdicts=verdicts,
        entries=ENTRIES,
        bars=[_bar(standings, name) for name in standings.contestants],
        returns_figure=returns_figure,
    )


def _bar(standings: Table, name: str) -> Bar:
    line = standings.line(name, standings.headline, "return")
    assert line is not None, "every contestant has a return"
    role = _ROLES.get(standings.kind(name), "other")
    return Bar(name, role, line.interval.value, line.interval.low, line.interval.high)
