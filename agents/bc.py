"""Clone a script by behaviour cloning alone, compare the clone with every baseline, report.

    python agents/bc.py                     some three minutes on 2 cores; writes runs/<name>/
    python agents/bc.py --quick             some two minutes
    python agents/bc.py --dataset ID        clones a Minari data set (agents/datasets.py) instead of a script
    python agents/bc.py --resume runs/NAME  continues from the checkpoint of an interrupted run

The clone has the same inputs and network size as an agent of ppo.py, which starts from such a clone, trained for less
time.  It cannot be better than its teacher except by chance: it shows what reinforcement learning adds.  The epoch that
is best on validation specimens is kept.  Decision rate and angle mode are those of the data set, if one is given; the
specimens of validation and comparison are always sampled in the simulator.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import safetensors
import safetensors.torch
import torch
from arguments import AgentArguments, option, parse
from checkpoints import end_interrupted
from cloning import Cloning, Lessons, demonstrations
from compare import compare, read_rows
from datasets import environment_of, lessons, opened
from evaluate import write_csv
from progress import validate
from provenance import write_facts
from run_folder import export, record_run
from tqdm import tqdm

from cutenv.atomic import replacing
from cutenv.policy import BASELINES, Network
from cutenv.policy.features import feature_count

if TYPE_CHECKING:
    from minari import MinariDataset

QUICK = {"demonstrations": 50_000, "epochs": 20, "validations": 4, "validation_specimens": 50, "specimens": 30}
NAME = "behaviour cloning"
_MOMENTS = ("exp_avg", "exp_avg_sq", "step")  # Adam's state for each parameter


@dataclass(frozen=True, kw_only=True)
class Arguments(AgentArguments):
    """Arguments of a run; every field is an option of the command line."""

    dataset: str = option("", "id of a Minari data set to clone instead of a script; rate and angle mode are its own")
    demonstrations: int = option(400_000, "number of decisions of the script")
    epochs: int = option(60, "number of passes over the demonstrations")
    batch_size: int = option(1024, "number of decisions in a gradient step")
    learning_rate: float = option(2e-3, "learning rate at the start; falls along half a cosine to zero")

    @classmethod
    def limits(cls) -> dict[str, tuple[float, float]]:
        """Return the admissible ranges of the numbers."""
        own = {"demonstrations": (1, 10**9), "epochs": (1, 10**6), "batch_size": (1, 10**9)}
        return super().limits() | own | {"learning_rate": (1e-9, 1.0)}

    @classmethod
    def completed(cls, chosen: Mapping[str, Any]) -> dict[str, Any]:
        """Return the choices, with what a data set implies; SystemExit for what contradicts it."""
        if not chosen.get("dataset"):
            return dict(chosen)
        for name in ("demonstrations", "script", "demonstration_noise"):
            if name in chosen:
                raise SystemExit(f"--{name.replace('_', '-')} is of a script; leave it out where a --dataset teaches.")
        try:
            dataset = opened(chosen["dataset"])
            brought = environment_of(dataset)
        except ValueError as error:
            raise SystemExit(f"--dataset: {error}") from None
        for name, value in brought.items():
            if chosen.get(name, value) != value:
                raise SystemExit(
                    f"--{name.replace('_', '-')} {chosen[name]} contradicts data set {dataset.id!r}, whose decisions "
                    f"were made with {value}; leave it out."
                )
        decisions = int(dataset.total_steps)
        return {**chosen, **brought, "script": "", "demonstration_noise": 0.0, "demonstrations": decisions}

    @property
    def teacher(self) -> str:
        """Name of the teacher, in words."""
        return f"data set {self.dataset!r}" if self.dataset else repr(self.script)


class Clone:
    """The trained network; :func:`progress.validate` calls it like a model of Stable-Baselines3."""

    def __init__(self, arguments: Arguments) -> None:
        torch.manual_seed(arguments.seed)
        self._inputs, units = feature_count(arguments.history), arguments.hidden
        self.module = torch.nn.Sequential(
            torch.nn.Linear(self._inputs, units),
            torch.nn.Tanh(),
            torch.nn.Linear(units, units),
            torch.nn.Tanh(),
            torch.nn.Linear(units, 2),
        )

    def __call__(self, seen: torch.Tensor) -> torch.Tensor:
        """Return actions for features; the hidden state, which comes last, is cut off."""
        return self.module(seen[..., : self._inputs])

    def predict(
        self, seen: np.ndarray, state: None, episode_start: Any, deterministic: bool
    ) -> tuple[np.ndarray, None]:
        """Return the actions, and no state."""
        with torch.no_grad():
            return self(torch.as_tensor(seen)).numpy(), None

    def network(self) -> Network:
        """Return the same network in NumPy."""
        dense = [layer for layer in self.module if isinstance(layer, torch.nn.Linear)]
        return Network(tuple((layer.weight.detach().numpy(), layer.bias.detach().numpy()) for layer in dense), "tanh")


def save_checkpoint(path: Path, clone: Clone, cloning: Cloning, seconds: float) -> None:
    """Write network, Adam's moments, number of epochs and training time, atomically."""
    content = {f"network.{name}": values for name, values in clone.module.state_dict().items()}
    for n, moments in cloning.optimizer.state_dict()["state"].items():
        content |= {f"adam.{n}.{name}": moments[name] for name in _MOMENTS}
    with replacing(path) as part:
        safetensors.torch.save_file(content, part, {"epoch": str(cloning.epoch), "seconds": f"{seconds:.1f}"})


