"""Table of a benchmark, as Markdown and as a page, made from summary.csv and sweeps.csv."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmark.aggregate import ALL, read_summary, summary, sweep_lines
from benchmark.page import write_page_of
from benchmark.protocol import Protocol, kept_protocol, slug
from benchmark.summary import Table
from cutenv._base.atomic_file import atomic_write
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.run_provenance import marked
from cutenv.learning.seeds import ENVIRONMENT
from cutenv.policy import SCRIPTS

PUBLISHED = Path(__file__).parents[2] / "assets" / "benchmark"
"""Folder of the published comparison."""
_ORIGIN = "origin.json"
_TABLES = ("protocol.json", "summary.csv", "sweeps.csv", _ORIGIN)  # files from which text and page are generated
_CUTS_KEPT = 10


def markdown_table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a Markdown table."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def markdown(folder: Path) -> str:
    """Return the block of the documentation: main table, verdicts, ablations, robustness."""
    table = read_table(folder)
    parts = [about(table), markdown_table(*table.main())]
    if table.verdicts():
        parts.append("\n".join(f"- {sentence}" for sentence in table.verdicts()))
    for title, content in (
        ("Return on every class of specimens", table.classes()),
        ("What each ablation costs", table.ablations()),
        ("Return where a constant is not what it was in training", table.robustness()),
    ):
        if content[1]:
            parts += [f"{title}:", markdown_table(*content)]
    return "\n\n".join(parts)


def earlier(environment: str) -> str:
    """Return a sentence about a table measured on another version of the environment; empty for the present one."""
    if environment == ENVIRONMENT:
        return ""
    name = environment.partition("/")[2]
    return f"Measured on {name}, which has another tissue and cutting law; not comparable with {ENVIRONMENT}. "


def about(table: Table) -> str:
    """Return one paragraph that explains the numbers."""
    p = table.protocol
    n = len(p.training_seeds)
    return (
        f"{earlier(p.environment)}Protocol {p.version}: "
        f"{p.specimens} held-out specimens of class {p.training_class}, "
        f"{n} training runs of {p.training_minutes:g} minutes on one core each; interquartile mean (success: mean) "
        "with 95 % stratified bootstrap interval over runs and specimens. Differences are means, paired by specimen. "
        "Training decisions include demonstrations and discarded checkpoints. "
        f"'{ALL}' averages the pure classes (uniform, liver, vascular). "
        f"With {n} training seeds, intervals understate the variation between runs."
    )


def read_table(folder: Path) -> Table:
    """Read the table of a finished comparison."""
    return Table(read_summary(folder / "summary.csv"), kept_protocol(folder), rows_of(folder / "sweeps.csv"))


def origin_of(folder: Path) -> dict[str, Any]:
    """Return commits and versions of the training runs, and some single cuts: from the runs, or as published.

    The cuts are the first ones of a script, by seed: repeating them shows whether the table belongs to the present
    physics and reward.
    """
    if (folder / _ORIGIN).is_file():
        kept: dict[str, Any] = json.loads((folder / _ORIGIN).read_text())
        return kept
    runs: list[dict[str, Any]] = [json.loads(path.read_text()) for path in sorted(folder.glob("runs/*/run.json"))]
    kind = kept_protocol(folder).training_class
    cuts = {name: rows_of(folder / "cuts" / f"{slug(name)}--{kind}.csv")[:_CUTS_KEPT] for name in SCRIPTS}
    return {
        "commits": sorted({commit for run in runs for commit in (marked(run), *run.get("resumed_at_commits", ()))}),
        "versions": runs[-1]["versions"] if runs else {},
        "returns": {name: {row["seed"]: float(row["return"]) for row in cuts[name]} for name in SCRIPTS if cuts[name]},
    }


def write_tables(folder: Path, protocol: Protocol) -> None:
    """Write summary.csv, sweeps.csv, leaderboard.md and leaderboard.html; print the table."""
    write_csv(folder / "summary.csv", [line.as_row() for line in summary(folder, protocol)])
    sweeps: list[dict[str, Any]] = sweep_lines(folder, protocol)
    if sweeps:
        write_csv(folder / "sweeps.csv", sweeps)
    text = markdown(folder)
    (folder / "leaderboard.md").write_text(text + "\n")
    write_leaderboard(folder / "leaderboard.html", folder)
    print(text)
    print(f"\nWritten to {folder}/: summary.csv, sweeps.csv, leaderboard.md, leaderboard.html")


def write_leaderboard(path: Path, folder: Path) -> None:
    """Write the page of a comparison."""
    table = read_table(folder)
    write_page_of(path, table, about(table), origin_of(folder))


def publish(folder: Path, to: Path = PUBLISHED) -> None:
    """Copy the files of a comparison from which text and page are generated."""
    found = {name: (folder / name).read_bytes() for name in _TABLES if (folder / name).is_file()}
    found[_ORIGIN] = (json.dumps(origin_of(folder), indent=1) + "\n").encode()
    shutil.rmtree(to, ignore_errors=True)
    to.mkdir(parents=True)
    for name, content in found.items():
        with atomic_write(to / name) as part:
            part.write_bytes(content)
