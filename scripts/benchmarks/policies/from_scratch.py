"""Learners from scratch on every task: no script, no demonstrations, and a critic that sees no more than the actor.

    python -m scripts.benchmarks.policies.from_scratch --seeds 0            some 50 minutes of one core
    python -m scripts.benchmarks.policies.from_scratch --tasks gentle --learners ppo --seeds 0 1
    python -m scripts.benchmarks.policies.from_scratch --print              prints the table of all runs
    python -m scripts.benchmarks.policies.from_scratch --picture FILE       draws their curves

The runs are in assets/benchmark/from-scratch, one file each.  One that is there is not made again: stop the script
whenever you like, and go on later, also on another machine.  What counts is the last policy of a training: none is
chosen by validation.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby, product
from operator import itemgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from cutenv.agents.learning.environment_groups import EasierEnvironments
from cutenv.agents.learning.evaluation import contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS, VALIDATION_SEEDS
from cutenv.agents.learning.statistics import rows_of
from cutenv.agents.sb3 import FeatureVecEnv, NativeVecEnv
from cutenv.task.registry import TASKS
from scripts import ROOT
from scripts.tables import keep, markdown_table, mean_text

sys.path.append(str(ROOT / "agents"))
import ppo_gru

FOLDER = ROOT / "assets" / "benchmark" / "from-scratch"
LEARNED = ("gentle", "depth", "path", "excision")
SHOWN: dict[str, Callable[..., VecEnv]] = {
    "raw": NativeVecEnv,
    "features": FeatureVecEnv,
    "truth": partial(NativeVecEnv, hidden_state=True),
}
"""Environments by what is shown: numbers of the observation, features of ``cutenv train``, numbers and hidden state."""
LEARNERS = {"ppo": "PPO", "memory": "PPO with a memory", "sac": "SAC", "easier": "PPO, easier at first"}
STYLES = {"raw": "-", "features": "--", "truth": ":"}  # lines of their curves
INPUTS = {"ppo": tuple(SHOWN), "memory": ("raw", "features"), "sac": ("raw", "features"), "easier": ("features",)}
"""Inputs of each learner, each in runs of its own."""
DECISIONS = {"ppo": 2_000_000, "memory": 2_000_000, "sac": 200_000, "easier": 2_000_000}
"""Decisions of a training, by learner."""
POINTS, SPECIMENS, HELD_OUT = 10, 200, 1000
"""Points of a curve, on so many validation specimens; at the end so many held-out specimens are cut."""
ENVIRONMENTS, MEMORY_ENVIRONMENTS = 64, 256  # training environments, also of PPO with a memory
RATE, SLOW_RATE = 10, 5  # decisions a second, also of a task that is easier at first
FORWARD, UNTIL = 0.3, 0.5  # speed action at first, and share of the training in which the task is easier
PPO_SETTINGS: dict[str, Any] = {"n_steps": 256, "batch_size": 1024, "n_epochs": 8, "gamma": 1.0}
LEARNING_RATE, DEVIATION = 1e-3, 0.8
SAC_SETTINGS: dict[str, Any] = {
    "learning_starts": 5000, "train_freq": 10, "gradient_steps": 64, "batch_size": 256, "gamma": 0.99,
    "policy_kwargs": {"net_arch": [64, 64]},
}  # fmt: skip
Act = Callable[[np.ndarray, Any, np.ndarray], tuple[np.ndarray, Any]]
"""Actions, and memory after them, from observations, memory before (None at first) and where a cut has begun."""


class Run(NamedTuple):
    """Training of a learner."""

    task: str
    learner: str
    shown: str
    seed: int

    @property
    def name(self) -> str:
        """Stem of the run's file."""
        return "-".join(map(str, self))

    def environments(self, seeds: Sequence[int]) -> VecEnv:
        """Return environments of the task with these seeds."""
        return SHOWN[self.shown](seeds, task=self.task, control_hz=self.rate)

    @property
    def rate(self) -> int:
        """Decisions a second."""
        return SLOW_RATE if self.learner == "easier" else RATE

    def train(self, decisions: int) -> list[dict[str, Any]]:
        """Train; return a row for each point of the curve, and one of the held-out specimens at the end."""
        torch.set_num_threads(1)
        curve = Curve(self.environments(VALIDATION_SEEDS[:SPECIMENS]), decisions)
        seeds = range(1000 * self.seed, 1000 * self.seed + ENVIRONMENTS)
        learn = {"memory": self._with_memory, "sac": self._by_sac}.get(self.learner, self._by_ppo)
        act_of, made = learn(seeds, curve)
        curve.add(act_of(False), made)
        last: dict[str, Any] = {"specimens": HELD_OUT}
        no_end = {"drawn_return": math.nan, "drawn_success": math.nan}
        for drawn, prefix in ((False, ""), (True, "drawn_")):
            returns, success = cut_with(act_of(drawn), self.environments(TEST_SEEDS[:HELD_OUT]))
            last |= {f"{prefix}return": returns.mean(), f"{prefix}success": success.mean()}
        return [*(row | no_end for row in curve.rows), curve.rows[-1] | last]

    def _by_ppo(self, seeds: range, curve: Curve) -> tuple[Callable[[bool], Act], int]:
        easier = self.learner == "easier"
        shown = {"task": self.task, "control_hz": self.rate}
        envs = EasierEnvironments(UNTIL, seeds, **shown) if easier else self.environments(seeds)
        model = PPO(
            "MlpPolicy", envs, seed=self.seed, device="cpu", policy_kwargs={"log_std_init": math.log(DEVIATION)},
            learning_rate=lambda left: LEARNING_RATE * max(left, 0.05), **PPO_SETTINGS,
        )  # fmt: skip
        if easier:
            torch.nn.init.constant_(model.policy.action_net.bias[0], FORWARD)
        model.learn(curve.decisions, callback=Watch(curve))
        return partial(act_of, model), model.num_timesteps

    def _by_sac(self, seeds: range, curve: Curve) -> tuple[Callable[[bool], Act], int]:
        model = SAC("MlpPolicy", self.environments(seeds), seed=self.seed, device="cpu", **SAC_SETTINGS)
        model.learn(curve.decisions, callback=Watch(curve))
        return partial(act_of, model), model.num_timesteps

    def _with_memory(self, seeds: range, curve: Curve) -> tuple[Callable[[bool], Act], int]:
        seeds = range(seeds.start, seeds.start + MEMORY_ENVIRONMENTS)
        args = ppo_gru.Args(seed=self.seed, total_decisions=curve.decisions, num_envs=len(seeds))
        args.num_minibatches = min(args.num_minibatches, args.batch_size // args.chunk)
        agent, _ = ppo_gru.train(
            args,
            verbose=False,
            envs=cast("gym.vector.VectorEnv", Batch(self.environments(seeds))),
            watch=lambda now, decisions: curve.watch(memory_of(now), decisions),
        )
        return partial(memory_of, agent), max(curve.decisions // args.batch_size, 1) * args.batch_size


class Curve:
    """Curve of a training: what the most likely actions earn on validation specimens, time and time again."""

    def __init__(self, envs: VecEnv, decisions: int) -> None:
        self.rows: list[dict[str, Any]] = []
        self.decisions = decisions
        self._envs, self._paused, self._begun = envs, 0.0, time.process_time()

    def watch(self, act: Act, decisions: int) -> None:
        """Add a point if one is due."""
        if decisions >= self.decisions * len(self.rows) / POINTS:
            self.add(act, decisions)

    def add(self, act: Act, decisions: int) -> None:
        """Add a point; the time that it takes is not the training's."""
        now = time.process_time()
        returns, success = cut_with(act, self._envs)
        took = round(now - self._begun - self._paused, 1)
        scores = {"return": returns.mean(), "success": success.mean(), "specimens": self._envs.num_envs}
        self.rows.append({"decisions": decisions, "processor_s": took, **scores})
        self._paused += time.process_time() - now


class Watch(BaseCallback):
    """Callback that shows a curve the model, and tells easier environments how much of the training is done."""

    def __init__(self, curve: Curve) -> None:
        super().__init__()
        self._curve = curve

    def _on_step(self) -> bool:
        if isinstance(self.model, SAC):
            self._curve.watch(act_of(self.model), self.num_timesteps)
        return True

    def _on_rollout_start(self) -> None:
        if isinstance(self.training_env, EasierEnvironments):
            self.training_env.share = self.num_timesteps / self._curve.decisions
        if not isinstance(self.model, SAC):
            self._curve.watch(act_of(self.model), self.num_timesteps)


class Batch:
    """Environments for Stable-Baselines3 as ``agents/ppo_gru.py`` takes them."""

    def __init__(self, envs: VecEnv) -> None:
        self._envs = envs
        self.single_observation_space, self.single_action_space = envs.observation_space, envs.action_space
        self.observation_space, self.action_space = (
            SimpleNamespace(shape=(envs.num_envs, *space.shape))
            for space in (envs.observation_space, envs.action_space)
        )

    def reset(self, seed: int) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin; each environment has its seed already."""
        return self._envs.reset(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step; an end is never a truncation."""
        seen, rewards, ended, _ = self._envs.step(actions)
        return seen, rewards, ended, np.zeros_like(ended), {}

    def close(self) -> None:
        """Close the environments."""
        self._envs.close()


def act_of(model: Any, drawn: bool = False) -> Act:
    """Return most likely actions, or drawn ones, of a Stable-Baselines3 model without memory."""
    return lambda seen, memory, begun: (model.predict(seen, deterministic=not drawn)[0], memory)


def memory_of(agent: ppo_gru.Agent, drawn: bool = False) -> Act:
    """Return most likely actions, or drawn ones, of an agent with a memory."""

    @torch.no_grad()
    def act(seen: np.ndarray, memory: Any, begun: np.ndarray) -> tuple[np.ndarray, Any]:
        memory = agent.initial_memory(len(seen)) if memory is None else memory
        now = torch.as_tensor(begun, dtype=torch.float32)[None]
        remembered, memory = agent.remember(torch.as_tensor(seen)[None], memory, now)
        mean = agent.actor_mean(remembered[0])
        return (torch.normal(mean, agent.exploration) if drawn else mean).numpy(), memory

    return act


def cut_with(act: Act, envs: VecEnv) -> tuple[np.ndarray, np.ndarray]:
    """Return returns and successes of the first cut in each environment."""
    seen, memory, begun = envs.reset(), None, np.ones(envs.num_envs, bool)
    returns, success = np.full(envs.num_envs, np.nan), np.zeros(envs.num_envs)
    while np.isnan(returns).any():
        actions, memory = act(seen, memory, begun)
        seen, _, begun, infos = envs.step(np.clip(actions, -1.0, 1.0))
        for n in np.flatnonzero(begun & np.isnan(returns)):
            returns[n], success[n] = infos[n]["episode"]["r"], infos[n]["is_success"]
    return returns, success


def cut_by_script(task: str) -> list[dict[str, Any]]:
    """Return mean return and success of the task's best script on the held-out specimens, one row."""
    name = TASKS[task].script
    rows = evaluate({name: contestant(name)}, list(TEST_SEEDS[:HELD_OUT]), {"specimen_class": "mixed"})
    means = {score: float(np.mean([row[score] for row in rows])) for score in ("return", "success")}
    return [{"script": name, **means, "specimens": HELD_OUT}]


def kept(folder: Path) -> dict[Run, list[dict[str, float]]]:
    """Return the rows of the finished runs; SystemExit if there is none."""
    runs = {}
    for path in sorted(folder.glob("*-*-*-*.csv")):
        task, learner, shown, seed = path.stem.split("-")
        rows = [{name: float(value) for name, value in row.items()} for row in rows_of(path)]
        runs[Run(task, learner, shown, int(seed))] = rows
    if not runs:
        raise SystemExit(f"{folder} holds no run; run 'python -m scripts.benchmarks.policies.from_scratch' first.")
    return runs


def cells(learners: Iterable[str]) -> list[tuple[str, str]]:
    """Return each learner with each of its inputs."""
    return [(learner, shown) for learner in learners for shown in INPUTS[learner]]


def groups(runs: Iterable[Run]) -> Iterator[tuple[str, str, str, list[Run]]]:
    """Yield task, learner, what it is shown, and its runs, in the order of the table."""
    for task, learner, shown in ((task, learner, shown) for task in LEARNED for learner, shown in cells(LEARNERS)):
        own = [run for run in runs if run[:3] == (task, learner, shown)]
        if own:
            yield task, learner, shown, own


def over_runs(values: Sequence[float], digits: int, factor: float = 1.0) -> str:
    """Return the mean over training runs as text, with its 95 % interval if there are three or more."""
    if len(values) >= 3:
        return mean_text(values, digits, factor=factor)
    return f"{factor * float(np.mean(values)):.{digits}f}"


def report(folder: Path) -> str:
    """Return a Markdown table with a row for each learner, and one for the best script of each task."""
    runs = kept(folder)
    lines: list[tuple[str, ...]] = []
    for task, of_task in groupby(groups(runs), key=itemgetter(0)):
        (script,) = rows_of(folder / f"{task}.csv")
        lines.append((task, f"script: {script['script']}", "", "", "", "", f"{float(script['return']):.3f}",
                      f"{100.0 * float(script['success']):.0f}", "", ""))  # fmt: skip
        for _, learner, shown, own in of_task:
            last = [runs[run][-1] for run in own]
            minutes = float(np.mean([row["processor_s"] for row in last])) / 60.0
            lines.append((
                task, LEARNERS[learner], shown, f"{len(own)}", f"{1e-6 * last[0]['decisions']:.1f}", f"{minutes:.1f}",
                *(text for prefix in ("", "drawn_") for text in _scores(last, prefix)),
            ))  # fmt: skip
    heading = (
        "task", "policy", "input", "runs", "decisions [million]", "processor time [min]", "return", "success [%]",
        "return, drawn actions", "success, drawn actions [%]",
    )  # fmt: skip
    about = f"The last policy of each run on {HELD_OUT} held-out specimens of class mixed; mean over runs"
    return (
        f"{about} [95 % interval over runs, from three on], by its most likely actions, and by drawn ones where that "
        f"was measured in every run.\n\n{markdown_table(heading, lines)}"
    )


def _scores(last: Sequence[Mapping[str, float]], prefix: str) -> tuple[str, str]:
    """Return mean return and success [%] of runs as text; "" if one of them has none."""
    if any(f"{prefix}return" not in row for row in last):
        return "", ""
    returns, success = ([row[f"{prefix}{name}"] for row in last] for name in ("return", "success"))
    return over_runs(returns, 3), over_runs(success, 0, 100.0)


def kept_report() -> str:
    """Return the table of all runs."""
    return report(FOLDER)


def draw(folder: Path, path: Path) -> None:
    """Draw the curves of all runs: return by minutes of one core, and by decisions, a row for each task."""
    import matplotlib.pyplot as plt

    runs = kept(folder)
    tasks = [task for task in LEARNED if any(run.task == task for run in runs)]
    figure, axes = plt.subplots(len(tasks), 2, figsize=(10.0, 2.6 * len(tasks)), layout="constrained", squeeze=False)
    colours = dict(zip(LEARNERS, ("tab:blue", "tab:orange", "tab:green", "tab:red"), strict=True))
    for task, learner, shown, own in groups(runs):
        pair = axes[tasks.index(task)]
        for number, run in enumerate(own):
            curve = runs[run][:-1]
            returns = [row["return"] for row in curve]
            label = f"{LEARNERS[learner]}, {shown}" if number == 0 else None
            line: dict[str, Any] = {"color": colours[learner], "ls": STYLES[shown], "lw": 1.0, "label": label}
            pair[0].plot([row["processor_s"] / 60.0 for row in curve], returns, **line)
            pair[1].plot([max(row["decisions"], 1e4) for row in curve], returns, **line)
    for task, pair in zip(tasks, axes, strict=True):
        (script,) = rows_of(folder / f"{task}.csv")
        for axis in pair:
            axis.axhline(float(script["return"]), color="black", lw=0.8, ls=":", label="best script")
            axis.set_ylim(-0.45, 0.9)
        pair[0].set_ylabel(f"{task}\nreturn")
        pair[1].set_xscale("log")
    axes[-1][0].set_xlabel("minutes of one core")
    axes[-1][1].set_xlabel("decisions")
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", choices=LEARNED, default=LEARNED, help="default: all")
    parser.add_argument("--learners", nargs="+", choices=list(LEARNERS), default=list(LEARNERS), help="default: all")
    parser.add_argument("--inputs", nargs="+", choices=list(SHOWN), default=list(SHOWN), help="default: all")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(10)), metavar="N", help="default 0 to 9")
    parser.add_argument("--decisions", type=int, metavar="N", help="decisions of a training; default by learner")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help="where the runs are kept")
    parser.add_argument("--print", action="store_true", help="print the table without training")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the curves without training")
    arguments = parser.parse_args()
    if arguments.picture:
        draw(arguments.out, arguments.picture)
        return
    chosen = product(arguments.seeds, arguments.tasks, cells(arguments.learners))
    for seed, task, (learner, shown) in [] if arguments.print else chosen:
        if not (arguments.out / f"{task}.csv").is_file():
            keep(arguments.out / f"{task}.csv", cut_by_script(task))
        run = Run(task, learner, shown, seed)
        path = arguments.out / f"{run.name}.csv"
        if path.is_file() or shown not in arguments.inputs:
            continue
        rows = run.train(arguments.decisions or DECISIONS[learner])
        keep(path, rows)
        print(f"{run.name}: return {rows[-1]['return']:.3f}, {rows[-1]['processor_s']:.0f} s", flush=True)
    print(report(arguments.out))


if __name__ == "__main__":
    main()
