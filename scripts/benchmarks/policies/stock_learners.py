"""Learners of other libraries with their defaults, on the 12 raw numbers of the observation at 10 decisions a second.

    python -m scripts.benchmarks.policies.stock_learners          PPO, SAC and TQC, three seeds each: some hours
    python -m scripts.benchmarks.policies.stock_learners --learners PPO --seeds 0
                                                                one run, some 20 minutes on one core
    python -m scripts.benchmarks.policies.stock_learners --print  prints what is in runs/stock/

Nothing is tuned: ``PPO("MlpPolicy", env)`` of Stable-Baselines3, and SAC and TQC (sb3-contrib) likewise.  Thirty times
in a training the most likely action cuts 200 validation specimens.  A run that was finished is not made again; stop the
script whenever you like, and go on later.  The mark is the best constant feed, a script that knows the way to stop.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from stable_baselines3.common.callbacks import BaseCallback

import cutenv  # noqa: F401  registers the environment
from cutenv.agents.learning.evaluation import contestant, evaluate
from cutenv.agents.learning.seeds import VALIDATION_SEEDS
from cutenv.agents.learning.statistics import rows_of, write_csv
from cutenv.agents.policy import feed_name
from scripts import ROOT

FOLDER = Path("runs") / "stock"
DECISIONS = {"PPO": 1_000_000, "SAC": 200_000, "TQC": 200_000, "CrossQ": 200_000}
"""Decisions of each learner's training."""
KEYWORDS = {"specimen_class": "mixed", "control_hz": 10}
MARK, MARK_FILE = feed_name(1.65, 45.0), "mark.txt"  # name of the best constant feed
SPECIMENS, VALIDATIONS = 200, 30


class Curve(BaseCallback):
    """Callback that cuts the validation specimens with the most likely actions, and keeps a row for each time."""

    def __init__(self, decisions: int) -> None:
        super().__init__()
        self.rows: list[dict[str, float]] = []
        self._every, self._due, self._cuts = decisions // VALIDATIONS, 0, 0
        self._begun = time.process_time()

    def _on_step(self) -> bool:
        self._cuts += int(np.sum(self.locals["dones"]))
        if self.num_timesteps >= self._due:
            self._due += self._every
            self.validate()
        return True

    def validate(self) -> None:
        """Cut the validation specimens, and print and keep the result."""
        mean_return, success = cut_with(self.model)
        row = {
            "decisions": self.num_timesteps,
            "cuts": self._cuts,
            "processor_s": round(time.process_time() - self._begun),
            "return": mean_return,
            "success": success,
        }
        self.rows.append(row)
        print("  " + "  ".join(f"{name} {value:g}" for name, value in row.items()), flush=True)


def cut_with(model: Any) -> tuple[float, float]:
    """Return mean return and success of a model's most likely actions on the validation specimens."""
    envs = gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=SPECIMENS, autoreset_mode="SameStep", **KEYWORDS)
    observations, _ = envs.reset(seed=VALIDATION_SEEDS[0])
    returns, success, going = np.zeros(SPECIMENS), np.zeros(SPECIMENS), np.ones(SPECIMENS, bool)
    while going.any():
        actions, _ = model.predict(observations, deterministic=True)
        observations, rewards, ended, _, infos = envs.step(actions)
        returns[going] += rewards[going]
        now = going & ended
        if now.any():
            success[now] = infos["final_info"]["is_success"][now]
        going &= ~ended
    envs.close()
    return round(float(returns.mean()), 4), float(success.mean())


def train(learner: str, seed: int, decisions: int) -> list[dict[str, float]]:
    """Train a learner with its library's defaults; return its curve."""
    torch.set_num_threads(1)
    kind = getattr(stable_baselines3, learner, None) or getattr(sb3_contrib, learner)
    model = kind("MlpPolicy", gymnasium.make("cutenv/GentleCut-v1", **KEYWORDS), seed=seed, device="cpu")
    curve = Curve(decisions)
    model.learn(decisions, callback=curve)
    curve.validate()
    return curve.rows


def mark() -> float:
    """Return the best constant feed's mean return on the validation specimens."""
    seeds = list(VALIDATION_SEEDS[:SPECIMENS])
    rows = evaluate({MARK: contestant(MARK)}, seeds, {"specimen_class": "mixed"}, description=MARK)
    return float(np.mean([row["return"] for row in rows]))


def report(runs: Mapping[str, Sequence[Mapping[str, float]]], level: float) -> str:
    """Return a Markdown table with one line for each run."""
    lines = [
        f"Best constant feed ({MARK}) on the same {SPECIMENS} validation specimens: {level:.3f}.",
        "",
        "| run | decisions | cuts | processor time [min] | return, best | its success [%] | return, mean of the last "
        "five | level with the feed after [decisions] |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, rows in runs.items():
        best, last = max(rows, key=lambda row: row["return"]), rows[-1]
        reached = next((row["decisions"] for row in rows if row["return"] >= level), math.inf)
        lines.append(
            f"| {name} | {last['decisions']:.0f} | {last['cuts']:.0f} | {last['processor_s'] / 60.0:.0f} "
            f"| {best['return']:.3f} | {100.0 * best['success']:.0f} | "
            f"{np.mean([row['return'] for row in rows[-5:]]):.3f} | "
            f"{'never' if math.isinf(reached) else f'{reached:.0f}'} |"
        )
    return "\n".join(lines)


def kept(folder: Path) -> tuple[dict[str, list[dict[str, float]]], float]:
    """Return the curves of the finished runs, by name, and the mark; SystemExit if there is none."""
    runs = {
        path.stem: [{name: float(value) for name, value in row.items()} for row in rows_of(path)]
        for path in sorted(folder.glob("*.csv"))
    }
    if not runs or not (folder / MARK_FILE).is_file():
        raise SystemExit(f"{folder} holds no run; run 'python -m scripts.benchmarks.policies.stock_learners' first.")
    return runs, float((folder / MARK_FILE).read_text())


def kept_report() -> str:
    """Return the report of finished runs."""
    return report(*kept(ROOT / FOLDER))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--learners", nargs="+", choices=list(DECISIONS), default=["PPO", "SAC", "TQC"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="training seeds")
    parser.add_argument("--decisions", type=int, metavar="N", help="decisions of a training; default by learner")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--print", action="store_true", help="print the kept table without training")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for learner in [] if arguments.print else arguments.learners:
        for seed in arguments.seeds:
            path = arguments.out / f"{learner}-{seed}.csv"
            if not path.is_file():
                print(f"{learner}, seed {seed}", flush=True)
                write_csv(path, train(learner, seed, arguments.decisions or DECISIONS[learner]))
    if not arguments.print:
        (arguments.out / MARK_FILE).write_text(f"{mark()}\n")
    print(report(*kept(arguments.out)))


if __name__ == "__main__":
    main()
