"""What goes on while an agent trains: progress bar, learning curve, checkpoints, averaging, validation."""

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
    """Mean return and success of the most likely actions on the validation specimens."""
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
    """What of an interrupted trial its model does not hold: the checkpoint keeps it beside the model.

    Attributes
    ----------
    averages : list of ndarray
        Running average of the actor's parameters; empty before the first update.
    seconds : float
        Of work so far, an earlier interruption included.
    taught_seconds : float
        Of them, those of the demonstration.
    """

    averages: list[np.ndarray]
    seconds: float
    taught_seconds: float

    @classmethod
    def of(cls, model: Any) -> Standing | None:
        """What a model was saved with; None for a checkpoint of an earlier version, which has no such part."""
        kept = getattr(model, "standing", None)
        return None if kept is None else cls(**kept)


class Progress(BaseCallback):
    """Progress bar, learning curve, checkpoints, and the best of them by validation.

    Parameters
    ----------
    run : Path
        The run's folder.
    arguments : TrialArguments
        What it depends on.
    curve : list of dict
        The learning curve of an interrupted run, or nothing.
    begun : float, optional
        When the work began (``time.monotonic``); default now.
    standing : Standing, optional
        Of an interrupted run; without one, its time is told by the curve and the average begins anew.
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
        told = [point.get("seconds", 0.0) for point in curve]  # all that an earlier version's checkpoint comes with
        earlier = (told or [0.0])[-1] if standing is None else standing.seconds
        self._begun = (self._saved if begun is None else begun) - earlier
        # Demonstrations count as time, but not as a share of the trial, by which critic and exploration go.
        self._taught = (told or [self.seconds])[0] if standing is None else standing.taught_seconds
        self.averages = [] if standing is None else [torch.as_tensor(values) for values in standing.averages]

    @property
    def seconds(self) -> float:
        """Of work so far, before an interruption too."""
        return time.monotonic() - self._begun

    @property
    def share(self) -> float:
        """Of the trial that is done: of its decisions or of its minutes, whichever is more."""
        a, of_time = self._arguments, 0.0
        if a.minutes:
            of_time = (self.seconds - self._taught) / max(60.0 * a.minutes - self._taught, 1.0)
        return min(max(self.num_timesteps / a.timesteps, of_time), 1.0)

    def average(self) -> None:
        """Follow the actor's parameters at a distance: their average cuts better, and less by chance, than the last."""
        present = [parameter.detach() for parameter in self.model.policy.actor_parameters()]
        if not self.averages:
            self.averages = [parameter.clone() for parameter in present]
        for average, parameter in zip(self.averages, present, strict=True):
            average.lerp_(parameter, self._arguments.averaging)

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """The model with the average for its actor."""
        actor = self.model.policy.actor_parameters()
        present = [parameter.detach().clone() for parameter in actor]
        self.assign(self.averages or present)
        try:
            yield
        finally:
            self.assign(present)

    def assign(self, values: list[torch.Tensor]) -> None:
        """Give the actor these parameters."""
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
        # Given, not learned: a policy that may keep its noise learns to lean on it, and stalls without.
        self.average()
        a = self._arguments
        share = self.share
        for parameter in self.model.policy.actor_parameters():  # a critic that knows nothing yet would spoil a clone
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
        """Keep what the training goes on from after an interruption.

        The curve comes first: between the two it is ahead, and what it is ahead by is dropped again.
        """
        path = self._run / "learning_curve.csv"
        if self.curve or path.is_file():
            write_csv(path, self.curve)
        averages = [values.numpy() for values in self.averages]
        standing = Standing(averages=averages, seconds=self.seconds, taught_seconds=self._taught)
        self.model.standing = dataclasses.asdict(standing)  # plain, so that it loads anywhere
        save(self.model, self._run / "checkpoint.zip")
        self._saved = time.monotonic()

    def validate(self) -> None:
        """Try the agent on the validation specimens, and keep it if it is the best so far."""
        best = max((point.get("validation_return", -np.inf) for point in self.curve), default=-np.inf)
        with self.averaged():
            mean_return, success = validate(self.model, self._arguments)
            if self.curve:  # else no cut has been finished yet
                self.curve[-1] |= {"validation_return": mean_return, "validation_success": success}
            self.logger.record("validation/return", mean_return)
            self.logger.record("validation/success", success)
            if mean_return > best:
                save(self.model, self._run / "policy.zip")
                write_csv(self._run / "learning_curve.csv", self.curve)

    def _on_training_end(self) -> None:
        self._bar.close()


def save(model: Any, path: Path) -> None:
    """Save a model all at once: an interruption leaves the last whole checkpoint."""
    with replacing(path) as part:
        model.save(part)
