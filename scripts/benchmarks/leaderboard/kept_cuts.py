"""Cuts of a benchmark as they are kept: one small file for each run of a contestant, from which any machine goes on."""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv._base.output import atomic_write
from cutenv.agents.learning.benchmark import Protocol, entry_seeds
from scripts.benchmarks.leaderboard.protocol import slug

Row = dict[str, str]

DIGITS = {  # scores of the headline's cuts, with their digits after the point; no interval is as narrow
    "return": 4, "success": 0, "tip_error_mm": 2, "peak_force_N": 2, "largest_jump_mm": 2, "cost_mm": 2,
    "overshoot_mm": 2, "time_s": 1,
}  # fmt: skip
EVERY_CLASS = ("return", "success")  # scores of the cuts of the other classes


@dataclass(frozen=True)
class KeptRun:
    """Cuts of a script, or of an agent with one training seed.

    ``facts`` has ``contestant``, ``training_seed`` (None: a script), ``author``, ``date``, ``code``; of a training run
    also ``training_minutes``, ``training_decisions``, ``returns_after_cuts`` and ``kept_its_start``; of an entry
    ``kind``, and ``digest`` and ``salt`` that its specimens are drawn from. The cuts of each class are in the order of
    their seeds; with an entry there are also, by the name of the protocol's script, those that this made of the entry's
    specimens.
    """

    facts: dict[str, Any]
    by_class: dict[str, list[Row]]


def file_of(folder: Path, contestant: str, training_seed: int | None) -> Path:
    """Return the path of a run's cuts."""
    return folder / "cuts" / f"{slug(contestant)}{'' if training_seed is None else f'-seed{training_seed}'}.csv.gz"


def write_run(
    folder: Path, facts: Mapping[str, Any], rows: Mapping[str, Sequence[Mapping[str, Any]]], headline: str
) -> None:
    """Write a run: its facts in the first line, then its cuts."""
    text = io.StringIO()
    text.write(f"# {json.dumps(facts)}\n")
    names = ["class", "seed", "specimen_class", *DIGITS]
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    for kind, cuts in rows.items():
        scores = DIGITS if kind == headline else EVERY_CLASS
        for cut in cuts:
            kept = {name: f"{float(cut[name]):.{DIGITS[name]}f}" for name in scores if cut.get(name, "") != ""}
            writer.writerow({"class": kind, "seed": cut["seed"], "specimen_class": cut["specimen_class"], **kept})
    path = file_of(folder, facts["contestant"], facts["training_seed"])
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as part:
        part.write_bytes(gzip.compress(text.getvalue().encode(), 9, mtime=0))


def read_run(path: Path, protocol: Protocol) -> KeptRun:
    """Read a run; SystemExit if the file is damaged, or holds other specimens than the protocol."""
    try:
        first, _, rest = gzip.decompress(path.read_bytes()).decode().partition("\n")
        facts = json.loads(first.removeprefix("# "))
        by_class: dict[str, list[Row]] = {}
        for row in csv.DictReader(io.StringIO(rest)):
            by_class.setdefault(row["class"], []).append(row)
    except (OSError, EOFError, ValueError, KeyError) as error:
        raise SystemExit(f"{path} is damaged ({error}); delete it, and cut again.") from None
    own = "digest" in facts
    seeds = entry_seeds(facts["digest"], protocol, facts["salt"]) if own else list(protocol.test_seeds)
    for kind, rows in by_class.items():
        if [int(row["seed"]) for row in rows] != seeds:
            raise SystemExit(f"{path} holds other specimens of class {kind} than the protocol; cut them again.")
    return KeptRun(facts, by_class)


def read_runs(folder: Path, protocol: Protocol) -> dict[str, list[KeptRun]]:
    """Return the runs of every contestant, by training seed."""
    found: dict[str, list[KeptRun]] = {}
    for path in sorted((folder / "cuts").glob("*.csv.gz")):
        run = read_run(path, protocol)
        if protocol.training_class in run.by_class:
            found.setdefault(run.facts["contestant"], []).append(run)
    for runs in found.values():
        runs.sort(key=lambda run: run.facts["training_seed"] or 0)
    return found


def merge_cuts(source: Path, target: Path, *, replace: bool) -> int:
    """Copy the cuts of one folder to another; return their number of files."""
    (target / "cuts").mkdir(parents=True, exist_ok=True)
    copied = 0
    for path in sorted((source / "cuts").glob("*.csv.gz")):
        own = target / "cuts" / path.name
        if replace or not own.is_file():
            with atomic_write(own) as part:
                part.write_bytes(path.read_bytes())
            copied += 1
    return copied


def read_facts(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the facts of the runs of every contestant, and the digest of their ``cuts``: equal cuts, equal digests."""
    found: dict[str, list[dict[str, Any]]] = {}
    for path in sorted((folder / "cuts").glob("*.csv.gz")):
        first, _, rest = gzip.decompress(path.read_bytes()).partition(b"\n")
        facts = json.loads(first.decode().removeprefix("# "))
        found.setdefault(facts["contestant"], []).append({**facts, "cuts": hashlib.sha256(rest).hexdigest()})
    return found
