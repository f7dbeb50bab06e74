"""A teacher that has learned when to stop: by cutting each specimen again and again, with the stop at other places.

What a stop earns depends on the tissue ahead, which nobody sees.  But over thousands of specimens drawn like the one at
hand, the features tell what stopping here and what going on earn on average: optimal stopping by regression (Longstaff
and Schwartz, *Valuing American options by simulation*, 2001).  The rest of the cut is that of the script.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from cutenv._base.arrays import Array, Array32, Indices
from cutenv.envs.batch import CutBatch
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.learning.arguments import MAX_ENVIRONMENTS, LearnerArguments
from cutenv.policy import Features, OneReturnStroke, StopAndUnload
from cutenv.policy.interface import ArrayPolicy
from cutenv.policy.signals import DISTANCE_COLUMN, LAST_SPEED_COLUMN, POSITION_COLUMN, SPEED_COLUMN, in_si
from cutenv.policy.unloading import coasting

Flags = NDArray[np.bool_]
SPACING = 0.0016  # [m]
PLACES = np.arange(-0.004, 0.0285, SPACING)
"""Places of a stop: distances beyond the target at which the blade comes to rest [m]; it leads the tip."""
_NEVER = 10.0  # multiples of the resistance: no tip counts as held
_EPISODE = 1_000_000  # first episode of these specimens, which no training reaches
_ROUNDS, _EPOCHS, _LAST_EPOCHS = 7, 5, 15
_LEAST = 0.05  # deviation of a feature that hardly changes
_BATCH, _RATE, _UNITS = 1024, 3e-3, 128


class StopByRule(ArrayPolicy):
    """The script *return stroke*, but for its stop: that is up to :meth:`stops`.

    Parameters
    ----------
    arguments : LearnerArguments
        Options of the learner, whose features the rule sees.
    """

    def __init__(self, arguments: LearnerArguments) -> None:
        self._arguments = arguments
        unloading = StopAndUnload(margin=-0.05, retreat_speed=0.012)  # beyond any place of a stop
        self._script = OneReturnStroke(held=_NEVER, unloading=unloading)

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        self._script.begin(rngs)
        self._features = Features(len(rngs), **self._arguments.features)
        self._furthest = np.zeros(len(rngs))

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self._script.forget(cuts)
        self._features.forget(cuts)
        self._furthest[cuts] = 0.0

    def act(self, observations: Array32) -> Array32:
        """Return the actions, shape (n, 2), for the observations of all cuts, shape (n, 12)."""
        seen = in_si(observations)
        beyond = coasting(seen[:, SPEED_COLUMN]) - seen[:, DISTANCE_COLUMN]
        shown = np.column_stack([self._features(observations), 100.0 * beyond]).astype(np.float32)
        # During the return stroke, and where the blade then comes back, no stop was tried, and nothing is known of it.
        feeding = (seen[:, SPEED_COLUMN] > 0.0) & (seen[:, LAST_SPEED_COLUMN] > 0.0)
        advancing = feeding & (seen[:, POSITION_COLUMN] >= self._furthest)
        self._furthest = np.maximum(self._furthest, seen[:, POSITION_COLUMN])
        self._script.unloading.stop(advancing & (beyond >= PLACES[0]) & self.stops(shown, beyond, advancing))
        return self._script.act(observations)

    def stops(self, shown: Array32, beyond: Array, advancing: Flags) -> Flags:
        """Return where to stop now, shape (n,).

        Parameters
        ----------
        shown : array, shape (n, size)
            Features, and where the blade would come to rest.
        beyond : array, shape (n,)
            How far beyond the target it would come to rest [m].
        advancing : array of bool, shape (n,)
            Whether the blade moves forward over new ground.
        """
        raise NotImplementedError


class StopAt(StopByRule):
    """A stop at one place of each cut, shape (n,), beyond the target [m]; remembers what was seen there, NaN before."""

    def __init__(self, arguments: LearnerArguments, places: Array) -> None:
        super().__init__(arguments)
        self._places = places

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        super().begin(rngs)
        self.shown = np.full((len(rngs), self._features.size + 1), np.nan, np.float32)

    def stops(self, shown: Array32, beyond: Array, advancing: Flags) -> Flags:
        """Return where the place is reached."""
        now = advancing & (beyond >= self._places)
        first = now & np.isnan(self.shown[:, 0])
        self.shown[first] = shown[first]
        return now


class LearnedStop(StopByRule):
    """A stop where the network says that stopping earns more than going on.

    Parameters
    ----------
    arguments : LearnerArguments
        Options of the learner.
    values : nn.Module
        Network from what is shown to the returns of stopping now and of going on.
    """

    def __init__(self, arguments: LearnerArguments, values: nn.Module) -> None:
        super().__init__(arguments)
        self._values = values

    def stops(self, shown: Array32, beyond: Array, advancing: Flags) -> Flags:
        """Return where stopping earns more."""
        with torch.no_grad():
            earned = self._values(torch.as_tensor(shown)).numpy()
        now: Flags = (earned[:, 0] >= earned[:, 1]) | (beyond >= PLACES[-1])
        return now


def learn_stop(arguments: LearnerArguments) -> LearnedStop:
    """Return the teacher that has learned from ``arguments.stops`` specimens where to stop."""
    tried = [
        outcomes(arguments, place, _EPISODE + part, count)
        for part, count in enumerate(_parts(arguments.stops))
        for place in tqdm(PLACES, desc="learning when to stop", unit="place")
    ]
    by_place = [tried[k :: len(PLACES)] for k in range(len(PLACES))]
    returns = np.stack([np.concatenate([own for own, _ in parts]) for parts in by_place])
    shown = np.stack([np.concatenate([seen for _, seen in parts]) for parts in by_place])
    return LearnedStop(arguments, fit_values(returns, shown, arguments.seed))


def _parts(specimens: int) -> list[int]:
    """Split a number of specimens into batches, the last of which may be smaller."""
    whole, rest = divmod(specimens, MAX_ENVIRONMENTS)
    return [MAX_ENVIRONMENTS] * whole + [rest] * (rest > 0)


def outcomes(arguments: LearnerArguments, place: float, episode: int, count: int) -> tuple[Array32, Array32]:
    """Return the returns of stops near a place, shape (count,), and what was seen there, (count, size), NaN if nothing.

    The specimens are those of an episode of the run's seeds.  Each has places of its own, so that all are tried.
    """
    batch = CutBatch(count, GentleCutEnv(**arguments.environment))
    every, first = np.arange(count), arguments.seed * MAX_ENVIRONMENTS
    batch.give_seeds(range(first, first + count), every, np.random.default_rng())
    batch.begin(every, {"episode": episode})
    policy = StopAt(arguments, place + SPACING * np.random.default_rng(episode).random(count))
    policy.begin([np.random.default_rng(0)] * count)
    returns, ended = np.zeros(count, np.float32), np.zeros(count, bool)
    while not ended.all():
        rewards, ends = batch.decide(policy.act(batch.observations), ended)
        returns += np.where(ended, 0.0, rewards)
        ended |= ends != 0
    return returns, policy.shown


def fit_values(returns: Array32, shown: Array32, seed: int) -> nn.Module:
    """Fit the returns of stopping now and of going on, from stops at successive places.

    Parameters
    ----------
    returns : array, shape (places, n)
        Return of n cuts for each place of the stop.
    shown : array, shape (places, n, size)
        What was seen there; NaN where a cut ended before.
    seed : int
        Seed of the network.

    Returns
    -------
    nn.Module
        Network with two outputs, for shape (n, size).
    """
    generator = torch.Generator().manual_seed(seed)
    there = np.isfinite(shown).all(axis=2)
    seen = torch.as_tensor(shown[there])
    mean, deviation = seen.mean(0), seen.std(0).clamp(min=_LEAST)
    # What going on earns depends on the later stops, which the network decides: from round to round better.
    going_on = np.broadcast_to(returns.max(axis=0), returns.shape) - np.float32(0.05)
    for k in tqdm(range(_ROUNDS), desc="weighing stops", unit="round"):
        targets = torch.as_tensor(np.stack([returns[there], going_on[there]], axis=1))
        values = _fitted(seen, targets, mean, deviation, _LAST_EPOCHS if k == _ROUNDS - 1 else _EPOCHS, generator)
        with torch.no_grad():
            stop = np.zeros(returns.shape, bool)
            stop[there] = (lambda found: found[:, 0] >= found[:, 1])(values(seen)).numpy()
        going_on, later = np.empty_like(returns), returns[-1]
        for place in reversed(range(len(returns))):
            going_on[place] = later
            later = np.where(stop[place], returns[place], later)
    return values


class _Standardised(nn.Module):
    """Subtract a mean, and divide by a deviation."""

    def __init__(self, mean: torch.Tensor, deviation: torch.Tensor) -> None:
        super().__init__()
        self._mean, self._deviation = mean, deviation

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        return (values - self._mean) / self._deviation


def _fitted(
    seen: torch.Tensor,
    targets: torch.Tensor,
    mean: torch.Tensor,
    deviation: torch.Tensor,
    epochs: int,
    generator: torch.Generator,
) -> nn.Module:
    with torch.random.fork_rng():
        torch.manual_seed(int(torch.randint(2**31, (), generator=generator)))
        values = nn.Sequential(
            _Standardised(mean, deviation),
            nn.Linear(seen.shape[1], _UNITS), nn.SiLU(), nn.Linear(_UNITS, _UNITS), nn.SiLU(), nn.Linear(_UNITS, 2),
        )  # fmt: skip
    optimizer = torch.optim.AdamW(values.parameters(), weight_decay=1e-2)
    steps = epochs * -(-len(seen) // _BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _RATE, total_steps=steps)
    for _ in range(epochs):
        for chosen in torch.randperm(len(seen), generator=generator).split(_BATCH):  # type: ignore[no-untyped-call]
            loss = nn.functional.mse_loss(values(seen[chosen]), targets[chosen])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
    return values
