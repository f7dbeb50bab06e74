"""Tables of training runs: of the page on training, and the short one of the README, from the leaderboard's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.learning.statistics import mean_with_interval, rows_of
from cutenv.agents.policy import CONSTANT_FEEDS, ORACLE, SCRIPTS
from scripts import ROOT
from scripts.tables import markdown_table

SUMMARY = ROOT / "assets" / "benchmark" / "summary.csv"  # summary of the leaderboard
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
    """Return the short table of the README: PPO of all training runs of the leaderboard, scripts and planner."""
    rows = {
        (row["contestant"], row["score"], row["statistic"]): row
        for row in read_csv(SUMMARY)
        if row["specimen_class"] == "mixed"
    }
    script = max(SCRIPTS, key=lambda name: float(rows[name, "return", "mean"]["value"]))
    shown = {
        ORACLE: "planner with truth, which sees the hidden state",
        "PPO": "PPO",
        script: f"best script ({script})",
        "best constant feed": "best constant feed",
        "random": "random",
    }
    lines = [
        (
            label,
            summary_text(rows[name, "return", "mean"]),
            summary_text(rows[name, "success", "mean"], 0, 100.0),
            *(summary_text(rows[name, score, "interquartile mean"]) for score in ("tip_error_mm", "peak_force_N")),
        )
        for name, label in shown.items()
    ]
    difference = rows["PPO", f"return minus {script}", "mean"]
    runs = round(float(difference["cuts"]) / float(rows[script, "return", "mean"]["cuts"]))
    found = (float(difference[name]) for name in ("value", "low_95", "high_95"))
    heading = ("policy", "return", "success [%]", "tip error [mm]", "peak force [N]")
    return f"{markdown_table(heading, lines)}\n\n{verdict(*found, runs)}"


def summary_text(row: dict[str, str], digits: int = 2, factor: float = 1.0) -> str:
    """Return a value of the leaderboard's summary with its interval."""
    value, low, high = (f"{factor * float(row[name]):.{digits}f}" for name in ("value", "low_95", "high_95"))
    return f"{value} [{low}, {high}]"


def verdict(mean: float, low: float, high: float, count: int) -> str:
    """Return the sentence about agent and script, from their difference in ``count`` training runs."""
    runs = "one training run" if count == 1 else f"{count} training runs"
    about = f"{abs(mean):.3f} of return (95 % interval of the paired difference [{low:.3f}, {high:.3f}], {runs})"
    if low > 0.0:
        return f"PPO beats the best script by {about}."
    if high < 0.0:
        return f"PPO is worse than the best script by {about}."
    return f"PPO against the best script is undecided: they differ by {about}."
