"""Fit of a policy network to demonstrations.

Alone or before it learns by trial.

The script that demonstrates acts with some noise, so that the clone learns how to come back from small mistakes; the
target is the action that the script would have taken without it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch.nn.utils.rnn import pad_sequence
from tqdm import tqdm

from cutenv.agents.learning.arguments import LearnerArguments
from cutenv.agents.learning.environment_groups import EnvironmentGroups
from cutenv.agents.policy import Policy
from cutenv.agents.policy.interface import as_array_policy
from cutenv.agents.sb3 import FeatureVecEnv

Batch = tuple[torch.Tensor, ...]
"""Observations, shape (..., size), actions, shape (..., k), and further parts; of cuts, weights 1 or 0, shape (...)."""


class Transitions(NamedTuple):
    """Decisions with their outcomes, for learners that estimate values."""

    observations: np.ndarray  # features, shape (decisions, size)
    actions: np.ndarray  # actions as they were taken, shape (decisions, k)
    rewards: np.ndarray  # rewards, shape (decisions,)
    next_observations: np.ndarray  # features at the next decision, shape (decisions, size); of the next cut at an end
    ends: np.ndarray  # True where the cut ended, shape (decisions,)


class Demonstrations(NamedTuple):
    """Consecutive decisions of a script in n environments."""

    observations: np.ndarray  # features from the environments, shape (decisions, n, size)
    actions: np.ndarray  # actions of the script without noise, shape (decisions, n, k)
    starts: np.ndarray  # True where a cut begins, shape (decisions, n)
    taken: np.ndarray  # actions as they were taken, with the noise, shape (decisions, n, k)
    rewards: np.ndarray  # rewards, shape (decisions, n)

    def transitions(self) -> Transitions:
        """Return all decisions except each environment's last, whose successor is unknown."""
        size = self.observations.shape[-1]
        return Transitions(
            self.observations[:-1].reshape(-1, size),
            self.taken[:-1].reshape(-1, self.taken.shape[-1]),
            self.rewards[:-1].reshape(-1),
            self.observations[1:].reshape(-1, size),
            self.starts[1:].reshape(-1),
        )

    def by_decision(self) -> DecisionDataset:
        """Return single decisions, for a network without memory."""
        return DecisionDataset(
            self.observations.reshape(-1, self.observations.shape[-1]), self.actions.reshape(-1, self.actions.shape[-1])
        )

    def by_cut(self) -> CutDataset:
        """Return whole cuts, including unfinished ones, for recurrent networks."""
        result = CutDataset([], [])
        for n in range(self.starts.shape[1]):
            starts = np.flatnonzero(self.starts[:, n])
            for first, last in zip(starts, (*starts[1:], len(self.starts)), strict=True):
                result.observations.append(torch.as_tensor(self.observations[first:last, n]))
                result.actions.append(torch.as_tensor(self.actions[first:last, n]))
        return result


