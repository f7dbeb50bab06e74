"""Callback of a training run.

Progress bar, learning curve, checkpoints, running average of the actor, validation.

The learning curve counts the decisions of trial, and all cuts begun: those of demonstrations are consumed too.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from cutenv._base.output import atomic_write
from cutenv.agents.learning.arguments import LearnerArguments, PPOArguments, TrialArguments
from cutenv.agents.learning.environment_groups import EasierEnvironments
from cutenv.agents.learning.statistics import write_csv


def validate(model: Any, arguments: LearnerArguments) -> tuple[float, float]:
    """Return the most likely actions' mean return and success on validation specimens."""
    seeds = arguments.validation_seeds
    environments = arguments.environments_at(seeds)
    observations = environments.reset()
    results: dict[int, tuple[float, float]] = {}
    memory, begun = None, np.ones(len(seeds), bool)
    while len(results) < len(seeds):
        actions, memory = model.predict(observations, state=memory, episode_start=begun, deterministic=True)
        environments.step_async(actions)
        observations, _, dones, infos = environments.step_wait()
        begun = np.array(dones)
        for n in np.flatnonzero(dones):
            results.setdefault(int(n), (infos[n]["episode"]["r"], float(infos[n]["is_success"])))
    returns, successes = zip(*results.values(), strict=True)
    return float(np.mean(returns)), float(np.mean(successes))


class Progress(BaseCallback):
    """Callback for progress, learning curve, checkpoints and validation.

    It keeps the best by validation.  A resumed run gives its ``curve`` and ``extras``, without which its time is read
    from the curve, and the average starts again; the work ``begun`` at that ``time.monotonic``, default now.
    """

    def __init__(
        self,
        run: Path,
        arguments: TrialArguments,
        curve: list[dict[str, float]],
        begun: float | None = None,
        extras: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self._run, self._arguments, self.curve = run, arguments, curve
        self._saved = time.monotonic()
        known = [point.get("seconds", 0.0) for point in curve]  # the only times kept with a checkpoint without extras
        earlier = (known or [0.0])[-1] if extras is None else extras["seconds"]
        self._begun = (self._saved if begun is None else begun) - earlier
        # Demonstrations count as time, but not in the share of the training, which critic and exploration follow.
        self._pretraining = (known or [self.seconds])[0] if extras is None else extras["pretraining_seconds"]
        self.averages = [] if extras is None else [torch.as_tensor(values) for values in extras["averages"]]

    @property
    def seconds(self) -> float:
        """Time of work so far [s], that before an interruption included."""
        return time.monotonic() - self._begun

    @property
    def share(self) -> float:
        """Share of training done, by decisions or minutes, whichever is more."""
        a, of_time = self._arguments, 0.0
        if a.minutes:
            of_time = (self.seconds - self._pretraining) / max(60.0 * a.minutes - self._pretraining, 1.0)
        return min(max(self.num_timesteps / a.timesteps, of_time), 1.0)

    def average(self) -> None:
        """Update the running average of actor parameters, which cuts better."""
        present = [parameter.detach() for parameter in self._actor_parameters()]
        if not self.averages:
            self.averages = [parameter.clone() for parameter in present]
        for average, parameter in zip(self.averages, present, strict=True):
            average.lerp_(parameter, self._arguments.averaging)

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """Give the model the average as its actor within the context."""
        present = [parameter.detach().clone() for parameter in self._actor_parameters()]
        self.assign(self.averages or present)
        try:
            yield
        finally:
            self.assign(present)

    def assign(self, values: list[torch.Tensor]) -> None:
        """Set the parameters of the actor."""
        with torch.no_grad():
            for parameter, value in zip(self._actor_parameters(), values, strict=True):
                parameter.copy_(value)

    def _actor_parameters(self) -> list[torch.nn.Parameter]:
        policy: Any = self.model.policy
        parameters: list[torch.nn.Parameter] = policy.actor_parameters()
        return parameters

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
        self.average()
        a = self._arguments
        share = self.share
        environments: Any = self.training_env
        if isinstance(environments, EasierEnvironments):
            environments.share = share
        taught = a.demonstrations or a.correction
        for parameter in self._actor_parameters():  # a critic that knows nothing yet would spoil what it was taught
            parameter.requires_grad_(not taught or share >= a.critic_first)
        if isinstance(a, PPOArguments):
            # Scheduled, not learned: a policy that may keep its noise comes to depend on it, and stalls without.
            deviation = a.exploration * (a.last_exploration / a.exploration) ** share
            policy: Any = self.model.policy
            policy.log_std.data.fill_(math.log(deviation))

    def _on_step(self) -> bool:
        minutes = self._arguments.minutes
        return not minutes or self.seconds < 60.0 * minutes

    def _on_rollout_end(self) -> None:
        model: Any = self.model
        model.learning_rate.share = self.share
        episodes = model.ep_info_buffer or []
        if episodes:
            mean_return = float(np.mean([episode["r"] for episode in episodes]))
            success = float(np.mean(model.ep_success_buffer or [0.0]))
            point = {"decisions": float(self.num_timesteps), "cuts": float(model.get_env().cuts)}
            point["seconds"] = round(self.seconds, 1)
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
        """Write the files from which a run is resumed.

        The curve comes first: after an interruption between the two it is ahead, and is cut back when resumed.
        """
        path = self._run / "learning_curve.csv"
        if self.curve or path.is_file():
            write_csv(path, self.curve)
        model: Any = self.model
        model.checkpoint_extras = {  # what the model does not hold; plain, so that it loads anywhere
            "averages": [values.numpy() for values in self.averages],  # of the actor; none before the first update
            "seconds": self.seconds,
            "pretraining_seconds": self._pretraining,
            "cuts": model.get_env().cuts,
        }
        save_model(self.model, self._run / "checkpoint.zip")
        self._saved = time.monotonic()

    def validate(self) -> None:
        """Validate the agent, and keep it if best so far."""
        best = max((point.get("validation_return", -np.inf) for point in self.curve), default=-np.inf)
        with self.averaged():
            mean_return, success = validate(self.model, self._arguments)
            if self.curve:  # otherwise no cut has been finished yet
                self.curve[-1] |= {"validation_return": mean_return, "validation_success": success}
            self.logger.record("validation/return", mean_return)
            self.logger.record("validation/success", success)
            if mean_return > best:
                save_model(self.model, self._run / "policy.zip")
                write_csv(self._run / "learning_curve.csv", self.curve)

    def _on_training_end(self) -> None:
        self._bar.close()


def save_model(model: Any, path: Path) -> None:
    """Save a model atomically: an interruption leaves the last complete checkpoint."""
    with atomic_write(path) as part:
        model.save(part)