def load_checkpoint(path: Path, clone: Clone, cloning: Cloning) -> float | None:
    """Continue from :func:`save_checkpoint`; return its seconds, None for a version without them."""
    content = safetensors.torch.load_file(path)
    clone.module.load_state_dict(
        {name.removeprefix("network."): values for name, values in content.items() if name.startswith("network.")}
    )
    with safetensors.safe_open(path, "pt") as file:
        told = file.metadata()
    cloning.epoch = int(told["epoch"])
    whole = cloning.optimizer.state_dict()
    count = len(whole["param_groups"][0]["params"])
    whole["state"] = {n: {name: content[f"adam.{n}.{name}"] for name in _MOMENTS} for n in range(count)}
    cloning.optimizer.load_state_dict(whole)
    return float(told["seconds"]) if "seconds" in told else None


def taught_by(arguments: Arguments) -> tuple[Lessons, dict[str, Any]]:
    """Return the training data, and its description for the card; SystemExit for a data set that does not fit."""
    if not arguments.dataset:
        shown = demonstrations(  # the same again after an interruption: they depend only on seeds
            arguments.environments_at(arguments.training_seeds),
            BASELINES[arguments.script],
            decisions=arguments.demonstrations,
            noise=arguments.demonstration_noise,
            seed=arguments.seed,
        )
        return shown.decisions(), {"script": arguments.script, "decisions": arguments.demonstrations}
    try:
        dataset = opened(arguments.dataset)
        seen, taught = lessons(dataset, dead_zone=arguments.dead_zone, **arguments.features)
    except ValueError as error:
        raise SystemExit(f"--dataset: {error}") from None
    if len(seen) != arguments.demonstrations:
        raise SystemExit(
            f"data set {dataset.id!r} holds {len(seen)} decisions, not the {arguments.demonstrations} that this run "
            "began with; begin another run."
        )
    told = {"dataset": dataset.id, "source": source_of(dataset), "cuts": int(dataset.total_episodes)}
    return Lessons(seen, taught), told | {"decisions": len(seen)}


def source_of(dataset: MinariDataset) -> str:
    """Return who made the cuts, if the data set states it."""
    metadata = dataset.storage.metadata
    return str(metadata.get("cutenv", {}).get("source", metadata.get("algorithm_name", "unknown")))


def train(arguments: Arguments, run: Path, facts: dict[str, Any], resume: bool) -> None:
    """Train; writes ``policy/``, ``learning_curve.csv`` and, until it is finished, ``checkpoint.safetensors``."""
    begun = time.monotonic()
    torch.set_num_threads(1)  # as in ppo.py
    clone = Clone(arguments)
    taught, facts["taught_by"] = taught_by(arguments)
    cloning = Cloning(
        clone,
        list(clone.module.parameters()),
        taught,
        epochs=arguments.epochs,
        batch_size=arguments.batch_size,
        learning_rate=arguments.learning_rate,
        seed=arguments.seed,
    )
    curve: list[dict[str, float]] = []
    if resume:
        seconds = load_checkpoint(run / "checkpoint.safetensors", clone, cloning)
        done = cloning.epoch * arguments.demonstrations
        curve = [point for point in read_rows(run / "learning_curve.csv") if point["decisions"] <= done]
        if seconds is None:
            seconds = curve[-1]["seconds"] if curve else 0.0
        begun -= seconds
        print(f"resuming after {cloning.epoch} epochs")
    every = max(arguments.epochs // arguments.validations, 1)
    events = event_writer(arguments, run)
    saved = time.monotonic()
    for _ in tqdm(range(cloning.epoch, arguments.epochs), desc="cloning", unit="epoch"):
        cloning.go_on()
        seconds = time.monotonic() - begun
        last = cloning.epoch == arguments.epochs or bool(arguments.minutes and seconds > 60.0 * arguments.minutes)
        if last or cloning.epoch % every == 0:
            best = max((point["validation_return"] for point in curve), default=-np.inf)
            mean_return, success = validate(clone, arguments)
            point = {"decisions": float(cloning.epoch * arguments.demonstrations), "seconds": round(seconds, 1)}
            point |= {"return": mean_return, "success": success, "error": cloning.error()}
            curve.append(point | {"validation_return": mean_return, "validation_success": success})
            if mean_return > best:
                export(arguments, run / "policy", clone.network(), {**facts, "decisions": int(point["decisions"])})
            for name in ("return", "success", "error"):
                if events is not None:
                    events.add_scalar(f"validation/{name}", point[name], cloning.epoch)
        if last or cloning.epoch % every == 0 or time.monotonic() - saved > arguments.checkpoint_seconds:
            if curve:  # saved first: what it is ahead of the checkpoint by is dropped again
                write_csv(run / "learning_curve.csv", curve)
            save_checkpoint(run / "checkpoint.safetensors", clone, cloning, time.monotonic() - begun)
            saved = time.monotonic()
        if last:
            break
    if events is not None:
        events.close()


def event_writer(arguments: Arguments, run: Path) -> Any:
    """Return a writer of TensorBoard events, if they are wanted."""
    if not arguments.tensorboard:
        return None
    from torch.utils.tensorboard import SummaryWriter

    return SummaryWriter(str(run / "tensorboard"))


def main() -> None:
    """Train, evaluate, report."""
    arguments, run, resume = parse(Arguments, __doc__, "bc", QUICK)
    facts = record_run(arguments, run, NAME)
    try:
        train(arguments, run, facts, resume)
        curve = read_rows(run / "learning_curve.csv")
        print(f"the clone's actions differ from those of {arguments.teacher} by {curve[-1]['error']:.3f}")
        facts["training_minutes"] = round(curve[-1]["seconds"] / 60.0, 1)
        write_facts(run, facts)
        if arguments.specimens:
            compare(run, facts)
    except KeyboardInterrupt:
        end_interrupted(run, f"python agents/bc.py --resume {run}")


if __name__ == "__main__":
    main()
