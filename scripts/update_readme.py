"""Print every number of the README: rewrite the blocks between its markers, or check them.

    python scripts/update_readme.py parameters agreement specimens calibration speed headroom
    python scripts/update_readme.py training --runs runs/NAME ...  one run for each seed
    python scripts/update_readme.py benchmark                   what scripts/leaderboard.py --publish has kept
    python scripts/update_readme.py rig-faults rig-soak            what their scripts left in runs/ (--json)
    python scripts/update_readme.py --check parameters          fails if a block is not what it would print
    python scripts/update_readme.py --picture                   draws assets/pictures/cut.png

A block stands between ``<!-- NAME -->`` and ``<!-- /NAME -->``.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import baseline_table as headroom
import gymnasium
import leaderboard
import numpy as np
import rig_faults
import rig_soak

from cutenv.cutting.drive import Rig
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import SensorParameters
from cutenv.envs.constants import Knowledge
from cutenv.learning.statistics import mean_with_interval
from cutenv.parameter import parameter_table
from cutenv.policy import BOUND, GRID, SCRIPTS, ConstantFeed
from cutenv.report import draw_cut
from cutenv.task.weights import Limits
from cutenv.tissue import measured_liver
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.specimen import CLASSES

ROOT = Path(__file__).parents[1]
SCORES = ("return", "success", "tip_error_mm", "peak_force_N", "time_s")


def markdown(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def parameters(_: argparse.Namespace) -> str:
    """Every constant of tissue, law, drive, sensor and task, with provenance."""
    liver = measured_liver()
    rows = []
    for row in parameter_table(TissueDescription, LawParameters, Rig, SensorParameters, Knowledge, Limits):
        value = getattr(liver, row["name"], row["default"])
        sweep = "" if row["sweep"] is None else f"{row['sweep'][0]:.4g} to {row['sweep'][1]:.4g}"
        rows.append((f"`{row['name']}`", f"{value:.4g}", row["unit"], row["provenance"], row["why"], sweep))
    return markdown(("constant", "default", "unit", "provenance", "source or reason", "sweep"), rows)


def agreement(_: argparse.Namespace) -> str:
    """What the thesis and independent calculations say, beside ours."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "agreement.md"
        program = [sys.executable, str(ROOT / "scripts" / "reproduce_thesis.py"), "--out", folder]
        subprocess.run([*program, "--markdown", str(table)], check=True, stdout=subprocess.DEVNULL)
        return table.read_text().strip()


def speed(_: argparse.Namespace) -> str:
    """What ``scripts/bench.py`` prints on this machine."""
    program = [sys.executable, str(ROOT / "scripts" / "bench.py")]  # a fresh process: no threads yet, nothing loaded
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    return "```\n" + done.stdout.rstrip() + "\n```"


def specimens(_: argparse.Namespace) -> str:
    """What ``scripts/fit_specimens.py`` prints: virtual measurement of drawn specimens beside the tables."""
    program = [sys.executable, str(ROOT / "scripts" / "fit_specimens.py"), "--livers", "150"]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True)
    return "```\n" + done.stdout.strip() + "\n```"


def calibration(_: argparse.Namespace) -> str:
    """What ``scripts/calibrate_virtual_rig.py`` finds beside what it put in."""
    program = [sys.executable, str(ROOT / "scripts" / "calibrate_virtual_rig.py")]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return "```\n" + done.stdout.partition("4. Beside what was put in:\n")[2].strip("\n") + "\n```"


def read_csv(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file; SystemExit with the cure where there is none."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; give the folder of a finished run with --runs, or make it first.")
    with path.open() as file:
        return list(csv.DictReader(file))


def interval(row: dict[str, str], digits: int = 2) -> str:
    """A mean and its interval."""
    mean, low, high = (f"{float(row[name]):.{digits}f}" for name in ("mean", "low_95", "high_95"))
    return f"{mean} [{low}, {high}]"


def training(arguments: argparse.Namespace) -> str:
    """The evaluation of training runs, one for each seed, from their summary.csv and differences.csv."""
    if not arguments.runs:
        raise SystemExit("training needs --runs runs/NAME ..., the folders of finished training runs.")
    return "\n\n".join((compared(arguments.runs[0]), each_seed(arguments.runs)))


def compared(run: Path) -> str:
    """The agent of one run beside the scripts."""
    values = {(row["policy"], row["score"]): row for row in read_csv(run / "summary.csv")}
    paired = read_csv(run / "differences.csv")
    shown = [paired[0]["policy"], *dict.fromkeys(row["baseline"] for row in paired)]
    shown.sort(key=lambda policy: -float(values[policy, "return"]["mean"]))
    rows = [(policy, *(interval(values[policy, score]) for score in SCORES)) for policy in shown]
    return markdown(("policy", "return", "success", "tip error [mm]", "peak force [N]", "time [s]"), rows)


def each_seed(runs: list[Path]) -> str:
    """What each training seed came to, against the best script and the bound."""
    rows = []
    for run in runs:
        facts = json.loads((run / "run.json").read_text())
        values = {(row["policy"], row["score"]): row for row in read_csv(run / "summary.csv")}
        paired = {(row["baseline"], row["score"]): row for row in read_csv(run / "differences.csv")}
        agent = next(iter(paired.values()))["policy"]
        script = max(
            {name for name, _ in paired} & {*GRID, *SCRIPTS}, key=lambda name: float(values[name, "return"]["mean"])
        )
        rows.append(
            (
                str(facts["arguments"]["seed"]),
                interval(values[agent, "return"], 3),
                interval(values[agent, "success"]),
                script,
                interval(paired[script, "return"], 3),
                interval(paired[script, "success"]),
                interval(paired[BOUND, "return"], 3),
                level(facts),
            )
        )
    if len(runs) > 1:
        rows.append(("all", "", "", script, interval(together(runs, agent, script), 3), "", "", ""))
    differences = ("agent minus script: return", "success", "agent minus bound")
    return markdown(("seed", "return", "success", "best script", *differences, "level after [min], of"), rows)


