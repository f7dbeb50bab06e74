"""The planner with truth for ``cutenv/DepthCut-v1``: it knows tissue, surface and layer, and plans the whole cut."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.jit import njit, njit_internal
from cutenv._engine.parallel import parallel_for
from cutenv.cutting.descent import renew
from cutenv.cutting.dtypes import READING
from cutenv.policy.interface import ArrayPolicy
from cutenv.policy.plan import choose_action
from cutenv.policy.planner import Search
from cutenv.task.cuts import Cuts
from cutenv.task.depth_cuts import step_depth_some
from cutenv.task.depth_cutting import DepthCutting
from cutenv.task.depth_terms import ALL_COMPONENTS, DESCENT_SCALE
from cutenv.task.gentle_cutting import GentleCutting
from cutenv.task.info import INFO
from cutenv.task.observation import SPEED_SCALE, speed_action
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE

_LEAD, _GAIN = 0.004, 6.0  # at the start of the search [m], and always [1/s]
_LEAD_STEP, _PRESS_STEP = 0.003, 0.0004  # of the search [m]
_LEAST_PRESS, _MOST_PRESS, _MOST_LEAD = -0.002, 0.003, 0.02  # [m]
_NO_READINGS, _NO_VERTICAL = np.zeros((0, 0), READING), np.zeros((0, 0))


@njit
def cut_as_deep(profiles: StructArray, descents: StructArray, slabs: StructArray, depth: Array) -> None:
    """Fill a profile, shape (1,), with that of a tissue that is cut to ``depth`` [m], shape (301,)."""
    for i in range(N_POINTS):
        descents[0].engaged = descents[0].surface[i] - depth[i]
        descents[0].version += 1
        renew(profiles[0], descents[0], slabs[0], i)


@njit
def choose_depth_actions(
    plans: StructArray, depth_plans: Array, cuts: Cuts, descents: StructArray, depths: StructArray, waits: StructArray,
    actions: Array,
) -> None:  # fmt: skip
    """Fill the actions, shape (n, 3), of n plans at the present states of their cuts; not of those that wait.

    ``depth_plans``, shape (n, 2), are the distance ahead of the tip at which the depth is followed, and the depth by
    which the blade is lower than wanted [m].
    """
    for n in range(len(plans)):
        if not waits[n]:
            state, descent = cuts.states[n], descents[n]
            choose_action(plans[n], state, actions[n])
            target = target_level(descent, depths[n], min(state.tip + depth_plans[n, 0], state.blade))
            descent_speed = _GAIN * (descent.level - target + depth_plans[n, 1])
            action = speed_action(descent_speed * (SPEED_SCALE / DESCENT_SCALE))
            actions[n, 2] = np.float64(np.float32(min(max(action, -1.0), 1.0)))


@njit_internal
def target_level(descent: Struct, depth: Struct, position: float) -> float:
    """Return the level [m] of a blade that cuts as deep as wanted at ``position`` [m]."""
    i = min(max(int(position * POINTS_PER_METRE + 0.5), 0), N_POINTS - 1)
    return descent.surface[i] - depth.wanted[i]  # type: ignore[no-any-return]


class _PlainSearch(Search):
    """Search over plans of cuts that are as deep as wanted everywhere: where the search with deepening begins."""

    def __init__(self, cuttings: Sequence[DepthCutting]) -> None:
        super().__init__(*cuttings)
        for start, cutting in zip(self._starts, cuttings, strict=True):
            cut_as_deep(start.profiles, cutting.descents.copy(), cutting.slabs, cutting.depths["wanted"][0])


class DepthSearch:
    """Random local search over plans of whole cuts, each simulated as it would be.

    Parameters
    ----------
    cuttings : sequence of DepthCutting
        Cuts at their start, of one rate and deadline; they are copied and not changed.
    """

    def __init__(self, cuttings: Sequence[DepthCutting]) -> None:
        for cutting in cuttings:
            if not isinstance(cutting, DepthCutting):
                raise TypeError(f"plans of the depth need a DepthCutting to simulate, got {type(cutting).__name__}.")
        self._plain = _PlainSearch(cuttings)
        self._starts = Cuts(*(np.concatenate(parts) for parts in zip(*(c.snapshot() for c in cuttings), strict=True)))
        self._descents = np.concatenate([cutting.descents for cutting in cuttings])
        self._depths = np.concatenate([cutting.depths for cutting in cuttings])
        self._targets = [cutting.target_length for cutting in cuttings]
        self._slabs, self._ticks = cuttings[0].slabs, cuttings[0].ticks
        self._decisions = math.ceil(1e3 * cuttings[0].deadline / self._ticks)

    def roll_out(
        self, plans: StructArray, depth_plans: Array, each: int, *, recorded: bool = False
    ) -> tuple[Array, Array32]:
        """Simulate ``each`` plans for every cut; return their returns, and the actions, (n, decisions, 3), if asked."""
        count = len(plans)
        cuts = Cuts(*(np.repeat(part, each, axis=0) for part in self._starts))
        descents, depths = np.repeat(self._descents, each), np.repeat(self._depths, each)
        plans["stopping"] = plans["leader"] = 0
        actions, returns, waits = np.zeros((count, 3)), np.zeros(count), np.zeros(count, bool)
        observations, infos = np.zeros((count, len(ALL_COMPONENTS)), np.float32), np.zeros(count, INFO)
        rewards, ends = np.zeros(count), np.zeros(count, np.int64)
        kept = np.zeros((count, self._decisions, 3), np.float32) if recorded else np.zeros((0, 0, 3), np.float32)
        for decision in range(self._decisions):
            choose_depth_actions(plans, depth_plans, cuts, descents, depths, waits, actions)
            if recorded:
                kept[:, decision] = actions
            parallel_for(
                step_depth_some, count, cuts, descents, depths, self._slabs, self._ticks, waits, actions, observations,
                rewards, ends, infos, _NO_READINGS, _NO_VERTICAL,
            )  # fmt: skip
            returns += rewards
            waits |= ends != 0
            if waits.all():
                break
        return returns, kept

    def best(
        self, rngs: Sequence[np.random.Generator], *, rounds: int, offspring: int = 12
    ) -> tuple[StructArray, Array, Array]:
        """Search for ``rounds`` rounds; return the best plan of each cut, its depth plan, and its return."""
        count, rows = len(self._targets), np.arange(len(self._targets))
        found = self._plain.best(rngs, rounds=max(rounds // 2, 1))
        plans, depth_plans = np.concatenate([plan for plan, _ in found]), np.tile([_LEAD, 0.0], (count, 1))
        returns, _ = self.roll_out(plans, depth_plans, 1)
        size = np.ones(count)
        for _ in range(rounds):
            tried = [
                self._plain.varied(plans[k : k + 1], self._targets[k], size[k], offspring, rngs[k])
                for k in range(count)
            ]
            depths = [self._varied_depth(depth_plans[k], size[k], offspring, rngs[k]) for k in range(count)]
            values, _ = self.roll_out(np.concatenate(tried), np.concatenate(depths), offspring)
            best = values.reshape(count, offspring).argmax(axis=1)
            better = values.reshape(count, offspring)[rows, best] > returns
            for k in np.flatnonzero(better).tolist():
                plans[k], depth_plans[k] = tried[k][best[k]], depths[k][best[k]]
                returns[k] = values[offspring * k + best[k]]
            size = np.where(better, np.minimum(1.3 * size, 1.0), np.maximum(0.7 * size, 0.05))
        return plans, depth_plans, returns

    @staticmethod
    def _varied_depth(depth_plan: Array, size: float, count: int, rng: np.random.Generator) -> Array:
        """Return ``count`` mutations of a depth plan, shape (count, 2)."""
        steps = size * np.array([_LEAD_STEP, _PRESS_STEP]) * rng.standard_normal((count, 2))
        varied: Array = depth_plan + steps * (rng.random((count, 2)) < 0.5)
        return np.clip(varied, [0.0, _LEAST_PRESS], [_MOST_LEAD, _MOST_PRESS])


class DepthPlanner(ArrayPolicy):
    """The oracle of ``cutenv/DepthCut-v1``: it knows the specimen and plans the whole cut.

    Its plans come from a search, so the true optimum is better.

    Parameters
    ----------
    rounds : int
        Number of rounds of the search.
    """

    privileged = True

    def __init__(self, *, rounds: int = 20) -> None:
        self._rounds = int(in_range("rounds", rounds, 0, 10**6, "1", "20 are a compromise."))

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        self._rngs = list(rngs)
        self._actions: Array32 | None = None
        self._decided = np.zeros(len(rngs), int)

    def forget(self, cuts: Indices) -> None:
        """Forget the plans, which were for other cuts."""
        self._actions = None

    def set_state(self, cutting: GentleCutting) -> None:
        """Plan the cut that is about to begin."""
        self.set_states([cutting])

    def set_states(self, cuttings: Sequence[Any]) -> None:
        """Plan the cuts that are about to begin, on all cores."""
        search = DepthSearch(cuttings)
        plans, depth_plans, _ = search.best(self._rngs, rounds=self._rounds)
        self._actions = search.roll_out(plans, depth_plans, 1, recorded=True)[1]
        self._decided = np.zeros(len(cuttings), int)

    def act(self, observations: Array32) -> Array32:
        """Return the next action of each plan, whatever the observations."""
        if self._actions is None:
            raise RuntimeError("this planner must be shown the cut: call set_state(env.unwrapped.cutting) after reset.")
        self._decided += 1
        actions: Array32 = self._actions[np.arange(len(observations)), self._decided - 1]
        return actions
