"""Reinforcement learning with an on-policy algorithm of Stable-Baselines3: train, resume, export, compare.

Shared by ppo.py and recurrent_ppo.py, which define the networks and their pre-training.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from arguments import AgentArguments, option, parse
from checkpoints import end_interrupted
from compare import compare, read_rows
from evaluate import contestant, evaluate
from progress import Progress, Standing, save
from provenance import write_facts
from run_folder import export, record_run

from cutenv.policy import Network, RecurrentNetwork
from cutenv.policy.features import feature_count
from cutenv.task.hidden import HIDDEN

QUICK = {"timesteps": 400_000, "validations": 4, "validation_specimens": 50, "specimens": 30}


@dataclass(frozen=True, kw_only=True)
class TrialArguments(AgentArguments):
    """Arguments of a reinforcement learning run; every field is an option of the command line."""

    timesteps: int = option(8_000_000, "number of decisions to train for", resumable=True)
    history: int = option(0, "number of past decisions among the features")
    rollout: int = option(128, "number of decisions of each environment between updates")
    batch_size: int = option(1024, "number of decisions in a gradient step")
    epochs: int = option(8, "number of passes over a rollout")
    learning_rate: float = option(3e-4, "learning rate at the start; falls linearly to a twentieth")
    gamma: float = option(1.0, "discount per decision")
    gae_lambda: float = option(0.95, "lambda of the generalised advantage estimate")
    averaging: float = option(0.03, "share of the actor that its running average takes over at every update")
    critic: str = option("truth", "what the critic sees besides the features", ("truth", "features"))
    critic_first: float = option(0.03, "share of the training in which only the critic learns, after a demonstration")
    exploration: float = option(0.15, "standard deviation of the actions at the start")
    last_exploration: float = option(0.05, "standard deviation of the actions at the end of training")

    @classmethod
    def limits(cls) -> dict[str, tuple[float, float]]:
        """Return the admissible ranges of the numbers."""
        return super().limits() | {
            "timesteps": (1, 10**12),
            "rollout": (2, 10**6),
            "batch_size": (2, 10**9),  # advantages are divided by their standard deviation within it
            "epochs": (1, 10**6),
            "learning_rate": (1e-9, 1.0),
            "gamma": (0.0, 1.0),
            "gae_lambda": (0.0, 1.0),
            "averaging": (1e-6, 1.0),
            "critic_first": (0.0, 1.0),
            "exploration": (1e-6, 10.0),  # the policy holds its logarithm
            "last_exploration": (1e-6, 10.0),
        }

    @property
    def sizes(self) -> dict[str, int]:
        """Input sizes of actor and critic, and the number of units in a layer."""
        features = feature_count(self.history)
        critic = features + (len(HIDDEN) if self.critic == "truth" else 0)
        return {"features": features, "critic": critic, "hidden": self.hidden}


class FallingRate:
    """Learning rate that falls linearly to a twentieth over the training; :class:`Progress` updates it."""

    def __init__(self, rate: float) -> None:
        self.rate, self.share = rate, 0.0

    def __call__(self, remaining: float) -> float:
        """Return the rate; SB3's remaining share of decisions is ignored, as training may be limited by minutes."""
        return self.rate * (1.0 - 0.95 * self.share)


@dataclass(frozen=True)
class Learner:
    """Definition of one algorithm: the differences between ppo.py and recurrent_ppo.py."""

    name: str
    algorithm: Any
    new_model: Callable[[Any, Any], Any]
    """Function from arguments and environments to an untrained agent."""
    taught: Callable[[Any, Any], None]
    """Function that trains a model's actor to imitate the demonstrated script, given the arguments."""
    network: Callable[[Mapping[str, np.ndarray], str], Network | RecurrentNetwork]
    """Function from the policy's parameters to the actor in NumPy."""


def common_keywords(arguments: TrialArguments) -> dict[str, Any]:
    """Return the keyword arguments shared by PPO and recurrent PPO of Stable-Baselines3."""
    return {
        "learning_rate": FallingRate(arguments.learning_rate),
        "n_steps": arguments.rollout,
        "batch_size": arguments.batch_size,
        "n_epochs": arguments.epochs,
        "gamma": arguments.gamma,
        "gae_lambda": arguments.gae_lambda,
        "policy_kwargs": arguments.sizes,
        "seed": arguments.seed,
        "device": "cpu",  # a network this small is slower on a GPU
    }