def level(facts: dict[str, Any]) -> str:
    """After which time the agent was level with its teacher on validation specimens, and how long it was trained."""
    seconds = facts.get("level_with_script_after_s", "not measured")
    known = "never" if seconds is None else seconds if isinstance(seconds, str) else f"{seconds / 60.0:.1f}"
    return f"{known}, {facts.get('training_minutes', 'unknown')}"


def together(runs: list[Path], agent: str, script: str) -> dict[str, str]:
    """Paired difference of the return, averaged over the runs before the interval over specimens is taken."""
    by_seed: dict[str, list[float]] = {}
    for run in runs:
        scores = {(row["policy"], row["seed"]): float(row["return"]) for row in read_csv(run / "scores.csv")}
        for policy, seed in scores:
            if policy == agent:
                by_seed.setdefault(seed, []).append(scores[agent, seed] - scores[script, seed])
    assert all(len(values) == len(runs) for values in by_seed.values()), "runs of different specimens"
    pooled = mean_with_interval(np.mean(values) for values in by_seed.values())
    return {name: str(value) for name, value in pooled.items()}


def headroom_block(_: argparse.Namespace) -> str:
    """What ``scripts/baseline_table.py`` has measured."""
    printed = []
    measured = [name for name in reversed(CLASSES) if (ROOT / headroom.FOLDER / f"{name}.csv").is_file()]
    for specimen_class in measured or CLASSES:
        rows = headroom.kept(ROOT / headroom.FOLDER, specimen_class)
        printed.append(headroom.report(rows, specimen_class))
    return "```\n" + "\n\n".join(printed) + "\n```"


def benchmark(_: argparse.Namespace) -> str:
    """The comparison of all agents that is published."""
    return leaderboard.markdown(leaderboard.PUBLISHED)


def left_by(script: ModuleType) -> dict[str, Any]:
    """What a script has kept where its ``--json`` is expected; SystemExit with the cure where there is nothing."""
    name = Path(str(script.__file__)).name
    path = ROOT / script.DEFAULT
    if not path.is_file():
        raise SystemExit(f"{script.DEFAULT} is missing; make it by: python scripts/{name} --json {script.DEFAULT}")
    kept: dict[str, Any] = json.loads(path.read_text())
    return kept


def rig_faults_block(_: argparse.Namespace) -> str:
    """What ``scripts/rig_faults.py`` has found."""
    return rig_faults.markdown(left_by(rig_faults))


def rig_soak_block(_: argparse.Namespace) -> str:
    """What ``scripts/rig_soak.py`` has measured."""
    return "```\n" + rig_soak.text(left_by(rig_soak)) + "\n```"


BLOCKS: dict[str, Callable[[argparse.Namespace], str]] = {
    "parameters": parameters,
    "agreement": agreement,
    "specimens": specimens,
    "calibration": calibration,
    "speed": speed,
    "training": training,
    "headroom": headroom_block,
    "benchmark": benchmark,
    "rig-faults": rig_faults_block,
    "rig-soak": rig_soak_block,
}


def replaced(text: str, name: str, block: str) -> str:
    """The README with one block replaced."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"README.md has no block {name}: <!-- {name} --> to <!-- /{name} -->")
    return pattern.sub(lambda match: f"{match[1]}\n{block}\n\n{match[2]}", text)


def draw_picture(path: Path) -> None:
    """One cut by a script on measured liver, above its force trace."""
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08)
    observation, _ = env.reset(seed=7)
    policy = ConstantFeed(speed=0.0127, angle=math.radians(75.0))
    policy.reset(np.random.default_rng(0))
    parts, ended = [], False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.unwrapped.cutting.readings.copy())  # type: ignore[attr-defined]
    specimen = env.unwrapped.specimen  # type: ignore[attr-defined]
    draw_cut(
        path,
        np.concatenate(parts),
        specimen.depth,
        target_length=0.08,
        force_limit_per_depth=1000.0,
        title="1.27 cm/s and 75 degrees through a slice of liver, then stop and unload",
    )


def main() -> None:
    """Rewrite or check blocks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blocks", nargs="*", choices=[*BLOCKS, []], metavar="BLOCK", help=", ".join(BLOCKS))
    parser.add_argument("--runs", type=Path, nargs="+", help="folders of the runs to quote, for training one a seed")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--picture", action="store_true", help="draw the picture")
    arguments = parser.parse_args()
    if arguments.picture:
        draw_picture(ROOT / "assets" / "pictures" / "cut.png")
    readme = ROOT / "README.md"
    text = readme.read_text()
    for name in arguments.blocks:
        new = replaced(text, name, BLOCKS[name](arguments))
        if arguments.check and new != text:
            raise SystemExit(f"README.md: block {name} is not what scripts/update_readme.py {name} prints")
        text = new
    if not arguments.check:
        readme.write_text(text)


if __name__ == "__main__":
    main()
