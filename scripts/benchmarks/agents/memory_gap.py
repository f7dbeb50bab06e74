"""Memory gap on cutenv/GentleCutRaw-v1: the same PPO without memory, with memory, and with the hidden state shown.

    python -m scripts.benchmarks.agents.memory_gap                                one training seed each, on one core
    python -m scripts.benchmarks.agents.memory_gap --learners recurrent --seeds 1 2
    python -m scripts.benchmarks.agents.memory_gap --print                        prints what is in runs/memory/

All learn from the 12 raw numbers with the same settings and number of decisions.  A run that was finished is not made
again; stop the script whenever you like, and go on later.  The most likely actions then cut held-out specimens.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack

from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import mean_with_interval, rows_of, write_csv
from cutenv.agents.sb3 import NativeVecEnv
from cutenv.envs.tracks import PROTOCOL
from scripts import ROOT
from scripts.tables import markdown_table

FOLDER = Path("runs") / "memory"
ENVIRONMENTS, STACKED = 64, 8
SETTINGS: dict[str, Any] = {
    "n_steps": 128,
    "batch_size": 512,
    "n_epochs": 10,
    "learning_rate": 1e-3,
    "gamma": 0.99,
    "device": "cpu",
}
"""Settings that all learners share; the others are their library's defaults."""
LEARNERS = {
    "memoryless": "PPO, the present observation",
    "stacked": f"PPO, the last {STACKED} observations",
    "recurrent": "recurrent PPO (LSTM, 64 units)",
    "observed": "PPO, the present observation and the hidden state",
}
"""Description of each learner."""
Row = Mapping[str, Any]


def environments(learner: str, seeds: Sequence[int]) -> VecEnv:
    """Return the environments of a learner, one for each seed."""
    raw = NativeVecEnv(seeds, hidden_state=learner == "observed", **PROTOCOL)
    return VecFrameStack(raw, STACKED) if learner == "stacked" else raw


def train(learner: str, seed: int, decisions: int, specimens: int) -> list[dict[str, Any]]:
    """Train a learner; return a row for each held-out specimen that it then cuts."""
    torch.set_num_threads(1)
    begun = time.process_time()
    envs = environments(learner, range(ENVIRONMENTS * seed, ENVIRONMENTS * (seed + 1)))
    if learner == "recurrent":
        network = {"lstm_hidden_size": 64}
        model: Any = RecurrentPPO("MlpLstmPolicy", envs, seed=seed, policy_kwargs=network, **SETTINGS)
    else:
        model = PPO("MlpPolicy", envs, seed=seed, **SETTINGS)
    model.learn(decisions)
    spent = {"decisions": model.num_timesteps, "processor_s": round(time.process_time() - begun)}
    return [{**row, **spent} for row in cut_with(model, learner, TEST_SEEDS[:specimens])]


def cut_with(model: Any, learner: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Let a model's most likely actions cut the specimens of some seeds; return a row for each."""
    envs = environments(learner, seeds)
    seen, memory, begun = envs.reset(), None, np.ones(len(seeds), bool)
    rows: dict[int, dict[str, Any]] = {}
    while len(rows) < len(seeds):
        actions, memory = model.predict(seen, state=memory, episode_start=begun, deterministic=True)
        seen, _, begun, infos = envs.step(actions)
        for n in np.flatnonzero(begun):
            row = {
                "specimen": seeds[int(n)],
                "return": infos[n]["episode"]["r"],
                "success": float(infos[n]["is_success"]),
            }
            rows.setdefault(int(n), row)
    return [rows[n] for n in range(len(seeds))]


def report(runs: Mapping[tuple[str, int], Sequence[Row]]) -> str:
    """Return a Markdown table with one line for each learner, averaged over its training seeds by specimen."""
    lines, means = [], {}
    for learner, text in LEARNERS.items():
        own = [rows for (name, _), rows in runs.items() if name == learner]
        if not own:
            continue
        means[learner] = np.mean([[float(row["return"]) for row in rows] for rows in own], axis=0)
        success = 100.0 * np.mean([float(row["success"]) for rows in own for row in rows])
        minutes = np.mean([float(rows[0]["processor_s"]) for rows in own]) / 60.0
        gain = "–"
        if learner != "memoryless" and "memoryless" in means:
            gain = shown(means[learner] - means["memoryless"], "+")
        lines.append(
            (text, f"{len(own)}", f"{float(own[0][0]['decisions']):.0f}", f"{minutes:.1f}", shown(means[learner]),
             f"{success:.0f}", gain)
        )  # fmt: skip
    heading = (
        "learner", "training seeds", "decisions", "processor time [min]", "return", "success [%]",
        "return minus that without memory",
    )  # fmt: skip
    count = len(next(iter(runs.values())))
    return f"{count} held-out specimens of class mixed; mean [95 % interval over specimens].\n\n" + markdown_table(
        heading, lines
    )


def shown(values: Sequence[float] | np.ndarray, sign: str = "") -> str:
    """Return the mean of some values with its 95 % interval as text."""
    mean, low, high, _ = mean_with_interval(values).values()
    return f"{mean:{sign}.3f} [{low:{sign}.3f}, {high:{sign}.3f}]"


def kept(folder: Path) -> dict[tuple[str, int], list[dict[str, str]]]:
    """Return the rows of the finished runs by learner and training seed; SystemExit if there is none."""
    runs = {}
    for path in sorted(folder.glob("*-*.csv")):
        learner, seed = path.stem.rsplit("-", 1)
        runs[learner, int(seed)] = list(rows_of(path))
    if not runs:
        raise SystemExit(f"{folder} holds no run; run 'python -m scripts.benchmarks.agents.memory_gap' first.")
    return runs


def kept_report() -> str:
    """Return the report of finished runs."""
    return report(kept(ROOT / FOLDER))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--learners", nargs="+", choices=list(LEARNERS), default=list(LEARNERS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="N", help="training seeds; default 0")
    parser.add_argument("--decisions", type=int, default=500_000, metavar="N", help="of a training; default 500000")
    parser.add_argument("--specimens", type=int, default=1000, metavar="N", help="held-out specimens; default 1000")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--print", action="store_true", help="print the kept table without training")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for seed in [] if arguments.print else arguments.seeds:
        for learner in arguments.learners:
            path = arguments.out / f"{learner}-{seed}.csv"
            if not path.is_file():
                print(f"{learner}, seed {seed}", flush=True)
                write_csv(path, train(learner, seed, arguments.decisions, arguments.specimens))
    print(report(kept(arguments.out)))


if __name__ == "__main__":
    main()
