"""Baseline table: every baseline on 500 specimens of each class, with the present and the earlier reward of v1.

    python -m scripts.benchmarks.policies.baseline_table         a quarter of an hour on 2 cores; writes runs/baselines/

It shows how much there is to learn: the gap between the best script and the planner that knows the truth.

The earlier reward charged the tip error at the end, where the present one has gains for accuracy and success.  Every
cut is made once and rewarded twice: those of the planner that knows the truth are planned for the present reward.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv.agents.learning.evaluation import Contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import differences, summarise
from cutenv.agents.policy import (
    BASELINES,
    CONSTANT_FEEDS,
    GRID_ANGLES,
    GRID_SPEEDS,
    NULL_POLICIES,
    ORACLE,
    SCRIPTS,
    feed_name,
)
from cutenv.sim.quantities import TIME_SCALE
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.reward import SAFETY_ENDS, WORST_STORED, RewardWeights
from scripts import ROOT
from scripts.tables import interval_text, keep, kept_rows

FOLDER = Path("runs") / "baselines"
DEADLINE = 30.0  # [s]
EARLIER = {  # weights of the earlier reward's costs; progress had 1
    "uncontrolled": 0.15, "jump": 0.05, "force": 0.02, "lag": 0.03, "backward": 0.15, "haste": 0.1, "time": 0.15,
    "wedge": 0.2, "stored": 0.1,
}  # fmt: skip
EARLIER_TIP_ERROR = 0.2  # its cost of the tip error at the end, per 3 mm up to 9 mm


def earlier_return(row: Mapping[str, Any]) -> float:
    """Return the return of a cut under the earlier reward, from its terms under the present one."""
    present = dataclasses.asdict(RewardWeights())
    total = float(row["reward_progress"]) / present["progress"]
    for name, weight in EARLIER.items():
        total += float(row[f"reward_{name}"]) * weight / present[name]
    total -= EARLIER_TIP_ERROR * min(float(row["tip_error_mm"]) / 3.0, 3.0)
    if row["end"] in SAFETY_ENDS:
        time_left = max(DEADLINE - float(row["time_s"]), 0.0)
        total -= EARLIER["time"] * time_left / TIME_SCALE
        total -= 3.0 * EARLIER_TIP_ERROR + EARLIER["wedge"] + EARLIER["stored"] * WORST_STORED
    return total


def measure(specimen_class: str, specimens: int, processes: int | None) -> list[dict[str, Any]]:
    """Return one row per cut: its scores, with ``earlier_return`` besides ``return``."""
    contestants = {name: Contestant(make()) for name, make in BASELINES.items()}
    keywords = {"specimen_class": specimen_class}
    rows = evaluate(contestants, TEST_SEEDS[:specimens], keywords, processes=processes, description=specimen_class)
    return [row | {"earlier_return": earlier_return(row)} for row in rows]


def table(rows: Sequence[Mapping[str, Any]], score: str) -> dict[str, Mapping[str, Any]]:
    """Return mean and interval of a score, by policy."""
    return {row["policy"]: row for row in summarise(rows) if row["score"] == score}


def best(values: Mapping[str, Mapping[str, Any]], names: Sequence[str]) -> str:
    """Return the name with the highest mean."""
    return max(names, key=lambda name: values[name]["mean"])


def findings(rows: Sequence[Mapping[str, Any]], score: str) -> list[str]:
    """Return sentences about the properties that the task must have."""
    values, success, scripts = table(rows, score), table(rows, "success"), [*CONSTANT_FEEDS, *SCRIPTS]
    constant, script = best(values, list(CONSTANT_FEEDS)), best(values, scripts)
    surest = best(success, scripts)
    rank = 1 + sum(success[name]["mean"] > success[script]["mean"] for name in scripts)
    lead = next(
        row for row in differences(rows, ORACLE, (score,)) if row["baseline"] == script and row["score"] == score
    )
    width = values[script]["high_95"] - values[script]["low_95"]
    finished = [row for row in rows if row["end"] == "finished" and row["policy"] != ORACLE]
    nothing = max(float(row[score]) for row in rows if row["policy"] == "nothing")
    below = sum(float(row[score]) <= nothing for row in finished)
    worst = min(float(row[score]) for row in finished)
    ends = [row["end"] for row in rows if row["policy"] == ORACLE]
    corner = feed_name(max(GRID_SPEEDS), min(GRID_ANGLES))
    return [
        f"best constant feed: {constant}, {values[constant]['mean']:.3f}"
        + (" (the corner)" if constant == corner else f"; the corner {values[corner]['mean']:.3f}"),
        f"best script: {script}, {values[script]['mean']:.3f}",
        f"best success of a script: {surest}, {success[surest]['mean']:.3f}; the best script's is "
        f"{success[script]['mean']:.3f}, rank {rank} of {len(scripts)}",
        f"the planner with truth leads it by {interval_text(lead)}, "
        f"{lead['mean'] / width:.1f} widths of the script's interval",
        f"finished cuts that score no better than doing nothing ({nothing:.3f}): {below} of {len(finished)}; "
        f"the worst scores {worst:.3f}",
        f"the planner with truth meets the force limit in {ends.count('force_limit')} of {len(ends)} cuts",
    ]


def grid_lines(values: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the speed x angle grid of mean returns as lines of text."""
    lines = ["constant feed [cm/s]".ljust(22) + "".join(f"{speed:9.2f}" for speed in GRID_SPEEDS)]
    for angle in GRID_ANGLES:
        cells = [values[feed_name(speed, angle)]["mean"] for speed in GRID_SPEEDS]
        lines.append(f"{angle:19d} deg" + "".join(f"{cell:9.3f}" for cell in cells))
    return lines


