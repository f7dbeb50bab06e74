"""Page with the table of a benchmark: one file that opens without a network."""

from __future__ import annotations

from pathlib import Path

from cutenv.display.report.page import write_page
from cutenv.display.report.training_result import Bar, returns_figure
from scripts.benchmarks.leaderboard.protocol import SCRIPTED
from scripts.benchmarks.leaderboard.summary import BOUND, IDLE, Table


def write_page_of(path: Path, standings: Table, about: str) -> None:
    """Write the page of a comparison; ``about`` explains the numbers."""
    verdicts = standings.verdicts()
    won = any(": beats it" in sentence for sentence in verdicts)
    kind, word = ("good", "An agent beats the best script") if won else ("bad", "No agent beats the best script")
    if not verdicts:
        kind, word = "open", "No agent has been trained"
    by_return = [name for name in standings.contestants if name in standings.rows]
    write_page(
        path,
        Path(__file__).with_name("leaderboard.html"),
        standings=standings,
        about=about,
        kind=kind,
        word=word,
        verdicts=verdicts,
        scripted=SCRIPTED,
        bars=[bar for bar in (_bar(standings, name) for name in by_return) if bar is not None],
        returns_figure=returns_figure,
    )


def _bar(standings: Table, name: str) -> Bar | None:
    """Return the difference from the best script; None for an idle policy, whose distance would hide all others."""
    kind = standings.kind(name)
    if kind == IDLE:
        return None
    of_others = "script" if name == standings.protocol.script else "bound" if kind == BOUND else "other"
    role = of_others if name in SCRIPTED else "agent"
    line = standings.difference(name, standings.protocol.script)
    found = (0.0, 0.0, 0.0) if line is None else (line.interval.value, line.interval.low, line.interval.high)
    return Bar(standings.named(name), role, *found)
