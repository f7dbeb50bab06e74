"""Planners with truth for tasks that add a third action and a map of the cut to gentle cutting."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Array32, Indices, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.parallel import parallel_for
from cutenv.cutting.dtypes import READING
from cutenv.policy.interface import ArrayPolicy
from cutenv.policy.planner import Search
from cutenv.task.declare import Cuts, Task
from cutenv.task.episode import Episode
from cutenv.task.info import INFO
from cutenv.task.stepper import Decision, step_some

_NO_READINGS = np.zeros((0, 0), READING)


class ThirdPlan(NamedTuple):
    """Numbers of a plan for the third action: where the search begins, its steps, and its range; each of shape (m,)."""

    first: tuple[float, ...]
    step: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


class MapSearch:
    """Random local search over plans of whole cuts, each simulated as it would be.

    Parameters
    ----------
    cuttings : sequence of Episode
        Cuts at their start, of one rate and deadline; they are copied and not changed.
    """

    task: ClassVar[Task]
    """Task of the cuts."""
    third: ClassVar[ThirdPlan]
    """Plan of the third action."""

    def __init__(self, cuttings: Sequence[Any]) -> None:
        for cutting in cuttings:
            if not getattr(cutting, "simulated", False) or cutting.options.task is not self.task:
                raise TypeError(f"plans need a simulated episode of {self.task.environment}, got {cutting!r}.")
        self.plain = self.new_plain(cuttings)
        nothing = np.zeros(1, self.task.known)
        self._starts = Cuts.together([cutting.snapshot()._replace(known=nothing) for cutting in cuttings])
        self._targets = [cutting.target_length for cutting in cuttings]
        self._ticks = cuttings[0].ticks
        self._decisions = math.ceil(1e3 * cuttings[0].deadline / self._ticks)

    def new_plain(self, cuttings: Sequence[Any]) -> Search:
        """Return a search over plans of the motion along the cut alone, where this one begins."""
        return Search(*cuttings)

    @abstractmethod
    def choose(self, plans: StructArray, third: Array, cuts: Cuts, waits: NDArray[np.bool_], actions: Array) -> None:
        """Fill the actions, shape (n, 3), of n plans at the present states of their cuts; not of those that wait."""

    def roll_out(self, plans: StructArray, third: Array, each: int, *, recorded: bool = False) -> tuple[Array, Array32]:
        """Simulate ``each`` plans for every cut; return their returns, and the actions, (n, decisions, 3), if asked."""
        count = len(plans)
        cuts = self._starts.repeated(each)
        plans["stopping"] = plans["leader"] = 0
        actions, returns, waits = np.zeros((count, 3)), np.zeros(count), np.zeros(count, bool)
        observations, infos = np.zeros((count, len(self.task.all_components)), np.float32), np.zeros(count, INFO)
        rewards, ends = np.zeros(count), np.zeros(count, np.int64)
        kept = np.zeros((count, self._decisions, 3), np.float32) if recorded else np.zeros((0, 0, 3), np.float32)
        decided = Decision(self._ticks, waits, actions, observations, rewards, ends, infos, _NO_READINGS)
        for decision in range(self._decisions):
            self.choose(plans, third, cuts, waits, actions)
            if recorded:
                kept[:, decision] = actions
            parallel_for(step_some(self.task), count, cuts, decided)
            returns += rewards
            waits |= ends != 0
            if waits.all():
                break
        return returns, kept

    def best(
        self, rngs: Sequence[np.random.Generator], *, rounds: int, offspring: int = 12
    ) -> tuple[StructArray, Array, Array]:
        """Search for ``rounds`` rounds; return the best plan of each cut, its third part, and its return."""
        count, rows = len(self._targets), np.arange(len(self._targets))
        found = self.plain.best(rngs, rounds=max(rounds // 2, 1))
        plans, third = np.concatenate([plan for plan, _ in found]), np.tile(self.third.first, (count, 1))
        returns, _ = self.roll_out(plans, third, 1)
        size = np.ones(count)
        for _ in range(rounds):
            tried = [
                self.plain.varied(plans[k : k + 1], self._targets[k], size[k], offspring, rngs[k]) for k in range(count)
            ]
            thirds = [self._varied(third[k], size[k], offspring, rngs[k]) for k in range(count)]
            values, _ = self.roll_out(np.concatenate(tried), np.concatenate(thirds), offspring)
            best = values.reshape(count, offspring).argmax(axis=1)
            better = values.reshape(count, offspring)[rows, best] > returns
            for k in np.flatnonzero(better).tolist():
                plans[k], third[k] = tried[k][best[k]], thirds[k][best[k]]
                returns[k] = values[offspring * k + best[k]]
            size = np.where(better, np.minimum(1.3 * size, 1.0), np.maximum(0.7 * size, 0.05))
        return plans, third, returns

    def _varied(self, third: Array, size: float, count: int, rng: np.random.Generator) -> Array:
        """Return ``count`` mutations of the third part of a plan, shape (count, m)."""
        shape = count, len(self.third.first)
        steps = size * np.array(self.third.step) * rng.standard_normal(shape)
        varied: Array = third + steps * (rng.random(shape) < 0.5)
        return np.clip(varied, self.third.low, self.third.high)


class MapPlanner(ArrayPolicy):
    """An oracle that knows the specimen and plans the whole cut.

    Its plans come from a search, so the true optimum is better.

    Parameters
    ----------
    rounds : int, optional
        Number of rounds of the search.
    """

    privileged = True
    default_rounds: ClassVar[int] = 20
    search: ClassVar[type[MapSearch]]
    """Class of the search."""

    def __init__(self, *, rounds: int | None = None) -> None:
        rounds = self.default_rounds if rounds is None else rounds
        cure = f"{self.default_rounds} are a compromise."
        self._rounds = int(in_range("rounds", rounds, 0, 10**6, "1", cure))

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        self._rngs = list(rngs)
        self._actions: Array32 | None = None
        self._decided = np.zeros(len(rngs), int)

    def forget(self, cuts: Indices) -> None:
        """Forget the plans, which were for other cuts."""
        self._actions = None

    def set_state(self, cutting: Episode) -> None:
        """Plan the cut that is about to begin."""
        self.set_states([cutting])

    def set_states(self, cuttings: Sequence[Any]) -> None:
        """Plan the cuts that are about to begin, on all cores."""
        search = self.search(cuttings)
        plans, third, _ = search.best(self._rngs, rounds=self._rounds)
        self._actions = search.roll_out(plans, third, 1, recorded=True)[1]
        self._decided = np.zeros(len(cuttings), int)

    def act(self, observations: Array32) -> Array32:
        """Return the next action of each plan, whatever the observations."""
        if self._actions is None:
            raise RuntimeError("this planner must be shown the cut: call set_state(env.unwrapped.cutting) after reset.")
        self._decided += 1
        actions: Array32 = self._actions[np.arange(len(observations)), self._decided - 1]
        return actions
