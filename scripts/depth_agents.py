"""Agents of DepthCut-v1 beside every script, by paired differences on the same held-out specimens.

    python scripts/depth_agents.py runs/NAME/policy ...     2000 specimens; writes runs/depth/agents.csv
    python scripts/depth_agents.py --print                  the table of what is in runs/depth

Each agent is one training run: the folders of several seeds show how much chance in the training does.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import by_policy, differences, mean_with_interval
from cutenv.policy.depth_scripts import DEPTH_SCRIPTS

TABLE = Path("runs") / "depth" / "agents.csv"
SHARED = {"task": "depth", "specimen_class": "mixed"}
SCORES = ("return", "success", "mean_error_mm", "layer_mm")


def measure(folders: Sequence[Path], specimens: int, processes: int | None) -> list[dict[str, Any]]:
    """Return one row for each cut of every agent and script."""
    agents = {f"PPO, run {number}": contestant(str(folder)) for number, folder in enumerate(folders, 1)}
    scripts = {name: Contestant(make()) for name, make in DEPTH_SCRIPTS.items()}
    rows = evaluate({**agents, **scripts}, TEST_SEEDS[:specimens], SHARED, processes=processes)
    return [{"policy": row["policy"], "seed": row["seed"], **{name: row[name] for name in SCORES}} for row in rows]


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the comparison as a Markdown table, and in a sentence the script that comes nearest to each agent."""
    each = by_policy(rows)
    lines = [
        "| policy | return | success | mean error of the depth | minus the script that comes nearest |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, own in each.items():
        nearest = "–"
        if name not in DEPTH_SCRIPTS:
            compared = [row for row in rows if row["policy"] == name or row["policy"] in DEPTH_SCRIPTS]
            paired = [row for row in differences(compared, name, ("return",)) if row["score"] == "return"]
            least = min(paired, key=lambda row: float(row["low_95"]))
            nearest = f"{least['mean']:+.3f} [{least['low_95']:+.3f}, {least['high_95']:+.3f}] ({least['baseline']})"
        value = mean_with_interval(row["return"] for row in own)
        lines.append(
            f"| {name} | {value['mean']:.3f} [{value['low_95']:.3f}, {value['high_95']:.3f}] "
            f"| {100.0 * np.mean([row['success'] for row in own]):.1f} % "
            f"| {np.mean([row['mean_error_mm'] for row in own]):.2f} mm | {nearest} |"
        )
    count = len({row["seed"] for row in rows})
    return "\n".join(
        [*lines, "", f"{count} held-out specimens of class mixed; mean and paired difference with 95 % interval."]
    )


def kept() -> list[dict[str, Any]]:
    """Return the rows of the last measurement; SystemExit if there is none."""
    if not TABLE.is_file():
        raise SystemExit(f"{TABLE} is missing; run 'python scripts/depth_agents.py runs/NAME/policy' first.")
    return [{name: v if name == "policy" else float(v) for name, v in row.items()} for row in rows_of(TABLE)]


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="policies of training runs")
    parser.add_argument("--specimens", type=int, default=2000, metavar="N", help="number of specimens; default 2000")
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if not arguments.print:
        if not arguments.folders:
            parser.error("give the folder of a policy, such as runs/NAME/policy, or --print")
        rows = measure(arguments.folders, arguments.specimens, arguments.processes)
        TABLE.parent.mkdir(parents=True, exist_ok=True)
        write_csv(TABLE, rows)
    print(report(kept()), flush=True)


if __name__ == "__main__":
    main()
