"""Look-ahead over sampled tissues: what the best place to stop is worth that the force so far can tell.

    python -m scripts.benchmarks.policies.learned_stop  5000 training and 4000 held-out specimens, some five minutes

What a stop earns depends on the tissue ahead, which nobody sees.  But over thousands of tissues drawn like the one at
hand, the agent's features tell what stopping here and what going on earn on average: optimal stopping by regression
(Longstaff and Schwartz, *Valuing American options by simulation*, 2001).  The script "return stroke" cuts training
specimens with the stop at each of 21 places; a network learns both values, and stops a cut where stopping earns more.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from cutenv._base.arrays import Array, Array32, Indices
from cutenv.agents.learning.seeds import TEST_SEEDS, TRAINING_SEEDS
from cutenv.agents.learning.statistics import by_policy, differences
from cutenv.agents.policy import BASELINES, Features, OneReturnStroke, StopAndUnload
from cutenv.agents.policy.interface import DISTANCE_COLUMN, POSITION_COLUMN, SPEED_COLUMN, ArrayPolicy, in_si
from cutenv.agents.policy.scripted import coasting
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import CutBatch
from cutenv.task.observation import COMPONENTS
from scripts.benchmarks.policies import ladder
from scripts.tables import interval_text, keep, kept_rows, markdown_table, mean_text

FILE = "learned_stop.csv"
SCRIPT, LEARNED = "return stroke", "return stroke with a learned stop"
HZ = 25
SPACING = 0.0016  # [m]
PLACES = np.arange(-0.004, 0.0285, SPACING)
"""Places of a stop: distances beyond the target at which the blade comes to rest [m]; it leads the tip."""
TOGETHER = 1000  # cuts of a batch
ROUNDS, EPOCHS, LAST_EPOCHS = 7, 5, 15
BATCH, RATE, UNITS = 1024, 3e-3, 128
LEAST = 0.05  # deviation of a feature that hardly changes
_LAST_SPEED = [component.name for component in COMPONENTS].index("last_speed")

Flags = NDArray[np.bool_]


class StopByRule(ArrayPolicy):
    """The script *return stroke*, but for its stop: that is up to :meth:`stops`."""

    def __init__(self) -> None:
        unloading = StopAndUnload(margin=-0.05, retreat_speed=0.012)  # beyond any place of a stop
        self._script = OneReturnStroke(held=ladder.NEVER, unloading=unloading)

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        self._script.begin(rngs)
        self._features = Features(len(rngs), history=0)
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
        feeding = (seen[:, SPEED_COLUMN] > 0.0) & (seen[:, _LAST_SPEED] > 0.0)
        advancing = feeding & (seen[:, POSITION_COLUMN] >= self._furthest) & (beyond >= PLACES[0])
        self._furthest = np.maximum(self._furthest, seen[:, POSITION_COLUMN])
        self._script.unloading.stop(advancing & self.stops(shown, beyond, advancing))
        return self._script.act(observations)

    def stops(self, shown: Array32, beyond: Array, advancing: Flags) -> Flags:
        """Return where to stop now, shape (n,), by features and place, shape (n, size), and the place alone [m]."""
        raise NotImplementedError


class StopAt(StopByRule):
    """A stop at one place of each cut, shape (n,) [m]; remembers what was seen there, NaN before."""

    def __init__(self, places: Array) -> None:
        super().__init__()
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
    """A stop where a network says that stopping earns more than going on."""

    def __init__(self, values: nn.Module) -> None:
        super().__init__()
        self._values = values

    def stops(self, shown: Array32, beyond: Array, advancing: Flags) -> Flags:
        """Return where stopping earns more."""
        with torch.no_grad():
            earned = self._values(torch.as_tensor(shown)).numpy()
        return (earned[:, 0] >= earned[:, 1]) | (beyond >= PLACES[-1])


def cut(policy: ArrayPolicy, seeds: Sequence[int], hz: int) -> tuple[Array32, Flags]:
    """Return returns and successes of the cuts of these seeds, shape (n,) each."""
    batch = CutBatch(len(seeds), GentleCutEnv(specimen_class="mixed", control_hz=hz))
    batch.give_seeds(seeds, np.arange(len(seeds)), np.random.default_rng())
    batch.begin(np.arange(len(seeds)))
    policy.begin([np.random.default_rng(seed) for seed in seeds])
    returns, ended = np.zeros(len(seeds), np.float32), np.zeros(len(seeds), bool)
    while not ended.all():
        rewards, ends = batch.decide(policy.act(batch.observations), ended)
        returns += np.where(ended, 0.0, rewards)
        ended |= ends != 0
    return returns, batch.succeeded()


def learn_stop(specimens: int) -> LearnedStop:
    """Return the script with the stop that it learns from training specimens."""
    returns, shown = [], []
    rng = np.random.default_rng(0)
    seeds = TRAINING_SEEDS[-specimens:]
    shifts = SPACING * rng.random(specimens)  # each cut has places of its own, so that all are tried
    for place in tqdm(PLACES, desc="stopping everywhere", unit="place"):
        parts = []
        for first in range(0, specimens, TOGETHER):
            policy = StopAt(place + shifts[first : first + TOGETHER])
            parts.append((cut(policy, seeds[first : first + TOGETHER], HZ)[0], policy.shown))
        returns.append(np.concatenate([own for own, _ in parts]))
        shown.append(np.concatenate([seen for _, seen in parts]))
    return LearnedStop(fit_values(np.stack(returns), np.stack(shown)))


def fit_values(returns: Array32, shown: Array32) -> nn.Module:
    """Fit the returns of stopping now and of going on, from stops at successive places.

    ``returns`` has shape (places, n); ``shown``, shape (places, n, size), is NaN where a cut had ended before. The
    network has two outputs, for shape (n, size).
    """
    torch.manual_seed(0)
    there = np.isfinite(shown).all(axis=2)
    seen = torch.as_tensor(shown[there])
    # What going on earns depends on the later stops, which the network decides: from round to round better.
    going_on = returns.max(axis=0) - np.zeros_like(returns)
    for k in tqdm(range(ROUNDS), desc="weighing stops", unit="round"):
        targets = torch.as_tensor(np.stack([returns[there], going_on[there]], axis=1))
        values = _fitted(seen, targets, LAST_EPOCHS if k == ROUNDS - 1 else EPOCHS)
        with torch.no_grad():
            earned = values(seen).numpy()
        stop = np.zeros(returns.shape, bool)
        stop[there] = earned[:, 0] >= earned[:, 1]
        going_on, later = np.empty_like(returns), returns[-1]
        for place in reversed(range(len(returns))):
            going_on[place] = later
            later = np.where(stop[place], returns[place], later)
    return values


class _Standardised(nn.Module):
    """Subtract the mean, and divide by the deviation, of what was seen."""

    def __init__(self, seen: torch.Tensor) -> None:
        super().__init__()
        self._mean, self._deviation = seen.mean(0), seen.std(0).clamp(min=LEAST)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        return (values - self._mean) / self._deviation


def _fitted(seen: torch.Tensor, targets: torch.Tensor, epochs: int) -> nn.Module:
    """Return a network that is fitted to the targets, shape (n, 2)."""
    layers = (nn.Linear(seen.shape[1], UNITS), nn.SiLU(), nn.Linear(UNITS, UNITS), nn.SiLU(), nn.Linear(UNITS, 2))
    values = nn.Sequential(_Standardised(seen), *layers)
    optimizer = torch.optim.AdamW(values.parameters(), weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=epochs * -(-len(seen) // BATCH))
    for _ in range(epochs):
        for chosen in torch.randperm(len(seen)).split(BATCH):
            loss = nn.functional.mse_loss(values(seen[chosen]), targets[chosen])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
    return values


def measure(specimens: int, held_out: int) -> list[dict[str, Any]]:
    """Return one row for each policy and held-out specimen."""
    policies = {LEARNED: (learn_stop(specimens), HZ), SCRIPT: (BASELINES[SCRIPT](), 50)}
    rows = []
    for name, (policy, hz) in policies.items():
        for first in range(0, held_out, TOGETHER):
            seeds = TEST_SEEDS[first : min(first + TOGETHER, held_out)]
            returns, successes = cut(policy, seeds, hz)
            rows += [
                {"policy": name, "seed": seed, "return": value, "success": float(success)}
                for seed, value, success in zip(seeds, returns.tolist(), successes.tolist(), strict=True)
            ]
    return rows


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the comparison as a Markdown table."""
    paired = {row["score"]: row for row in differences(rows, LEARNED)}
    lines = []
    for name, own in by_policy(rows).items():
        success = 100.0 * np.mean([row["success"] for row in own])
        gain, more = (
            interval_text(paired[score], digits, "+", factor) if name == LEARNED else "–"
            for score, digits, factor in (("return", 3, 1.0), ("success", 1, 100.0))
        )
        lines.append((name, mean_text(row["return"] for row in own), f"{success:.1f}", gain, more))
    head = ("policy", "return", "success [%]", "return minus the script", "success minus the script [points]")
    made = f"Class mixed, {paired['return']['cuts']} held-out specimens; mean [95 % interval]."
    return f"{made}\n\n{markdown_table(head, lines)}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=5000, metavar="N", help="training specimens; default 5000")
    parser.add_argument("--held-out", type=int, default=4000, metavar="N", help="held-out specimens; default 4000")
    parser.add_argument("--out", type=Path, default=ladder.FOLDER, metavar="FOLDER", help="folder of the result")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if not arguments.print:
        torch.set_num_threads(1)
        rows = measure(arguments.specimens, arguments.held_out)
        keep(arguments.out / FILE, rows)
    print(report(kept_rows(arguments.out / FILE, "scripts.benchmarks.policies.learned_stop")), flush=True)
