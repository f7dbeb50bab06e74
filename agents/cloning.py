"""Behaviour cloning: train a policy network to imitate a script, alone or before reinforcement learning.

The script acts with some noise, so that the clone learns how to recover from small mistakes; the targets are the
actions that the script would have taken without noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch.nn.utils.rnn import pad_sequence
from tqdm import tqdm
from vectorised import CutVecEnv

from cutenv.policy import Policy
from cutenv.task.observation import SPEED_SCALE

_REST = 1e-6 / SPEED_SCALE  # an action's speed below which it means rest

Batch = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
"""Inputs, shape (..., size), target actions, shape (..., 2), and weights 1 or 0, shape (...)."""


class Demonstrations(NamedTuple):
    """Decisions of a script in n environments, in order."""

    shown: np.ndarray
    """Features from the environments, shape (decisions, n, size)."""
    taught: np.ndarray
    """Actions that the script would take, shape (decisions, n, 2)."""
    begun: np.ndarray
    """True where a cut begins, shape (decisions, n)."""

    def decisions(self) -> Lessons:
        """Return the decisions one by one, for a feed-forward network."""
        return Lessons(self.shown.reshape(-1, self.shown.shape[-1]), self.taught.reshape(-1, self.taught.shape[-1]))

    def cuts(self) -> CutLessons:
        """Return the decisions cut by cut, unfinished ones too, for a recurrent network."""
        result = CutLessons([], [])
        for n in range(self.begun.shape[1]):
            beginnings = np.flatnonzero(self.begun[:, n])
            for first, last in zip(beginnings, (*beginnings[1:], len(self.begun)), strict=True):
                result.shown.append(torch.as_tensor(self.shown[first:last, n]))
                result.taught.append(torch.as_tensor(self.taught[first:last, n]))
        return result


class Lessons:
    """Data set of decisions and target actions; ``batch_size`` counts decisions."""

    def __init__(self, shown: np.ndarray, taught: np.ndarray) -> None:
        self.shown, self.taught = torch.as_tensor(shown), torch.as_tensor(taught)

    def count(self, batch_size: int) -> int:
        """Return the number of batches in an epoch."""
        return -(-len(self.shown) // batch_size)

    def batches(self, batch_size: int, generator: torch.Generator) -> Iterator[Batch]:
        """Yield all decisions once, in random order."""
        for batch in torch.randperm(len(self.shown), generator=generator).split(batch_size):
            yield self.shown[batch], self.taught[batch], torch.ones(len(batch))


class CutLessons(NamedTuple):
    """Data set of whole cuts, shapes (decisions, size) and (decisions, 2), padded to the longest of a batch."""

    shown: list[torch.Tensor]
    taught: list[torch.Tensor]

    def _groups(self, batch_size: int) -> list[list[int]]:
        """Group cuts of similar length, so that little is padded: about ``batch_size`` decisions in each group."""
        groups: list[list[int]] = [[]]
        for cut in sorted(range(len(self.shown)), key=lambda n: len(self.shown[n])):
            if groups[-1] and (len(groups[-1]) + 1) * len(self.shown[cut]) > batch_size:
                groups.append([])
            groups[-1].append(cut)
        return groups

    def count(self, batch_size: int) -> int:
        """Return the number of batches in an epoch."""
        return len(self._groups(batch_size))

    def batches(self, batch_size: int, generator: torch.Generator) -> Iterator[Batch]:
        """Yield all cuts once, the batches in random order; axes (decision, cut, ...)."""
        groups = self._groups(batch_size)
        for k in torch.randperm(len(groups), generator=generator).tolist():
            counts = [torch.ones(len(self.shown[n])) for n in groups[k]]
            yield (
                pad_sequence([self.shown[n] for n in groups[k]]),
                pad_sequence([self.taught[n] for n in groups[k]]),
                pad_sequence(counts),
            )


def before_dead_zone(actions: np.ndarray, width: float) -> np.ndarray:
    """Invert the dead zone: return actions, shape (n, 2), that :func:`cutenv.policy.past_dead_zone` maps to these."""
    result = np.array(actions, np.float32)
    speed = result[:, 0]
    moved = np.copysign(np.abs(speed) * (1.0 - width) + width, speed)
    result[:, 0] = np.where(np.abs(speed) < _REST, 0.0, moved)
    return result


def demonstrations(
    environments: CutVecEnv, make_script: Callable[[], Policy], *, decisions: int, noise: float, seed: int
) -> Demonstrations:
    """Record ``decisions`` in all; noise of standard deviation ``noise`` is added to the actions in every other cut."""
    rng = np.random.default_rng(seed)
    count = environments.num_envs
    scripts = [make_script() for _ in range(count)]
    for script in scripts:
        script.reset(rng)
    amount = np.where(np.arange(count) % 2, noise, 0.0)[:, None]
    seen, begins = environments.reset(), np.ones(count, bool)
    shown, taught, begun = [], [], []
    for _ in tqdm(range(-(-decisions // count)), desc="demonstrating", unit="decision", unit_scale=count):
        wanted = np.stack([script(o) for script, o in zip(scripts, environments.observations, strict=True)])
        label = before_dead_zone(wanted, environments.dead_zone)
        shown.append(seen)
        taught.append(label)
        begun.append(begins)
        seen, _, begins, _ = environments.step(label + amount * rng.standard_normal(label.shape).astype(np.float32))
        begins = np.array(begins)
        for n in np.flatnonzero(begins):
            scripts[n].reset(rng)
    return Demonstrations(np.stack(shown), np.stack(taught), np.stack(begun))


class Cloning:
    """Least-squares training of a network on demonstrations, epoch after epoch.

    An epoch's order depends only on seed and number, so that an interrupted cloning continues without a difference.

    Parameters
    ----------
    network : callable
        Network from features to actions.
    parameters : list of torch.nn.Parameter
        Parameters of the network that are trained.
    lessons : Lessons or CutLessons
        Data set of demonstrations.
    epochs, batch_size, learning_rate, seed
        Hyperparameters; the learning rate falls along half a cosine to zero.
    """

    def __init__(
        self,
        network: Callable[[torch.Tensor], torch.Tensor],
        parameters: list[torch.nn.Parameter],
        lessons: Lessons | CutLessons,
        *,
        epochs: int = 30,
        batch_size: int = 1024,
        learning_rate: float = 2e-3,
        seed: int = 0,
    ) -> None:
        self._network, self._lessons = network, lessons
        self._epochs, self._batch_size, self._rate, self._seed = epochs, batch_size, learning_rate, seed
        self.optimizer = torch.optim.Adam(parameters, lr=learning_rate)
        self.epoch = 0
        """Number of epochs done."""

    def go_on(self) -> None:
        """Train for one epoch."""
        generator = torch.Generator().manual_seed(1000 * self._seed + self.epoch)
        per_epoch = self._lessons.count(self._batch_size)
        for k, batch in enumerate(self._lessons.batches(self._batch_size, generator)):
            share = (self.epoch + k / per_epoch) / self._epochs
            for group in self.optimizer.param_groups:
                group["lr"] = 0.5 * self._rate * (1.0 + math.cos(math.pi * share))
            squares, counted = self._squares(batch)
            self.optimizer.zero_grad()
            (squares / counted).backward()
            self.optimizer.step()
        self.epoch += 1

    def error(self) -> float:
        """Return the root mean square difference between the network's actions and the targets."""
        total = counted = 0.0
        with torch.no_grad():
            for batch in self._lessons.batches(self._batch_size, torch.Generator().manual_seed(0)):
                squares, own = self._squares(batch)
                total, counted = total + float(squares), counted + float(own)
        return math.sqrt(total / counted)

    def _squares(self, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
        shown, taught, counts = batch
        return (((self._network(shown) - taught) ** 2).mean(-1) * counts).sum(), counts.sum()


def clone(
    network: Callable[[torch.Tensor], torch.Tensor],
    parameters: list[torch.nn.Parameter],
    lessons: Lessons | CutLessons,
    *,
    epochs: int = 30,
    batch_size: int = 1024,
    learning_rate: float = 2e-3,
    seed: int = 0,
) -> float:
    """Run all epochs, see :class:`Cloning`; return the root mean square error."""
    cloning = Cloning(
        network, parameters, lessons, epochs=epochs, batch_size=batch_size, learning_rate=learning_rate, seed=seed
    )
    for _ in tqdm(range(epochs), desc="cloning", unit="epoch"):
        cloning.go_on()
    return cloning.error()
