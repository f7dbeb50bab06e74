"""Learner "bc", behaviour cloning.

Imitate a script, or the cuts of a Minari data set, without any trial.

The clone sees the same features as the agent of PPO, and is a network of the same size; PPO starts from such a clone,
trained more briefly.  It can be better than its teacher only by chance: the difference between the two agents is the
gain from trial.  The epoch that does best on validation specimens is kept.  A data set sets decision rate and angle
mode; the specimens of validation and evaluation are drawn in the simulator as usual.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import safetensors
import safetensors.torch
import torch
from tqdm import tqdm

from cutenv._base.output import atomic_write
from cutenv.agents.learning.arguments import BadArguments, BCArguments
from cutenv.agents.learning.cloning import Cloning, DecisionDataset, EpochFit, script_demonstrations
from cutenv.agents.learning.minari_datasets import cloning_data, opened
from cutenv.agents.learning.progress import validate
from cutenv.agents.learning.run_folder import RunRequest, end_interrupted, export, record_run, write_facts
from cutenv.agents.learning.statistics import read_rows, write_csv
from cutenv.agents.learning.training_report import compare
from cutenv.agents.policy import Network
from cutenv.agents.policy.features import feature_count

if TYPE_CHECKING:
    pass

NAME = "behaviour cloning"
_MOMENTS = ("exp_avg", "exp_avg_sq", "step")  # Adam's state for each parameter


class Clone:
    """Clone's network, with ``predict`` as in Stable-Baselines3."""

    def __init__(self, arguments: BCArguments) -> None:
        torch.manual_seed(arguments.seed)
        self._inputs, units = feature_count(arguments.history), arguments.hidden
        self.actor = torch.nn.Sequential(
            torch.nn.Linear(self._inputs, units),
            torch.nn.Tanh(),
            torch.nn.Linear(units, units),
            torch.nn.Tanh(),
            torch.nn.Linear(units, 2),
        )
        self.module: torch.nn.Module = self.actor  # everything that is fitted

    def __call__(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the actions for observations, ignoring the hidden state (last)."""
        actions: torch.Tensor = self.actor(observations[..., : self._inputs])
        return actions

    def predict(
        self, observations: np.ndarray, state: None, episode_start: Any, deterministic: bool
    ) -> tuple[np.ndarray, None]:
        """Return the actions, and None as the state."""
        with torch.no_grad():
            return self(torch.as_tensor(observations)).numpy(), None

    def network(self) -> Network:
        """Return the actor in NumPy."""
        dense = [layer for layer in self.actor if isinstance(layer, torch.nn.Linear)]
        return Network(tuple((layer.weight.detach().numpy(), layer.bias.detach().numpy()) for layer in dense), "tanh")


def save_checkpoint(path: Path, clone: Clone, cloning: EpochFit, seconds: float) -> None:
    """Write network, Adam's moments, epochs and seconds, atomically."""
    content = {f"network.{name}": values for name, values in clone.module.state_dict().items()}
    for n, moments in cloning.optimizer.state_dict()["state"].items():
        content |= {f"adam.{n}.{name}": moments[name] for name in _MOMENTS}
    with atomic_write(path) as part:
        safetensors.torch.save_file(content, part, {"epoch": str(cloning.epoch), "seconds": f"{seconds:.1f}"})


def load_checkpoint(path: Path, clone: Clone, cloning: EpochFit) -> float | None:
    """Restore :func:`save_checkpoint`'s checkpoint; return its seconds, or None."""
    content = safetensors.torch.load_file(path)
    clone.module.load_state_dict(
        {name.removeprefix("network."): values for name, values in content.items() if name.startswith("network.")}
    )
    with safetensors.safe_open(path, "pt") as file:
        metadata = file.metadata()
    cloning.epoch = int(metadata["epoch"])
    whole = cloning.optimizer.state_dict()
    count = len(whole["param_groups"][0]["params"])
    whole["state"] = {n: {name: content[f"adam.{n}.{name}"] for name in _MOMENTS} for n in range(count)}
    cloning.optimizer.load_state_dict(whole)
    return float(metadata["seconds"]) if "seconds" in metadata else None


def training_data(arguments: BCArguments) -> tuple[DecisionDataset, dict[str, Any]]:
    """Return the data to fit the clone to, and facts for its card.

    Raises BadArguments if the data set does not fit the options.
    """
    if not arguments.dataset:
        # The same again after an interruption: they depend only on seeds.
        environments = arguments.training_environments()
        shown = script_demonstrations(environments, arguments)
        facts = {"script": arguments.script, "cuts": environments.cuts, "decisions": arguments.demonstrations}
        return shown.by_decision(), facts
    try:
        dataset = opened(arguments.dataset)
        observations, actions = cloning_data(dataset, **arguments.features)
    except ValueError as error:
        raise BadArguments(f"--dataset: {error}") from None
    if len(observations) != arguments.demonstrations:
        raise BadArguments(
            f"data set {dataset.id!r} contains {len(observations)} decisions, not the {arguments.demonstrations} that "
            "this run began with; begin another run."
        )
    metadata = dataset.storage.metadata
    source = str(metadata.get("cutenv", {}).get("source", metadata.get("algorithm_name", "unknown")))
    facts = {"dataset": dataset.id, "source": source, "cuts": int(dataset.total_episodes)}
    return DecisionDataset(observations, actions), facts | {"decisions": len(observations)}


def train(request: RunRequest[BCArguments], facts: dict[str, Any]) -> None:
    """Fit the clone; write ``policy/``, ``learning_curve.csv`` and, meanwhile, ``checkpoint.safetensors``."""
    begun, arguments = time.monotonic(), request.arguments
    clone = Clone(arguments)
    data, facts["taught_by"] = training_data(arguments)
    cloning = Cloning(
        clone,
        list(clone.module.parameters()),
        data,
        epochs=arguments.epochs,
        batch_size=arguments.batch_size,
        learning_rate=arguments.learning_rate,
        seed=arguments.seed,
    )
    fit(clone, cloning, request, facts, begun)


def fit(clone: Clone, cloning: EpochFit, request: RunRequest[Any], facts: dict[str, Any], begun: float) -> None:
    """Fit epoch by epoch, from a checkpoint if resumed.

    Export the epoch that does best on validation specimens. ``begun`` is the time at which the work began
    (``time.monotonic``); for the rest see :func:`train`.
    """
    arguments, run = request.arguments, request.run
    torch.set_num_threads(1)  # as for PPO
    curve: list[dict[str, float]] = []
    if request.resume:
        seconds = load_checkpoint(run / "checkpoint.safetensors", clone, cloning)
        done = cloning.epoch * arguments.demonstrations
        curve = [point for point in read_rows(run / "learning_curve.csv") if point["decisions"] <= done]
        if seconds is None:
            seconds = curve[-1]["seconds"] if curve else 0.0
        begun -= seconds
        print(f"resuming after {cloning.epoch} epochs")
    every = max(arguments.epochs // arguments.validations, 1)
    events: Any = None
    if arguments.tensorboard:
        from torch.utils.tensorboard import SummaryWriter

        events = SummaryWriter(str(run / "tensorboard"))
    saved = time.monotonic()
    for _ in tqdm(range(cloning.epoch, arguments.epochs), desc="fitting", unit="epoch"):
        cloning.run_epoch()
        seconds = time.monotonic() - begun
        last = cloning.epoch == arguments.epochs or bool(arguments.minutes and seconds > 60.0 * arguments.minutes)
        if last or cloning.epoch % every == 0:
            best = max((point["validation_return"] for point in curve), default=-np.inf)
            mean_return, success = validate(clone, arguments)
            point = {"decisions": float(cloning.epoch * arguments.demonstrations), "seconds": round(seconds, 1)}
            point |= {"cuts": float(facts["taught_by"]["cuts"])}
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


def run_learner(
    request: RunRequest[Any],
    resume_command: str,
    name: str = NAME,
    train: Callable[[RunRequest[Any], dict[str, Any]], None] = train,
) -> None:
    """Fit, evaluate and report into the run's folder.

    See :func:`cutenv.agents.learning.on_policy.run_learner`.  ``name`` is that of the agent in reports; ``train`` does
    what the function of this module does.
    """
    arguments, run = request.arguments, request.run
    facts = record_run(arguments, run, name)
    try:
        train(request, facts)
        curve = read_rows(run / "learning_curve.csv")
        print(f"the agent's actions differ from those of {arguments.teacher} by {curve[-1]['error']:.3f}")
        facts["training_minutes"] = round(curve[-1]["seconds"] / 60.0, 1)
        write_facts(run, facts)
        if arguments.specimens:
            compare(run, facts)
    except KeyboardInterrupt:
        end_interrupted(run, resume_command)
