"""Training callback: progress bar, learning curve, checkpoints, weight averaging, validation."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from evaluate import write_csv
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from cutenv.atomic import replacing

if TYPE_CHECKING:
    from learning import TrialArguments


def validate(model: Any, arguments: TrialArguments) -> tuple[float, float]:
    """Return mean return and success of the most likely actions on the validation specimens."""
    seeds = arguments.validation_seeds
    environments = arguments.environments_at(seeds)
    observations = environments.reset()
    results: dict[int, tuple[float, float]] = {}
    memory, begun = None, np.ones(len(seeds), bool)
    while len(results) < len(seeds):
        actions, memory = model.predict(observations, state=memory, episode_start=begun, deterministic=True)
        observations, _, dones, infos = environments.step(actions)
        begun = np.array(dones)
        for n in np.flatnonzero(dones):
            results.setdefault(int(n), (infos[n]["episode"]["r"], float(infos[n]["is_success"])))
    returns, successes = zip(*results.values(), strict=True)
    return float(np.mean(returns)), float(np.mean(successes))


@dataclass(frozen=True, kw_only=True)
class Standing:
    """State of an interrupted training that its model does not contain; saved with the model in the checkpoint.

    Attributes
    ----------
    averages : list of ndarray
        Running average of the actor's parameters; empty before the first update.
    seconds : float
        Time worked so far, before an interruption too [s].
    taught_seconds : float
        Part of it that went into the demonstration [s].
    """

    averages: list[np.ndarray]
    seconds: float
    taught_seconds: float

    @classmethod
    def of(cls, model: Any) -> Standing | None:
        """Return the state saved with a model; None for a checkpoint of an earlier version, which has none."""
        kept = getattr(model, "standing", None)
        return None if kept is None else cls(**kept)


class Progress(BaseCallback):
    """Callback that shows progress, writes the learning curve and checkpoints, and keeps the best by validation.

    Parameters
    ----------
    run : Path
        Folder of the run.
    arguments : TrialArguments
        Arguments of the run.
    curve : list of dict
        Learning curve of an interrupted run, or nothing.
    begun : float, optional
        Time at which the work began (``time.monotonic``); default now.
    standing : Standing, optional
        State of an interrupted run; without one, its time is taken from the curve and the average begins anew.
    """

    def __init__(
        self,
        run: Path,
        arguments: TrialArguments,
        curve: list[dict[str, float]],
        begun: float | None = None,
        standing: Standing | None = None,
    ) -> None:
        super().__init__()
        self._run, self._arguments, self.curve = run, arguments, curve
        self._saved = time.monotonic()
        told = [point.get("seconds", 0.0) for point in curve]  # all that an earlier version's checkpoint has
        earlier = (told or [0.0])[-1] if standing is None else standing.seconds
        self._begun = (self._saved if begun is None else begun) - earlier
        # Demonstrations count as time, but not as a share of the training, on which critic and exploration depend.
        self._taught = (told or [self.seconds])[0] if standing is None else standing.taught_seconds
        self.averages = [] if standing is None else [torch.as_tensor(values) for values in standing.averages]

    @property
    def seconds(self) -> float:
        """Time worked so far, before an interruption too [s]."""
        return time.monotonic() - self._begun

    @property
    def share(self) -> float:
        """Share of the training that is done, by decisions or by minutes, whichever is larger."""
        a, of_time = self._arguments, 0.0
        if a.minutes:
            of_time = (self.seconds - self._taught) / max(60.0 * a.minutes - self._taught, 1.0)
        return min(max(self.num_timesteps / a.timesteps, of_time), 1.0)

    def average(self) -> None:
        """Update the running average of the actor's parameters: it cuts more reliably than the last ones."""
        present = [parameter.detach() for parameter in self.model.policy.actor_parameters()]
        if not self.averages:
            self.averages = [parameter.clone() for parameter in present]
        for average, parameter in zip(self.averages, present, strict=True):
            average.lerp_(parameter, self._arguments.averaging)

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """Use the average as the model's actor within the block."""
        actor = self.model.policy.actor_parameters()
        present = [parameter.detach().clone() for parameter in actor]
        self.assign(self.averages or present)
        try:
            yield
        finally:
            self.assign(present)

    def assign(self, values: list[torch.Tensor]) -> None:
        """Set the actor's parameters."""
        with torch.no_grad():
            for parameter, value in zip(self.model.policy.actor_parameters(), values, strict=True):
                parameter.copy_(value)

    def _on_training_start(self) -> None:
        self._bar = tqdm(
            total=self._arguments.timesteps,
            initial=self.num_timesteps,
            desc="training",
            unit="decision",
            smoothing=0.05,
        )
        self._validated = int(self.share * self._arguments.validations)

    def _on_rollout_start(self) -> None:
        # Scheduled, not learned: a policy that may keep its noise comes to depend on it, and stalls without.
        self.average()
        a = self._arguments
        share = self.share
        for parameter in self.model.policy.actor_parameters():  # an untrained critic would spoil the clone
            parameter.requires_grad_(not a.demonstrations or share >= a.critic_first)
        deviation = a.exploration * (a.last_exploration / a.exploration) ** share
        self.model.policy.log_std.data.fill_(math.log(deviation))

    def _on_step(self) -> bool:
        minutes = self._arguments.minutes
        return not minutes or self.seconds < 60.0 * minutes

    def _on_rollout_end(self) -> None:
        self.model.learning_rate.share = self.share
        episodes = self.model.ep_info_buffer or []
        if episodes:
            mean_return = float(np.mean([episode["r"] for episode in episodes]))
            success = float(np.mean(self.model.ep_success_buffer or [0.0]))
            point = {"decisions": float(self.num_timesteps), "seconds": round(self.seconds, 1)}
            self.curve.append(point | {"return": mean_return, "success": success})
            self._bar.set_postfix_str(f"return {mean_return:.2f}, success {success:.2f}")
        due = int(self.share * self._arguments.validations)
        validated = due > self._validated
        if validated:
            self._validated = due
            self.validate()
        self._bar.update(min(self.num_timesteps, self._bar.total) - self._bar.n)
        if validated or time.monotonic() - self._saved > self._arguments.checkpoint_seconds:
            self.save_checkpoint()

    def save_checkpoint(self) -> None:
        """Save what the training needs to continue after an interruption.

        The curve is saved first: after an interruption between the two it is ahead, and the excess is dropped.
        """
        path = self._run / "learning_curve.csv"
        if self.curve or path.is_file():
            write_csv(path, self.curve)
        averages = [values.numpy() for values in self.averages]
        standing = Standing(averages=averages, seconds=self.seconds, taught_seconds=self._taught)
        self.model.standing = dataclasses.asdict(standing)  # plain data, so that it loads anywhere
        save(self.model, self._run / "checkpoint.zip")
        self._saved = time.monotonic()

    def validate(self) -> None:
        """Evaluate the agent on the validation specimens, and save it if it is the best so far."""
        best = max((point.get("validation_return", -np.inf) for point in self.curve), default=-np.inf)
        with self.averaged():
            mean_return, success = validate(self.model, self._arguments)
            if self.curve:  # otherwise no cut has been finished yet
                self.curve[-1] |= {"validation_return": mean_return, "validation_success": success}
            self.logger.record("validation/return", mean_return)
            self.logger.record("validation/success", success)
            if mean_return > best:
                save(self.model, self._run / "policy.zip")
                write_csv(self._run / "learning_curve.csv", self.curve)

    def _on_training_end(self) -> None:
        self._bar.close()


def save(model: Any, path: Path) -> None:
    """Save a model atomically: an interruption leaves the last whole checkpoint."""
    with replacing(path) as part:
        model.save(part)