class DecisionDataset:
    """Observations, the actions to take, and what else is known of each decision; ``batch_size`` counts decisions."""

    def __init__(self, observations: np.ndarray, actions: np.ndarray, *further: np.ndarray) -> None:
        self.parts = [torch.as_tensor(part) for part in (observations, actions, *further)]
        self.observations, self.actions = self.parts[:2]

    def count(self, batch_size: int) -> int:
        """Return the number of batches of an epoch."""
        return -(-len(self.observations) // batch_size)

    def batches(self, batch_size: int, generator: torch.Generator) -> Iterator[Batch]:
        """Yield every decision once, in random order."""
        order = torch.randperm(len(self.observations), generator=generator)
        for batch in order.split(batch_size):  # type: ignore[no-untyped-call]
            yield tuple(part[batch] for part in self.parts)


class CutDataset(NamedTuple):
    """Data set of whole cuts, padded to the longest per batch.

    Their shapes are (decisions, size) and (decisions, k).
    """

    observations: list[torch.Tensor]
    actions: list[torch.Tensor]

    def _groups(self, batch_size: int) -> list[list[int]]:
        """Group cuts of similar length, about ``batch_size`` decisions each, to limit padding."""
        groups: list[list[int]] = [[]]
        for cut in sorted(range(len(self.observations)), key=lambda n: len(self.observations[n])):
            if groups[-1] and (len(groups[-1]) + 1) * len(self.observations[cut]) > batch_size:
                groups.append([])
            groups[-1].append(cut)
        return groups

    def count(self, batch_size: int) -> int:
        """Return the number of batches of an epoch."""
        return len(self._groups(batch_size))

    def batches(self, batch_size: int, generator: torch.Generator) -> Iterator[Batch]:
        """Yield every cut once, in random batches, axes (decision, cut, ...)."""
        groups = self._groups(batch_size)
        for k in torch.randperm(len(groups), generator=generator).tolist():
            weights = [torch.ones(len(self.observations[n])) for n in groups[k]]
            yield (
                pad_sequence([self.observations[n] for n in groups[k]]),
                pad_sequence([self.actions[n] for n in groups[k]]),
                pad_sequence(weights),
            )


def demonstrations(
    environments: FeatureVecEnv | EnvironmentGroups,
    make_script: Callable[[], Policy],
    *,
    decisions: int,
    noise: float,
    seed: int,
) -> Demonstrations:
    """Let a script cut in all environments, which are reset first.

    ``decisions`` are those of all, rounded up to a multiple of their number; noise of this standard deviation is added
    to the actions in every other environment.
    """
    rng = np.random.default_rng(seed)
    count = environments.num_envs
    script = as_array_policy(make_script())
    script.begin([rng] * count)
    amount = np.where(np.arange(count) % 2, noise, 0.0)[:, None]
    shown, starts = environments.reset(), np.ones(count, bool)
    lessons: list[tuple[np.ndarray, ...]] = []
    for _ in tqdm(range(-(-decisions // count)), desc="demonstrating", unit="decision", unit_scale=count):
        actions = script.act(environments.observations)
        noisy = actions + amount * rng.standard_normal(actions.shape).astype(np.float32)
        taken = np.clip(noisy, -1.0, 1.0).astype(np.float32)  # what the environment makes of it
        environments.step_async(noisy)
        after, rewards, ended, _ = environments.step_wait()
        lessons.append((shown, actions, starts, taken, rewards))
        shown, starts = after, np.array(ended)
        script.forget(np.flatnonzero(starts))
    return Demonstrations(*map(np.stack, zip(*lessons, strict=True)))


def script_demonstrations(
    environments: FeatureVecEnv | EnvironmentGroups, arguments: LearnerArguments
) -> Demonstrations:
    """Let the options' script cut in all environments, with their noise."""
    return demonstrations(
        environments,
        arguments.learned_task.scripts[arguments.script],
        decisions=arguments.demonstrations,
        noise=arguments.demonstration_noise,
        seed=arguments.seed,
    )


class FitNumbers(NamedTuple):
    """Hyperparameters of a fit."""

    epochs: int
    batch_size: int
    learning_rate: float
    seed: int


class EpochFit(ABC):
    """Fit of parameters to a data set, epoch by epoch; the rate of learning falls along half a cosine to zero.

    The order of an epoch depends only on the seed and the number of the epoch, so that a resumed fit gives the same
    network as one that was not interrupted.
    """

    def __init__(
        self, parameters: list[torch.nn.Parameter], dataset: DecisionDataset | CutDataset, numbers: FitNumbers
    ) -> None:
        self._dataset = dataset
        self._epochs, self._batch_size, self._rate, self._seed = numbers
        self.optimizer = torch.optim.Adam(parameters, lr=self._rate)
        self.epoch = 0  # number of completed epochs

    def run_epoch(self) -> None:
        """Go through the data set once."""
        generator = torch.Generator().manual_seed(1000 * self._seed + self.epoch)
        per_epoch = self._dataset.count(self._batch_size)
        for k, batch in enumerate(self._dataset.batches(self._batch_size, generator)):
            share = (self.epoch + k / per_epoch) / self._epochs
            for group in self.optimizer.param_groups:
                group["lr"] = 0.5 * self._rate * (1.0 + math.cos(math.pi * share))
            loss = self.loss(batch)
            self.optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            self.stepped()
        self.epoch += 1

    @abstractmethod
    def loss(self, batch: Batch) -> torch.Tensor:
        """Return the loss of a batch."""

    def stepped(self) -> None:  # noqa: B027
        """Do what follows a gradient step, if anything does."""

    @abstractmethod
    def error(self) -> float:
        """Return the root mean square error of the actions."""


class Cloning(EpochFit):
    """Least-squares fit of a network to demonstrated actions."""

    def __init__(
        self,
        network: Callable[[torch.Tensor], torch.Tensor],
        parameters: list[torch.nn.Parameter],
        dataset: DecisionDataset | CutDataset,
        *,
        epochs: int = 15,
        batch_size: int = 256,
        learning_rate: float = 2e-3,
        seed: int = 0,
    ) -> None:
        super().__init__(parameters, dataset, FitNumbers(epochs, batch_size, learning_rate, seed))
        self._network = network

    def run(self) -> float:
        """Run all epochs; return the remaining root mean square error."""
        for _ in tqdm(range(self._epochs), desc="cloning", unit="epoch"):
            self.run_epoch()
        return self.error()

    def loss(self, batch: Batch) -> torch.Tensor:
        """Return the mean square error of the actions."""
        squares, count = self._squares(batch)
        return squares / count

    def error(self) -> float:
        """Return the root mean square error of the network's actions."""
        total = counted = 0.0
        with torch.no_grad():
            for batch in self._dataset.batches(self._batch_size, torch.Generator().manual_seed(0)):
                squares, count = self._squares(batch)
                total, counted = total + float(squares), counted + float(count)
        return math.sqrt(total / counted)

    def _squares(self, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
        observations, actions, *further = batch
        weights = further[0] if further else torch.ones(len(actions))
        return (((self._network(observations) - actions) ** 2).mean(-1) * weights).sum(), weights.sum()