def report(rows: Sequence[Mapping[str, Any]], specimen_class: str) -> str:
    """Return the tables of one class as text."""
    cuts = len({row["seed"] for row in rows})
    lines = [f"class {specimen_class}, {cuts} specimens, mean [95 % interval]", ""]
    columns = {
        "return": "return",
        "earlier_return": "as before",
        "success": "success",
        "tip_error_mm": "tip error [mm]",
    }
    values = {score: table(rows, score) for score in columns}
    chosen = [*SCRIPTS, best(values["return"], list(CONSTANT_FEEDS)), ORACLE, *NULL_POLICIES]
    lines.append("".ljust(28) + "".join(title.rjust(25) for title in columns.values()))
    for name in sorted(chosen, key=lambda name: -values["return"][name]["mean"]):
        lines.append(name.ljust(28) + "".join(interval_text(values[score][name]).rjust(25) for score in columns))
    for score, title in (("earlier_return", "as before"), ("return", "as it is")):
        lines += ["", f"rewards {title}"] + [f"  {line}" for line in findings(rows, score)]
        lines += [f"  {line}" for line in grid_lines(values[score])]
    return "\n".join(lines)


def kept(folder: Path, specimen_class: str) -> list[dict[str, Any]]:
    """Return the rows of an earlier measurement; SystemExit if there is none."""
    return kept_rows(
        folder / f"{specimen_class}.csv",
        "scripts.benchmarks.policies.baseline_table",
        ("policy", "specimen_class", "end"),
    )


def kept_report() -> str:
    """Return the tables of all classes that were measured, as a block of code."""
    measured = [name for name in reversed(CLASSES) if (ROOT / FOLDER / f"{name}.csv").is_file()]
    tables = [report(kept(ROOT / FOLDER, name), name) for name in measured or CLASSES]
    return "```\n" + "\n\n".join(tables) + "\n```"


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=500, metavar="N", help="specimens of each class; default 500")
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=list(CLASSES), help="classes; default all")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--print", action="store_true", help="print the kept tables without measuring again")
    arguments = parser.parse_args()
    for specimen_class in arguments.classes:
        if not arguments.print:
            rows = measure(specimen_class, arguments.specimens, arguments.processes)
            keep(arguments.out / f"{specimen_class}.csv", rows)
        print("\n" + report(kept(arguments.out, specimen_class), specimen_class), flush=True)


if __name__ == "__main__":
    main()
