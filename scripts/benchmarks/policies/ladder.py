"""Ladder of information: what the same script earns with the mean tissue, with what it infers, and with the truth.

    python -m scripts.benchmarks.policies.ladder                  1000 held-out specimens, some five minutes on 2 cores
    python -m scripts.benchmarks.policies.ladder --specimen-class liver
                                                                without tough inclusions; writes runs/ladder/liver.csv

Every rung is the script "return stroke" with other knowledge, but for probe and creep and the planner that knows the
tissue (the oracle).  The steps between the rungs say how much of the gap between them is information: stiffness and
friction, the resistance ahead of which a run is predicted, the hidden tip, and the tissue that lies ahead.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv.agents.learning.evaluation import Contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import by_policy
from cutenv.agents.policy import BASELINES, ORACLE, OneReturnStroke, StopAndUnload, TipEstimate
from cutenv.agents.policy.interface import ArrayPolicy
from cutenv.envs.vector import CutBatch
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.info import GROUPS, INFO, column
from cutenv.task.registry import TASKS
from scripts.tables import keep, kept_rows, mean_text

FOLDER = Path("runs") / "ladder"
CLASS = "mixed"
NEVER = 10.0  # multiples of the resistance: no tip counts as held
START, SCRIPT = "probe and creep", "and giving up before a predicted run"
SCORES = ("return", "success", "tip_error_mm")
_SAFETY = column(next(field for field in GROUPS["reward_terms"] if field.name == "safety"))


class TrueTip(TipEstimate):
    """An estimator that is told the hidden tip, beside what it infers of the rest."""

    batch: CutBatch

    def estimates(self, seen: Array) -> StructArray:
        """Return the estimates with the tip as it is."""
        estimates = super().estimates(seen)
        estimates["tip"] = self.batch.cuts.states["tip"]
        return estimates


class ToldTheTip(OneReturnStroke):
    """The script that knows the tip at every decision; it needs no return stroke."""

    def __init__(self, held: float) -> None:
        self._told = TrueTip()
        unloading = StopAndUnload(margin=-0.0005, retreat_speed=0.012, tip_estimate=self._told)
        super().__init__(approach=0.0, held=held, unloading=unloading)

    def watch(self, batch: CutBatch) -> None:
        """Let the script see the hidden state of a batch."""
        self._told.batch = batch


RUNGS = {
    "mean tissue": lambda: OneReturnStroke(approach=0.0, held=NEVER),
    START: BASELINES[START],
    "stiffness and friction by a return stroke": lambda: OneReturnStroke(held=NEVER),
    SCRIPT: OneReturnStroke,
    "true tip": lambda: ToldTheTip(NEVER),
    "true tip, and giving up": lambda: ToldTheTip(1.3),
    ORACLE: BASELINES[ORACLE],
}


def rows_of_rung(
    policy: ArrayPolicy, name: str, seeds: Sequence[int], task: str = "gentle", specimen_class: str = CLASS
) -> list[dict[str, Any]]:
    """Return the scores of a script, one row for each seed; a method ``watch(batch)`` is shown the hidden state."""
    count = len(seeds)
    arguments = getattr(policy, "environment_arguments", {})
    batch = CutBatch(count, TASKS[task].single(specimen_class=specimen_class, **arguments))
    batch.give_seeds(seeds, np.arange(count), np.random.default_rng())
    batch.begin(np.arange(count))
    policy.begin([np.random.default_rng(seed) for seed in seeds])
    if hasattr(policy, "watch"):
        policy.watch(batch)
    infos, ends = np.zeros(count, INFO), np.zeros(count, np.int64)
    returns, safety = np.zeros(count), np.zeros(count)
    while not ends.all():
        going = ends == 0
        rewards, ended = batch.decide(policy.act(batch.observations), ~going, infos)
        returns[going] += rewards[going]
        safety[going] += infos[_SAFETY][going]
        ends += ended
    found = {
        "return": returns, "success": batch.succeeded().astype(float), "safety": safety,
        "tip_error_mm": 1e3 * np.abs(batch.cuts.states["tip"] - batch.cuts.tasks["target"]),
        **batch.further_scores(),
    }  # fmt: skip
    columns = [values.tolist() for values in found.values()]
    return [
        {"policy": name, "seed": seed, **dict(zip(found, values, strict=True))}
        for seed, *values in zip(seeds, *columns, strict=True)
    ]


def measure(specimens: int, processes: int | None, specimen_class: str = CLASS) -> list[dict[str, Any]]:
    """Return one row for each rung and specimen."""
    seeds, arguments = list(TEST_SEEDS[:specimens]), {"specimen_class": specimen_class}
    inferring = {name: Contestant(make()) for name, make in RUNGS.items() if "true tip" not in name}
    found = by_policy(evaluate(inferring, seeds, arguments, processes=processes, description="ladder"))
    rows = []
    for name, make in RUNGS.items():
        own = rows_of_rung(make(), name, seeds, specimen_class=specimen_class) if name not in found else found[name]
        rows += [{"policy": name, "seed": row["seed"], **{score: row[score] for score in SCORES}} for row in own]
    return rows


def interquartile_mean(values: Sequence[float]) -> float:
    """Return the mean of the middle half."""
    ordered = np.sort(values)
    quarter = len(ordered) // 4
    return float(ordered[quarter : len(ordered) - quarter].mean())


def report(rows: Sequence[Mapping[str, Any]], specimen_class: str = CLASS) -> str:
    """Return the ladder as a Markdown table."""
    each = {name: {int(row["seed"]): row for row in own} for name, own in by_policy(rows).items()}
    first, last = (np.mean([row["return"] for row in each[name].values()]) for name in (START, ORACLE))
    lines = [
        "| the script knows | return | IQM | success [%] | tip error [mm] | return minus probe and creep "
        "| share of the way to the oracle |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, own in each.items():
        returns = [row["return"] for row in own.values()]
        gain = mean_text((row["return"] - each[START][seed]["return"] for seed, row in own.items()), sign="+")
        lines.append(
            f"| {name} | {mean_text(returns)} | {interquartile_mean(returns):.3f} "
            f"| {100.0 * np.mean([row['success'] for row in own.values()]):.1f} "
            f"| {np.median([row['tip_error_mm'] for row in own.values()]):.2f} | {'–' if name == START else gain} "
            f"| {100.0 * (np.mean(returns) - first) / (last - first):.0f} % |"
        )
    count = len(each[START])
    return "\n".join(
        [f"Class {specimen_class}, {count} held-out specimens; mean [95 % interval], median tip error.", "", *lines]
    )


def file_of(specimen_class: str) -> str:
    """Return the name of the file of a class."""
    return "ladder.csv" if specimen_class == CLASS else f"{specimen_class}.csv"


def memory_report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return what more knowledge earns without tough inclusions, as a Markdown table: no memory earns more."""
    each = {name: {int(row["seed"]): row for row in own} for name, own in by_policy(rows).items()}
    lines = ["| knowledge | return minus that of the script without it |", "| --- | --- |"]
    for known, name in (("the tip", "true tip, and giving up"), ("all of the truth (the planner)", ORACLE)):
        gain = (row["return"] - each[SCRIPT][seed]["return"] for seed, row in each[name].items())
        lines.append(f"| {known} | {mean_text(gain, sign='+')} |")
    return "\n".join([*lines, "", f"{len(each[SCRIPT])} held-out specimens of class liver; mean [95 % interval]."])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=1000, metavar="N", help="held-out specimens; default 1000")
    parser.add_argument("--specimen-class", choices=CLASSES, default=CLASS, help=f"class of specimens; default {CLASS}")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    kind, file = arguments.specimen_class, arguments.out / file_of(arguments.specimen_class)
    if not arguments.print:
        rows = measure(arguments.specimens, arguments.processes, kind)
        keep(file, rows)
    print(report(kept_rows(file, "scripts.benchmarks.policies.ladder"), kind), flush=True)
