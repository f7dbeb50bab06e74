"""Table of a benchmark, as Markdown and as a page, made from its kept cuts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cutenv.agents.learning.benchmark import Protocol
from cutenv.agents.learning.statistics import rows_of, write_csv
from cutenv.commands.submit import checked
from scripts import ROOT
from scripts.benchmarks.leaderboard.aggregate import ALL, read_summary, summary, sweep_lines
from scripts.benchmarks.leaderboard.kept_cuts import merge_cuts, read_facts, read_runs, write_run
from scripts.benchmarks.leaderboard.page import write_page_of
from scripts.benchmarks.leaderboard.protocol import ENTRIES, SCRIPTED, keep_protocol, kept_protocol, slug
from scripts.benchmarks.leaderboard.summary import AS_BEGUN, Table
from scripts.tables import markdown_table

PUBLISHED = ROOT / "assets" / "benchmark"  # folder of the published comparison


def markdown(folder: Path = PUBLISHED) -> str:
    """Return the block of the documentation: main table, verdicts, origins, classes, ablations, robustness."""
    table = read_table(folder)
    parts = [about(table), markdown_table(*table.main())]
    if table.verdicts():
        parts.append("\n".join(f"- {sentence}" for sentence in table.verdicts()))
    for title, content in (
        ("Who made them, and what training cost", table.origins()),
        ("Return on every class of specimens", table.classes()),
        ("What each ablation costs", table.ablations()),
        ("Return where a constant is not what it was in training", table.robustness()),
    ):
        if content[1]:
            parts += [f"{title}:", markdown_table(*content)]
    return "\n\n".join(parts)


def about(table: Table) -> str:
    """Return one paragraph that explains the numbers."""
    p = table.protocol
    learned = [name for name in table.contestants if name not in SCRIPTED]
    sentences = [
        f"Protocol {p.version} of {p.environment}: {p.specimens} held-out specimens of class {p.training_class}. "
        "Interquartile means (IQM) with 95 % stratified bootstrap intervals, whose resamples draw training seeds and, "
        "crossed with them, specimens; success, cost and overshoot are means. Differences are means, paired by "
        "specimen. Each kind has ranks of its own. Policies that made the same cuts to the last digit are one row.",
        f"'{ALL}' averages the pure classes (uniform, liver, vascular).",
    ]
    if learned:
        sentences.append(
            "The return after a number of cuts is the best one by then on validation specimens, with the least and the "
            "greatest of the runs; demonstrations count as cuts, and a dash stands where nothing was learned by then."
        )
    if any(table.as_begun(name) for name in learned):
        sentences.append(
            f"An agent whose validation threw all of its training by trial away is '{AS_BEGUN}' and has no rank."
        )
    if any("digest" in own for name in learned for own in table.facts.get(name, ())):
        sentences.append(
            "Entries by others cut specimens that are drawn from their own files, and so does the script that they are "
            "compared with."
        )
    if any(table.seeds(name).endswith("*") for name in learned):
        sentences.append("A star marks rows with fewer training runs than the protocol wants.")
    if table.not_yet_run():
        sentences.append(f"Not yet run: {', '.join(table.not_yet_run())}.")
    return " ".join(sentences)


def read_table(folder: Path) -> Table:
    """Read the table of a comparison, finished or not."""
    sweeps = rows_of(folder / "sweeps.csv")
    return Table(read_summary(folder / "summary.csv"), kept_protocol(folder), sweeps, read_facts(folder))


def summarise_cuts(folder: Path, protocol: Protocol) -> None:
    """Write summary.csv from the kept cuts."""
    write_csv(folder / "summary.csv", [line.as_row() for line in summary(read_runs(folder, protocol), protocol)])


def write_tables(folder: Path, protocol: Protocol) -> None:
    """Write summary.csv, sweeps.csv, leaderboard.md and leaderboard.html; print the table."""
    summarise_cuts(folder, protocol)
    sweeps = sweep_lines(folder, protocol)
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
    write_page_of(path, table, about(table))


def publish(folder: Path, to: Path = PUBLISHED) -> None:
    """Merge a comparison, finished or not, into the published one: its cuts replace older ones of the same runs."""
    protocol = kept_protocol(folder)
    keep_protocol(to, protocol)
    merge_cuts(folder, to, replace=True)
    swept = rows_of(folder / "sweeps.csv")
    again = {row["contestant"] for row in swept}
    kept = [row for row in rows_of(to / "sweeps.csv") if row["contestant"] not in again]
    if swept:
        write_csv(to / "sweeps.csv", kept + swept)
    summarise_cuts(to, protocol)


def add_submission(path: Path, to: Path = PUBLISHED, policies: Sequence[str] = ()) -> None:
    """Repeat every cut of a submission, by its policies if given, and add it; ValueError if it is no entry."""
    protocol = kept_protocol(to)
    entry, runs, script = checked(path, policies)
    if entry.protocol != protocol:
        raise ValueError(f"{path} is of protocol {entry.protocol.version}, not {protocol.version}: it is no entry.")
    taken = {slug(name) for name in (*ENTRIES, *SCRIPTED, *read_facts(to))}
    if not slug(entry.policy) or slug(entry.policy) in taken:
        raise ValueError(f"{path}: the name {entry.policy!r} is taken; submit it with another --name.")
    for number, (rows, run) in enumerate(zip(runs, entry.runs, strict=True)):
        facts = {"contestant": entry.policy, "training_seed": number, "author": entry.author, "date": entry.date}
        facts |= {"code": entry.code or "–", "returns_after_cuts": dict(run.after), "kind": entry.kind}
        facts |= {"digest": entry.digest, "salt": entry.salt}
        cuts = {protocol.training_class: rows} | ({} if number else {protocol.script: script})
        write_run(to, facts, cuts, protocol.training_class)
    summarise_cuts(to, protocol)
