"""Tables of training runs: of the page on training, and the short one of the README, which is taken from it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.learning.statistics import mean_with_interval, rows_of
from cutenv.agents.policy import CONSTANT_FEEDS, ORACLE, SCRIPTS
from scripts import ROOT
from scripts.documentation.page_blocks import block_of
from scripts.tables import markdown_table

SCORES = ("return", "success", "tip_error_mm", "peak_force_N", "time_s")


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file; SystemExit with the cure where there is none."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; give the folder of a finished run with --runs, or make it first.")
    return rows_of(path)


def interval(row: dict[str, str], digits: int = 2) -> str:
    """Return a mean and its interval as text."""
    mean, low, high = (f"{float(row[name]):.{digits}f}" for name in ("mean", "low_95", "high_95"))
    return f"{mean} [{low}, {high}]"


def training(*folders: str) -> str:
    """Return the evaluation of training runs, one for each seed, from their summary.csv and differences.csv."""
    runs = [Path(folder) for folder in folders]
    if not runs:
        raise SystemExit("training needs --runs runs/NAME ..., the folders of finished training runs.")
    return "\n\n".join((compared(runs[0]), each_seed(runs)))


def compared(run: Path) -> str:
    """Return the table of one run: the agent and the baselines."""
    values = {(row["policy"], row["score"]): row for row in read_csv(run / "summary.csv")}
    paired = read_csv(run / "differences.csv")
    shown = [paired[0]["policy"], *dict.fromkeys(row["baseline"] for row in paired)]
    shown.sort(key=lambda policy: -float(values[policy, "return"]["mean"]))
    rows = [(policy, *(interval(values[policy, score]) for score in SCORES)) for policy in shown]
    return markdown_table(("policy", "return", "success", "tip error [mm]", "peak force [N]", "time [s]"), rows)


def each_seed(runs: list[Path]) -> str:
    """Return the table of training seeds: each agent against the best script and the oracle."""
    rows = []
    for run in runs:
        facts = json.loads((run / "run.json").read_text())
        values = {(row["policy"], row["score"]): row for row in read_csv(run / "summary.csv")}
        paired = {(row["baseline"], row["score"]): row for row in read_csv(run / "differences.csv")}
        agent = next(iter(paired.values()))["policy"]
        script = max(
            {name for name, _ in paired} & {*CONSTANT_FEEDS, *SCRIPTS},
            key=lambda name: float(values[name, "return"]["mean"]),
        )
        rows.append(
            (
                str(facts["arguments"]["seed"]),
                interval(values[agent, "return"], 3),
                interval(values[agent, "success"]),
                script,
                interval(paired[script, "return"], 3),
                interval(paired[script, "success"]),
                interval(paired[ORACLE, "return"], 3),
                level(facts),
            )
        )
    if len(runs) > 1:
        rows.append(("all", "", "", script, interval(together(runs, agent, script), 3), "", "", ""))
    differences = ("agent minus script: return", "success", "agent minus bound")
    return markdown_table(("seed", "return", "success", "best script", *differences, "level after [min], of"), rows)


def level(facts: dict[str, Any]) -> str:
    """Return when the agent was level with its teacher on validation specimens, and how long it was trained [min]."""
    seconds = facts.get("level_with_script_after_s", "not measured")
    known = "never" if seconds is None else seconds if isinstance(seconds, str) else f"{seconds / 60.0:.1f}"
    return f"{known}, {facts.get('training_minutes', 'unknown')}"


def together(runs: list[Path], agent: str, script: str) -> dict[str, str]:
    """Return the paired difference of the return, averaged over runs before the interval over specimens is taken."""
    by_seed: dict[str, list[float]] = {}
    for run in runs:
        scores = {(row["policy"], row["seed"]): float(row["return"]) for row in read_csv(run / "scores.csv")}
        for policy, seed in scores:
            if policy == agent:
                by_seed.setdefault(seed, []).append(scores[agent, seed] - scores[script, seed])
    assert all(len(values) == len(runs) for values in by_seed.values()), "runs of different specimens"
    pooled = mean_with_interval(np.mean(values) for values in by_seed.values())
    return {name: str(value) for name, value in pooled.items()}


def results() -> str:
    """Return the short table of the README, taken from the blocks of the page on training."""
    block = block_of(ROOT / "docs" / "results" / "training.md", "training")
    policies, seeds = (table_of(lines) for lines in re.findall(r"(?:^\|.*\n)+", block, re.MULTILINE))
    rows = {row["policy"]: row for row in policies}
    *_, script = (seed["best script"] for seed in seeds)
    constant = next(name for name in rows if name in CONSTANT_FEEDS)
    shown = {
        ORACLE: "planner with truth, which sees the hidden state",
        "PPO": "PPO",
        script: f"best script ({script})",
        constant: f"best constant feed ({constant.removeprefix('constant ')})",
        "random": "random",
    }
    columns = ("return", "success", "tip error [mm]", "peak force [N]")
    table = markdown_table(
        ("policy", *columns), [(label, *(rows[name][column] for column in columns)) for name, label in shown.items()]
    )
    return f"{table}\n\n{verdict(seeds)}"


def verdict(seeds: list[dict[str, str]]) -> str:
    """Return the sentence about agent and script, from the table of training seeds."""
    count = len([row for row in seeds if row["seed"] != "all"])
    mean, low, high = map(float, re.findall(r"-?\d+\.\d+", seeds[-1]["agent minus script: return"]))
    about = f"{abs(mean):.2f} of return (95 % interval of the paired difference [{low:.2f}, {high:.2f}]"
    runs = "one training seed" if count == 1 else f"{count} training seeds"
    if low > 0.0:
        return f"PPO beats the best script by {about}, {runs})."
    if high < 0.0:
        return f"PPO is worse than the best script by {about}, {runs})."
    return f"PPO against the best script is undecided: they differ by {about}, {runs})."


def table_of(text: str) -> list[dict[str, str]]:
    """Return the rows of a Markdown table by column."""
    header, _, *rows = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in text.strip().splitlines())
    return [dict(zip(header, row, strict=True)) for row in rows]
