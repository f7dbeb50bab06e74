"""What goes on while an agent trains: progress bar, learning curve, checkpoints, averaging, validation."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from evaluate import write_csv
from seeing_critic import actor_parameters
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from cutenv.atomic import replacing

if TYPE_CHECKING:
    from ppo import Arguments


def validate(model: Any, arguments: Arguments) -> tuple[float, float]:
    """Mean return and success of the most likely actions on the validation specimens."""
    seeds = arguments.validation_seeds
    environments = arguments.environments_at(seeds)
    observations = environments.reset()
    results: dict[int, tuple[float, float]] = {}
    while len(results) < len(seeds):
        actions, _ = model.predict(observations, deterministic=True)
        observations, _, dones, infos = environments.step(actions)
        for n in np.flatnonzero(dones):
            results.setdefault(int(n), (infos[n]["episode"]["r"], float(infos[n]["is_success"])))
    returns, successes = zip(*results.values(), strict=True)
    return float(np.mean(returns)), float(np.mean(successes))


class Progress(BaseCallback):
    """Progress bar, learning curve, checkpoints, and the best of them by validation."""

    def __init__(self, run: Path, arguments: Arguments, curve: list[dict[str, float]]) -> None:
        super().__init__()
        self._run, self._arguments, self.curve = run, arguments, curve
        self.averages: list[torch.Tensor] = []
        self._saved = time.monotonic()
        self._every = max(arguments.timesteps // arguments.validations, 1)

    def average(self) -> None:
        """Follow the actor's parameters at a distance: their average cuts better, and less by chance, than the last."""
        present = [parameter.detach() for parameter in actor_parameters(self.model)]
        if not self.averages:
            self.averages = [parameter.clone() for parameter in present]
        for average, parameter in zip(self.averages, present, strict=True):
            average.lerp_(parameter, self._arguments.averaging)

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """The model with the average for its actor."""
        actor = actor_parameters(self.model)
        present = [parameter.detach().clone() for parameter in actor]
        self.assign(self.averages or present)
        try:
            yield
        finally:
            self.assign(present)

    def assign(self, values: list[torch.Tensor]) -> None:
        """Give the actor these parameters."""
        with torch.no_grad():
            for parameter, value in zip(actor_parameters(self.model), values, strict=True):
                parameter.copy_(value)

    def _on_training_start(self) -> None:
        self._bar = tqdm(
            total=self._arguments.timesteps,
            initial=self.num_timesteps,
            desc="training",
            unit="decision",
            smoothing=0.05,
        )
        self._next = (self.num_timesteps // self._every + 1) * self._every

    def _on_rollout_start(self) -> None:
        # Given, not learned: a policy that may keep its noise learns to lean on it, and stalls without.
        self.average()
        a = self._arguments
        share = min(self.num_timesteps / a.timesteps, 1.0)
        for parameter in actor_parameters(self.model):  # a critic that knows nothing yet would spoil a clone
            parameter.requires_grad_(not a.demonstrations or share >= a.critic_first)
        deviation = a.exploration * (a.last_exploration / a.exploration) ** share
        self.model.policy.log_std.data.fill_(math.log(deviation))

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        episodes = self.model.ep_info_buffer or []
        if episodes:
            mean_return = float(np.mean([episode["r"] for episode in episodes]))
            success = float(np.mean(self.model.ep_success_buffer or [0.0]))
            self.curve.append({"decisions": float(self.num_timesteps), "return": mean_return, "success": success})
            self._bar.set_postfix_str(f"return {mean_return:.2f}, success {success:.2f}")
        if self.num_timesteps >= self._next:
            self._next += self._every
            self.validate()
        self._bar.update(min(self.num_timesteps, self._bar.total) - self._bar.n)
        if time.monotonic() - self._saved > self._arguments.checkpoint_seconds:
            save(self.model, self._run / "checkpoint.zip")
            write_csv(self._run / "learning_curve.csv", self.curve)
            self._saved = time.monotonic()

    def validate(self) -> None:
        """Try the agent on the validation specimens, and keep it if it is the best so far."""
        best = max((point.get("validation_return", -np.inf) for point in self.curve), default=-np.inf)
        with self.averaged():
            mean_return, success = validate(self.model, self._arguments)
            if self.curve:  # else no cut has been finished yet
                self.curve[-1] |= {"validation_return": mean_return, "validation_success": success}
            if mean_return > best:
                save(self.model, self._run / "policy.zip")
                write_csv(self._run / "learning_curve.csv", self.curve)

    def _on_training_end(self) -> None:
        self._bar.close()


def save(model: Any, path: Path) -> None:
    """Save a model all at once: an interruption leaves the last whole checkpoint."""
    with replacing(path) as part:
        model.save(part)
