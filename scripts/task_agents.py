"""Agents of DepthCut-v1 or PathCut-v1 beside every script, by paired differences on the same held-out specimens.

    python scripts/task_agents.py path runs/NAME/policy ...    2000 specimens; writes runs/path/agents.csv
    python scripts/task_agents.py path --print                 the table of what is in runs/path

Each agent is one training run: the folders of several seeds show how much chance in the training does.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import depth_table
import numpy as np
import path_table
from task_table import TaskTable

from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import by_policy, differences, mean_with_interval
from cutenv.task.registry import TASKS

TABLES: dict[str, TaskTable] = {"depth": depth_table.TABLE, "path": path_table.TABLE}


def file_of(task: str) -> Path:
    """Return the file with one row for each cut."""
    return TABLES[task].file.with_name("agents.csv")


def measure(task: str, folders: Sequence[Path], specimens: int, processes: int | None) -> list[dict[str, Any]]:
    """Return one row for each cut of every agent and script."""
    table, known = TABLES[task], TASKS[task].scripts
    agents = {f"PPO, run {number}": contestant(str(folder)) for number, folder in enumerate(folders, 1)}
    scripts = {name: Contestant(make()) for name, make in known.items()}
    shared = {"task": task, "specimen_class": "mixed"}
    rows = evaluate({**agents, **scripts}, TEST_SEEDS[:specimens], shared, processes=processes)
    scores = ("return", "success", *(name for name, _, _ in table.errors))
    return [{"policy": row["policy"], "seed": row["seed"], **{name: row[name] for name in scores}} for row in rows]


def report(task: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the comparison as a Markdown table, with the script that comes nearest to each agent."""
    scripts, (error, heading, shown) = TASKS[task].scripts, TABLES[task].errors[0]
    lines = [
        f"| policy | return | success | {heading} | minus the script that comes nearest |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, own in by_policy(rows).items():
        nearest = "–"
        if name not in scripts:
            compared = [row for row in rows if row["policy"] == name or row["policy"] in scripts]
            paired = [row for row in differences(compared, name, ("return",)) if row["score"] == "return"]
            least = min(paired, key=lambda row: float(row["low_95"]))
            nearest = f"{least['mean']:+.3f} [{least['low_95']:+.3f}, {least['high_95']:+.3f}] ({least['baseline']})"
        value = mean_with_interval(row["return"] for row in own)
        lines.append(
            f"| {name} | {value['mean']:.3f} [{value['low_95']:.3f}, {value['high_95']:.3f}] "
            f"| {100.0 * np.mean([row['success'] for row in own]):.1f} % "
            f"| {shown.format(np.mean([row[error] for row in own]))} | {nearest} |"
        )
    count = len({row["seed"] for row in rows})
    return "\n".join(
        [*lines, "", f"{count} held-out specimens of class mixed; mean and paired difference with 95 % interval."]
    )


def kept(task: str) -> list[dict[str, Any]]:
    """Return the rows of the last measurement; SystemExit if there is none."""
    file = file_of(task)
    if not file.is_file():
        raise SystemExit(f"{file} is missing; run 'python scripts/task_agents.py {task} runs/NAME/policy' first.")
    return [{name: v if name == "policy" else float(v) for name, v in row.items()} for row in rows_of(file)]


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=list(TABLES), help="the task that they learned")
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="policies of training runs")
    parser.add_argument("--specimens", type=int, default=2000, metavar="N", help="number of specimens; default 2000")
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if not arguments.print:
        if not arguments.folders:
            parser.error("give the folder of a policy, such as runs/NAME/policy, or --print")
        rows = measure(arguments.task, arguments.folders, arguments.specimens, arguments.processes)
        file_of(arguments.task).parent.mkdir(parents=True, exist_ok=True)
        write_csv(file_of(arguments.task), rows)
    print(report(arguments.task, kept(arguments.task)), flush=True)


if __name__ == "__main__":
    main()
