"""Ladders of a task that adds to gentle cutting: what one script earns with more and more of the truth."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.envs.batch import CutBatch
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS, VALIDATION_SEEDS
from cutenv.learning.statistics import by_policy, mean_with_interval
from cutenv.policy.interface import ArrayPolicy
from cutenv.task.info import GROUPS, INFO, column
from cutenv.task.registry import TASKS

START = "as the script has it"
"""Name of the first rung."""
_SAFETY = column(next(field for field in GROUPS["reward_terms"] if field.name == "safety"))


@dataclass(frozen=True, kw_only=True)
class KnowledgeLadder:
    """One task's ladder.

    A rung with a method ``watch(batch)`` is shown the batch that it cuts, and so the hidden state.
    """

    task: str
    rungs: Mapping[str, Callable[[], ArrayPolicy]]
    errors: tuple[tuple[str, str], ...]
    """Scores that the task adds [mm]: name and heading."""

    @property
    def file(self) -> Path:
        """File with one row for each rung and specimen."""
        return Path("runs") / self.task / "ladder.csv"

    def rows_of_rung(self, name: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
        """Return the scores of a rung, one row for each seed."""
        count, task, policy = len(seeds), TASKS[self.task], self.rungs[name]()
        batch = CutBatch(count, task.single(specimen_class="mixed"))
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
        scores = batch.further_scores()
        found = {
            "return": returns, "success": batch.succeeded().astype(float), "safety": safety,
            "tip_error_mm": 1e3 * np.abs(batch.cuts.states["tip"] - batch.cuts.tasks["target"]),
            **{error: scores[error] for error, _ in self.errors},
        }  # fmt: skip
        columns = [values.tolist() for values in found.values()]
        return [
            {"policy": name, "seed": seed, **dict(zip(found, values, strict=True))}
            for seed, *values in zip(seeds, *columns, strict=True)
        ]

    def measure(self, seeds: Sequence[int]) -> list[dict[str, Any]]:
        """Return one row for each rung and specimen."""
        return [row for name in self.rungs for row in self.rows_of_rung(name, seeds)]

    def report(self, rows: Sequence[Mapping[str, Any]]) -> str:
        """Return the ladder as a Markdown table."""
        each = {name: {int(row["seed"]): row for row in own} for name, own in by_policy(rows).items()}
        headings = " | ".join(heading for _, heading in self.errors)
        lines = [
            f"| the script | return | success | {headings} | charged for safety | tip error | minus the script |",
            f"| --- | --- | --- |{' --- |' * len(self.errors)} --- | --- | --- |",
        ]
        for name, own in each.items():
            value = mean_with_interval(row["return"] for row in own.values())
            gain = mean_with_interval(row["return"] - each[START][seed]["return"] for seed, row in own.items())
            difference = (
                "–" if name == START else f"{gain['mean']:+.3f} [{gain['low_95']:+.3f}, {gain['high_95']:+.3f}]"
            )
            errors = " | ".join(f"{np.mean([row[error] for row in own.values()]):.2f} mm" for error, _ in self.errors)
            success, safety = (np.mean([row[score] for row in own.values()]) for score in ("success", "safety"))
            tip = np.median([row["tip_error_mm"] for row in own.values()])
            lines.append(
                f"| {name} | {value['mean']:.3f} [{value['low_95']:.3f}, {value['high_95']:.3f}] "
                f"| {100.0 * success:.1f} % | {errors} | {-safety:.3f} | {tip:.2f} mm | {difference} |"
            )
        where = "validation" if min(each[START]) in VALIDATION_SEEDS else "held-out"
        specimens = f"{len(each[START])} {where} specimens of class mixed"
        return "\n".join([*lines, "", f"{specimens}; mean [95 % interval], median tip error."])

    def kept(self) -> list[dict[str, Any]]:
        """Return the rows of the last measurement; SystemExit if there is none."""
        if not self.file.is_file():
            raise SystemExit(f"{self.file} is missing; run 'python scripts/{self.task}_ladder.py' first.")
        return [{name: v if name == "policy" else float(v) for name, v in row.items()} for row in rows_of(self.file)]

    def run(self, about: str | None) -> None:
        """Run the command line of a script that is described by ``about``."""
        parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--specimens", type=int, default=500, metavar="N", help="number of specimens; default 500")
        parser.add_argument("--validation", action="store_true", help="cut validation specimens, print, keep nothing")
        parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
        arguments = parser.parse_args()
        if arguments.validation:
            print(self.report(self.measure(VALIDATION_SEEDS[: arguments.specimens])), flush=True)
            return
        if not arguments.print:
            rows = self.measure(TEST_SEEDS[: arguments.specimens])
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_csv(self.file, rows)
        print(self.report(self.kept()), flush=True)
