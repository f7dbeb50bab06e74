"""Planners with truth for tasks that add a third action.

The tasks have a map of the cut; a planner knows all, and plans the whole cut.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Array32, Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv._engine.parallel import parallel_for
from cutenv.agents.policy.planner import PlannerWithTruth, Search, choose_action
from cutenv.sim.cutting.descent import renew
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.cutting.law import grid_index, lerp
from cutenv.sim.cutting.steering import to_crack
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE
from cutenv.task.declare import Cuts, Task
from cutenv.task.depth import DEPTH_CUT, DESCENT_SCALE, DepthEpisode
from cutenv.task.info import INFO
from cutenv.task.observation import SPEED_SCALE, speed_action
from cutenv.task.path import PATH_CUT, TURN_SCALE
from cutenv.task.stepper import Decision, step_some

_NO_READINGS = np.zeros((0, 0), READING)


class ThirdPlan(NamedTuple):
    """Numbers of a plan for the third action.

    They say where the search begins, its steps, and its range; each of shape (m,).
    """

    first: tuple[float, ...]
    step: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


class MapSearch:
    """Random local search over plans of whole cuts, each simulated.

    The cuts, at their start and of one rate and deadline, are copied and not changed.
    """

    task: ClassVar[Task]
    third: ClassVar[ThirdPlan]
    # distances by which the blade may have to go further than without the third action, tried first [m]
    later: ClassVar[tuple[float, ...]] = (0.0,)

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
        """Return the initial search over plans along the cut alone."""
        return Search(*cuttings)

    @abstractmethod
    def choose(self, plans: StructArray, third: Array, cuts: Cuts, waits: NDArray[np.bool_], actions: Array) -> None:
        """Fill actions, (n, 3), of n plans, except of those waiting."""

    def roll_out(self, plans: StructArray, third: Array, each: int, *, recorded: bool = False) -> tuple[Array, Array32]:
        """Simulate ``each`` plans per cut; return returns, and (n, decisions, 3) actions if asked."""
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
        """Search for ``rounds``; return each cut's best plan, third part and return."""
        count, rows = len(self._targets), np.arange(len(self._targets))
        found = self.plain.best(rngs, rounds=max(rounds // 2, 1))
        plans, third = np.concatenate([plan for plan, _ in found]), np.tile(self.third.first, (count, 1))
        each = len(self.later)
        plans = np.repeat(plans, each)
        plans["stop"] += np.tile(self.later, count)
        returns, _ = self.roll_out(plans, np.repeat(third, each, axis=0), each)
        first = each * rows + returns.reshape(count, each).argmax(axis=1)
        plans, returns = plans[first], returns[first]
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
        """Return ``count`` mutations of a plan's third part, (count, m)."""
        shape = count, len(self.third.first)
        steps = size * np.array(self.third.step) * rng.standard_normal(shape)
        varied: Array = third + steps * (rng.random(shape) < 0.5)
        return np.clip(varied, self.third.low, self.third.high)


class MapPlanner(PlannerWithTruth):
    """An oracle of a task with a map; its search is of whole cuts with a third action."""

    search: ClassVar[type[MapSearch]]
    cure = "20 are a compromise."

    def planned(self, cuttings: Sequence[Any]) -> Iterable[Array32]:
        """Return each cut's actions by decision, shape (decisions, 3)."""
        search = self.search(cuttings)
        plans, third, _ = search.best(self._rngs, rounds=self._rounds)
        return search.roll_out(plans, third, 1, recorded=True)[1]


_LEAD, _GAIN = 0.004, 6.0  # at the start of the search [m], and always [1/s]
_LEAD_STEP, _PRESS_STEP = 0.003, 0.0004  # of the search [m]
_LEAST_PRESS, _MOST_PRESS, _MOST_LEAD = -0.002, 0.003, 0.02  # [m]


@njit
def cut_as_deep(profiles: StructArray, descents: StructArray, slabs: StructArray, depth: Array) -> None:
    """Fill a profile, (1,), of tissue cut to ``depth`` [m], (301,)."""
    for i in range(N_POINTS):
        descents[0].settled = descents[0].engaged = descents[0].surface[i] - depth[i]
        descents[0].version += 1
        renew(profiles[0], descents[0], slabs[0], i)


@njit
def choose_depth_actions(
    plans: StructArray, depth_plans: Array, cuts: Cuts, waits: StructArray, actions: Array
) -> None:
    """Fill actions, (n, 3), of n depth plans, except of those waiting.

    ``depth_plans``, shape (n, 2), are the distance ahead of the tip at which the depth is followed, and the depth by
    which the blade is lower than wanted [m].
    """
    for n in range(len(plans)):
        if not waits[n]:
            state, descent = cuts.states[n], cuts.motions[n]
            choose_action(plans[n], state, actions[n])
            target = target_level(descent, cuts.wholes[n], min(state.tip + depth_plans[n, 0], state.blade))
            descent_speed = _GAIN * (descent.level - target + depth_plans[n, 1])
            action = speed_action(descent_speed * (SPEED_SCALE / DESCENT_SCALE))
            actions[n, 2] = np.float64(np.float32(min(max(action, -1.0), 1.0)))


@njit_internal
def target_level(descent: Struct, depth: Struct, position: float) -> float:
    """Return the blade level [m] of wanted depth at ``position`` [m]."""
    i = min(max(int(position * POINTS_PER_METRE + 0.5), 0), N_POINTS - 1)
    return descent.surface[i] - depth.wanted[i]  # type: ignore[no-any-return]


class _PlainSearch(Search):
    """Search over plans at wanted depth, before deepening is searched."""

    def __init__(self, cuttings: Sequence[DepthEpisode]) -> None:
        super().__init__(*cuttings)
        for start, cutting in zip(self._starts, cuttings, strict=True):
            slab = cutting.plant.specimen.tissue.slab()
            cut_as_deep(start.profiles, cutting.motion.copy(), slab, cutting.whole["wanted"][0])


class DepthSearch(MapSearch):
    """Search over plans of cuts along a wanted depth.

    The third part of a plan are the distance ahead of the tip at which the depth is followed, and the depth by which
    the blade is lower than wanted [m].
    """

    task = DEPTH_CUT
    third = ThirdPlan((_LEAD, 0.0), (_LEAD_STEP, _PRESS_STEP), (0.0, _LEAST_PRESS), (_MOST_LEAD, _MOST_PRESS))

    def new_plain(self, cuttings: Sequence[DepthEpisode]) -> Search:
        """Return a search over plans at wanted depth everywhere."""
        return _PlainSearch(cuttings)

    def choose(self, plans: StructArray, third: Array, cuts: Cuts, waits: StructArray, actions: Array) -> None:
        """Fill the actions of all plans."""
        choose_depth_actions(plans, third, cuts, waits, actions)


class DepthPlanner(MapPlanner):
    """The oracle of ``cutenv/DepthCut-v1``."""

    search = DepthSearch


_BACK, _AHEAD, _SHIFT, _TURN = range(4)
# Places in the third part of a plan, lengths [m]: within which the tip comes back to the line; ahead of the tip, at
# which the line's direction is the wanted one; within which the blade shifts to the side, and within which it turns.
_FIRST = (0.008, 0.003, 0.006, 0.003)
_STEPS = (0.004, 0.003, 0.003, 0.0015)
_MIN_PLAN, _MAX_PLAN = (0.002, 0.0, 0.001, 0.001), (0.05, 0.02, 0.05, 0.02)
_MAX_SINE = 0.8  # [rad], of a blade to the crack, as a sine
_MIN_SPEED = 0.002  # [m/s], for the rate of turn of a blade at rest


@njit
def choose_path_actions(plans: StructArray, third: Array, cuts: Cuts, waits: StructArray, actions: Array) -> None:
    """Fill actions, (n, 3), of n path plans, except of those waiting.

    ``third``, shape (n, 4), are the lengths of the steering.
    """
    for n in range(len(plans)):
        if not waits[n]:
            choose_action(plans[n], cuts.states[n], actions[n])
            speed = cuts.states[n].speed
            bend = wanted_bend(cuts.states[n], cuts.motions[n], third[n])
            turn = bend * (max(speed, _MIN_SPEED) if speed >= 0.0 else speed)
            action = speed_action(turn * (SPEED_SCALE / TURN_SCALE))
            actions[n, 2] = np.float64(np.float32(min(max(action, -1.0), 1.0)))


@njit_internal
def wanted_bend(state: Struct, steering: Struct, lengths: Array) -> float:
    """Return the way's leftward bend [1/m] from true crack state."""
    cosine, sine = to_crack(steering)  # of the angle from the crack to the blade
    if state.speed < 0.0 or steering.guided == 1:
        return 0.0
    i, share = grid_index(min(state.tip + lengths[_AHEAD], 0.149))
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    ahead = steering.tip_ahead * t_y - steering.tip_across * t_x  # sine of the turn from the crack to the line
    wanted = min(max(ahead - steering.tip_aside / lengths[_BACK], -0.5), 0.5)  # turn of the crack, as a sine
    pull = max(steering.pull, 0.1)
    offset = pull * (wanted - steering.coupling) / steering.side_stiffness
    shift = min(max((offset - steering.offset) / lengths[_SHIFT], -_MAX_SINE), _MAX_SINE)
    return (shift * cosine - sine) / lengths[_TURN]  # type: ignore[no-any-return]


class PathSearch(MapSearch):
    """Search over plans of cuts along a line.

    The third part of a plan are the lengths of the steering.
    """

    task = PATH_CUT
    third = ThirdPlan(_FIRST, _STEPS, _MIN_PLAN, _MAX_PLAN)
    later = (0.0, 0.003, 0.006, 0.009, 0.012, 0.016, 0.020, 0.025, 0.030)

    def choose(self, plans: StructArray, third: Array, cuts: Cuts, waits: StructArray, actions: Array) -> None:
        """Fill the actions of all plans."""
        choose_path_actions(plans, third, cuts, waits, actions)


class PathPlanner(MapPlanner):
    """The oracle of ``cutenv/PathCut-v1``.

    Speed, angle and end come from a search; the blade is steered by the true direction and stiffness of the crack, with
    lengths that are searched for as well.
    """

    search = PathSearch
    cure = "10 are a compromise."

    def __init__(self, *, rounds: int = 10) -> None:
        super().__init__(rounds=rounds)