def train(learner: Learner, arguments: TrialArguments, run: Path, resume: bool) -> tuple[bool, float]:
    """Train; return whether training is complete, and the share of its time that the environments took."""
    begun = time.monotonic()
    torch.set_num_threads(1)  # two thread pools on two cores compete
    checkpoint = run / "checkpoint.zip"
    environments = arguments.environments_at(arguments.training_seeds)
    events = str(run / "tensorboard") if arguments.tensorboard else None
    whole = True
    curve: list[dict[str, float]] = []
    standing = None
    if resume:
        model = learner.algorithm.load(checkpoint, env=environments, device="cpu", tensorboard_log=events)
        environments.first_episode = unseen_episode(model)
        curve = read_rows(run / "learning_curve.csv")
        curve = [point for point in curve if point["decisions"] <= model.num_timesteps]
        standing = Standing.of(model)
        print(f"resuming after {model.num_timesteps} decisions")
        if standing is None:
            print("the checkpoint, of an earlier version, holds no running average: that begins anew")
    else:
        model = learner.new_model(arguments, environments)
        model.tensorboard_log = events
        save(model, run / "untrained.zip")
        if arguments.demonstrations:
            learner.taught(model, arguments)
    progress = Progress(run, arguments, curve, begun, standing)
    progress.init_callback(model)
    trying, spent = time.perf_counter(), environments.seconds
    try:
        remaining = max(arguments.timesteps - model.num_timesteps, 0)
        if remaining and progress.share < 1.0:
            model.learn(remaining, callback=progress, reset_num_timesteps=not resume, tb_log_name="run")
            progress.validate()
    except KeyboardInterrupt:
        whole = False
    share = (environments.seconds - spent) / (time.perf_counter() - trying)
    progress.save_checkpoint()
    if whole and not (run / "policy.zip").is_file():  # ended before the first validation
        save(model, run / "policy.zip")
    return whole, share


def unseen_episode(model: Any) -> int:
    """Return the first episode that no environment of a model can have begun in training, as each lasts a decision.

    Otherwise the specimens that an interrupted run has cut would come again, from the first on.
    """
    return 1 + int(model.num_timesteps) // int(model.n_envs)


def exported(learner: Learner, arguments: TrialArguments, run: Path, name: str, facts: Mapping[str, Any]) -> None:
    """Write ``name``.zip's actor as a folder that needs no torch, ``name``/policy.safetensors and card.json."""
    model = learner.algorithm.load(run / f"{name}.zip", device="cpu")
    arrays = {key: value.detach().cpu().numpy() for key, value in model.policy.state_dict().items()}
    network = learner.network(arrays, "tanh")
    export(arguments, run / name, network, {**facts, "decisions": int(model.num_timesteps)})


def level_after(arguments: AgentArguments, curve: Sequence[Mapping[str, float]]) -> float | None:
    """Return the time [s] until the agent matched the demonstrated script on validation specimens; None: never."""
    shared = {"specimen_class": arguments.specimen_class, **arguments.angle}
    several, seeds = {arguments.script: contestant(arguments.script)}, arguments.validation_seeds
    rows = evaluate(several, seeds, shared, description="script on validation specimens")
    wanted = float(np.mean([row["return"] for row in rows]))
    reached = (point["seconds"] for point in curve if point.get("validation_return", -np.inf) >= wanted)
    return next(reached, None)


def main(learner: Learner, kind: type[TrialArguments], about: str | None, program: str) -> None:
    """Train, export, evaluate, report; ``program`` is the name of the agent's file on the command line."""
    arguments, run, resume = parse(kind, about, Path(program).stem.replace("_", "-"), QUICK)
    started = "python3 scripts/start.py train" if program == "ppo.py" else f"python agents/{program}"
    again = f"{started} --resume {run}"
    facts = record_run(arguments, run, learner.name)
    begun = time.monotonic()
    try:
        whole, share = train(learner, arguments, run, resume)
    except KeyboardInterrupt:  # before training, or a second time while it was being saved
        whole = False
    else:
        print(f"the environments took {100.0 * share:.0f} % of the time")
    if not whole:
        end_interrupted(run, again)
    curve = read_rows(run / "learning_curve.csv")
    seconds = curve[-1]["seconds"] if curve else time.monotonic() - begun
    facts["training_minutes"] = round(seconds / 60.0, 1)
    facts["environments_share"] = round(share, 3)
    try:
        for name in ("untrained", "policy"):
            exported(learner, arguments, run, name, facts)
        write_facts(run, facts)
        if arguments.specimens:
            seconds = level_after(arguments, curve)
            facts["level_with_script_after_s"] = seconds
            write_facts(run, facts)
            compare(run, facts)
            when = "never in this training" if seconds is None else f"after {seconds:.0f} s, teaching included"
            print(f"level with {arguments.script!r} on the validation specimens: {when}")
    except KeyboardInterrupt:
        print(f"\ninterrupted while evaluating; {run}/policy.zip is the trained agent.")
        print(f"Evaluate it with: {again}")
        raise SystemExit(130) from None
