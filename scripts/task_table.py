"""Tables of a task that adds to gentle cutting: its scripts and its planner with truth on held-out specimens."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv.learning.evaluation import Contestant, evaluate
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import differences, summarise
from cutenv.task.registry import TASKS

ORACLE = "planner with truth"
_TEXTS = ("policy", "specimen_class", "end")


@dataclass(frozen=True, kw_only=True)
class TaskTable:
    """One task's table."""

    task: str
    errors: tuple[tuple[str, str, str], ...]
    """Scores that the task adds: name, heading, format with unit."""
    ends: tuple[tuple[str, str], ...]
    """Ends for safety that are counted: name, and what it is."""

    @property
    def file(self) -> Path:
        """File with one row for each cut."""
        return Path("runs") / self.task / f"{self.task}.csv"

    def measure(self, specimens: int, processes: int | None) -> list[dict[str, Any]]:
        """Return one row for each cut of every script and of the planner."""
        contestants = {name: Contestant(make()) for name, make in TASKS[self.task].scripts.items()}
        contestants[ORACLE] = Contestant(TASKS[self.task].planner())
        keywords = {"task": self.task, "specimen_class": "mixed"}
        return evaluate(contestants, TEST_SEEDS[:specimens], keywords, processes=processes, description=self.task)

    def lines(self, rows: Sequence[Mapping[str, Any]]) -> list[str]:
        """Return the table as lines of Markdown, and below it what there is to gain."""
        values = {(row["policy"], row["score"]): row for row in summarise(rows)}
        names = sorted(dict.fromkeys(row["policy"] for row in rows), key=lambda name: -values[name, "return"]["mean"])
        headings = " | ".join(heading for _, heading, _ in self.errors)
        lines = [
            f"| policy | return | success | {headings} | peak force | time |",
            f"| --- | --- | --- |{' --- |' * len(self.errors)} --- | --- |",
        ]
        for name in names:
            whole = values[name, "return"]
            errors = " | ".join(shown.format(values[name, score]["mean"]) for score, _, shown in self.errors)
            lines.append(
                f"| {name} | {whole['mean']:.3f} [{whole['low_95']:.3f}, {whole['high_95']:.3f}] "
                f"| {100 * values[name, 'success']['mean']:.0f} % | {errors} "
                f"| {values[name, 'peak_force_N']['mean']:.1f} N | {values[name, 'time_s']['mean']:.1f} s |"
            )
        best = next(name for name in names if name != ORACLE)
        paired = differences(rows, ORACLE, ("return",))
        lead = next(row for row in paired if row["baseline"] == best and row["score"] == "return")
        specimens = len({row["seed"] for row in rows})
        ends = [
            f"{what} in {sum(row['end'] == end and row['policy'] == best for row in rows)} cuts"
            for end, what in self.ends
        ]
        return [
            *lines,
            "",
            f"{specimens} held-out specimens of class mixed; mean [95 % interval]. The planner with truth leads the "
            f"best script, *{best}*, by {lead['mean']:.3f} [{lead['low_95']:.3f}, {lead['high_95']:.3f}]. The best "
            f"script meets {' and '.join(ends)}.",
        ]

    def kept(self) -> list[dict[str, Any]]:
        """Return the rows of the last measurement; SystemExit if there is none."""
        if not self.file.is_file():
            raise SystemExit(f"{self.file} is missing; run 'python scripts/{self.task}_table.py' first.")
        return [
            {name: value if name in _TEXTS else float(value) for name, value in row.items()}
            for row in rows_of(self.file)
        ]

    def run(self, about: str | None, draw: Callable[[Path], None]) -> None:
        """Run the command line of a script that is described by ``about`` and draws a picture."""
        parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--specimens", type=int, default=500, metavar="N", help="number of specimens; default 500")
        parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
        parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
        parser.add_argument("--picture", type=Path, metavar="FILE", help="draw two cuts, and stop")
        arguments = parser.parse_args()
        if arguments.picture is not None:
            draw(arguments.picture)
            return
        if not arguments.print:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_csv(self.file, self.measure(arguments.specimens, arguments.processes))
        print("\n".join(self.lines(self.kept())))
