"""Planners: the best plan of a whole cut through known or mean tissue."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.intrinsics import first_row, keep_alive
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.parallel import WorkQueue, mark_done, next_chunk, parallel_for
from cutenv.agents.policy.interface import DISTANCE_COLUMN, POSITION_COLUMN, ArrayPolicy, to_actions
from cutenv.agents.policy.scripted import INCLINED, Script, StopAndUnload
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.cutting.motion import STRAIGHT, Moving
from cutenv.sim.cutting.row import LANES, ROW, lane_views, plain_views
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue.description import TissueDescription, measured_liver
from cutenv.sim.tissue.specimen import Specimen
from cutenv.task.assessment import COUNT
from cutenv.task.declare import GENTLE_CUT, Cuts, Stepping
from cutenv.task.episode import Episode, Goal
from cutenv.task.info import INFO
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, speed_action
from cutenv.task.stepper import Ahead, Decision, flat_views, step_row

N_COMPONENTS = len(COMPONENTS)
KNOTS = 28  # number of segments of a plan, each with its own speed and angle
STRETCH = 0.005  # length of a segment along the cut [m]; the last one extends to the end
UPRIGHT = 0.5 * math.pi

PLAN: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("speed", "f8", (KNOTS,)),  # of each segment [m/s]
            ("angle", "f8", (KNOTS,)),  # of each segment [rad]
            ("upright_from", "f8"),  # blade position from which the blade turns upright [m]
            ("slow_from", "f8"),  # blade position from which the last speed holds [m]
            ("last_speed", "f8"),  # [m/s]
            ("stop", "f8"),  # blade position at which it stops [m]
            ("retreat", "f8"),  # speed of drawing back [m/s]
            ("rest_lag", "f8"),  # lag of the tip at which drawing back ends [m]
            ("stopping", "i8"),  # of the rollout: 1 once it draws back, 2 once it rests
            ("leader", "i8"),  # how many plans further on is one that is the same but stops later; 0: none
        ],
    )
)
"""Structured dtype of a plan; commands depend on the blade's position, so that a plan does not depend on timing."""


@njit
def planned_command(plan: Struct, position: float) -> tuple[float, float]:
    """Return a plan's speed [m/s] and angle [rad] at ``position`` [m]."""
    k = min(max(int(position / STRETCH), 0), KNOTS - 1)
    speed = plan.last_speed if position >= plan.slow_from else plan.speed[k]
    angle = UPRIGHT if position >= plan.upright_from else plan.angle[k]
    return speed, angle


_step_row, _SCALARS = step_row(GENTLE_CUT), STRAIGHT.scalars
_LANES, _COUNTS = STRAIGHT.lanes(LANES), GENTLE_CUT.counts(LANES)


class RollOut(NamedTuple):
    """Settings of following n plans, and what is filled."""

    together: int  # number of plans that one thread follows at a time; a plan and its leader are among the same ones
    ticks: int  # milliseconds between decisions
    decisions: int  # largest number of decisions
    returns: StructArray  # filled with the return of each plan, shape (n,)
    actions: StructArray  # filled with those taken, (n, decisions, 2), if it has rows; not for plans with a leader


@njit_nogil
def roll_out_some(passed: WorkQueue, core: int, cuts: Cuts, plans: StructArray, roll_out: RollOut) -> None:
    """Simulate n plans, :data:`PLAN`, to their cuts' ends, rewarded from hidden state.

    A plan with a leader takes over its cut where it stops, so that what they share is simulated once.  The work queue
    has as many plans each as are followed together, see :func:`cutenv._engine.parallel.parallel_for`; the n straight
    cuts at their start are changed in place.
    """
    together, ticks, decisions, returns, actions = roll_out
    count = len(plans)
    action, observations, rewards = np.zeros((count, 2)), np.zeros((count, N_COMPONENTS), np.float32), np.zeros(count)
    ends, waits, infos = np.zeros(count, np.int64), np.zeros(count, np.bool_), np.zeros(count, INFO)
    readings = np.zeros((0, 0), READING)
    rows, counts, lanes, steps = np.zeros(1, ROW), np.zeros(1, COUNT), np.zeros(1, _LANES), np.zeros(1, _COUNTS)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    moving = Moving(first_row(lanes), lane_views(lanes, cuts.motions, LANES, _SCALARS), cuts.motions, cuts.shared)
    stepping = Stepping(cuts, first_row(rows), plain, moving, first_row(counts), first_row(steps))
    decided = Decision(ticks, waits, action, observations, rewards, ends, infos, readings)
    ahead = Ahead(flat_views(cuts, plain, infos), 0, 0)  # none
    group, none = next_chunk(passed, core, 1)
    while group < none:
        first, last = group * together, min((group + 1) * together, count)
        left = last - first
        for n in range(first, last):
            returns[n] = 0.0
            waits[n] = plans[n].leader > 0
        for decision in range(decisions):
            for n in range(first, last):
                if plans[n].leader > 0:
                    left -= _take_over(cuts, plans, waits, returns, n)
                if not waits[n]:
                    choose_action(plans[n], cuts.states[n], action[n])
                    if len(actions) > 0:
                        actions[n, decision, 0], actions[n, decision, 1] = action[n, 0], action[n, 1]
            begun = first
            while begun < last:
                end = _row_from(waits, begun, last)
                _step_row(stepping, (begun, end), decided, ahead)
                begun = end
            for n in range(first, last):
                returns[n] += rewards[n]
                if ends[n] != 0:
                    waits[n] = True
                    left -= 1
            if left == 0:
                break
        mark_done(passed, core, 1)
        group, none = next_chunk(passed, core, 1)
    keep_alive(rows)
    keep_alive(counts)
    keep_alive(lanes)
    keep_alive(steps)


@njit_internal
def _row_from(waits: StructArray, begun: int, last: int) -> int:
    """Return the end of the next row, by lanes that its cuts need."""
    taken = 0
    for n in range(begun, last):
        if not waits[n]:
            if taken == LANES:
                return n
            taken += 1
    return last


@njit_internal
def _take_over(cuts: Cuts, plans: StructArray, waits: StructArray, returns: StructArray, n: int) -> int:
    """Let plan ``n`` continue its leader's cut; return 1 if over."""
    leader = n + plans[n].leader
    if cuts.states[leader].blade < plans[n].stop and not waits[leader]:
        return 0
    returns[n], plans[n].leader = returns[leader], 0
    if waits[leader]:
        return 1
    cuts.states[n], cuts.drives[n], cuts.sensors[n] = cuts.states[leader], cuts.drives[leader], cuts.sensors[leader]
    cuts.progresses[n] = cuts.progresses[leader]
    waits[n] = False
    return 0


@njit_internal
def choose_action(plan: Struct, state: Struct, action: StructArray) -> None:
    """Fill ``action`` with the plan's, rounded to float32 as in environments."""
    speed, angle = planned_command(plan, state.blade)
    if plan.stopping == 0 and state.blade >= plan.stop:
        plan.stopping = 1
    if plan.stopping > 0:
        if state.speed <= 0.0 and state.blade - state.tip <= plan.rest_lag:
            plan.stopping = 2
        speed, angle = (0.0 if plan.stopping == 2 else -plan.retreat), UPRIGHT
    action[0] = np.float64(np.float32(speed_action(speed)))
    action[1] = np.float64(np.float32((angle - ANGLE_CENTRE) / ANGLE_SCALE))


_MAX_SPEED, _MIN_SPEED = 0.0254, 0.001  # [m/s]
_DEADLINE, _TICKS = 30.0, 20  # [s], [ms]: the environment's defaults
_AT_ONCE = 4096  # plans that are rolled out together
_TOGETHER = 128  # plans that one thread rolls out, so that the rows of the last ones are full
_NEVER = 1.0  # [m], a place that no blade reaches


class Search:
    """Random local search over plans, for one cut or many.

    It starts from the best of a grid of constant ones.  The cuts, at their start and of one rate and deadline, are
    copied and not changed.
    """

    def __init__(self, *cuttings: Episode) -> None:
        self._starts = []
        for cutting in cuttings:
            if not getattr(cutting, "simulated", False):
                raise TypeError(f"plans need a simulated episode, got {cutting!r}.")
            self._starts.append(cutting.snapshot().straight())
        self._targets = [cutting.target_length for cutting in cuttings]
        self._ticks = cuttings[0].ticks
        self._decisions = math.ceil(1e3 * cuttings[0].deadline / self._ticks)

    def returns(self, plans: list[StructArray]) -> list[Array]:
        """Return each plan's return, (n,), for each cut's plans."""
        each = max(_AT_ONCE // max(len(own) for own in plans), 1)  # whole cuts, as many as memory should hold
        found: list[Array] = []
        for k in range(0, len(plans), each):
            together = plans[k : k + each]
            returns, _ = self._roll_out(self._starts[k : k + each], together, recorded=False)
            found += np.split(returns, np.cumsum([len(own) for own in together])[:-1])
        return found

    def commands(self, plans: list[StructArray]) -> list[Array]:
        """Return a plan's actions by cut and decision, shape (decisions, 2)."""
        return list(self._roll_out(self._starts, plans, recorded=True)[1])

    def _roll_out(self, starts: list[Cuts], plans: list[StructArray], *, recorded: bool) -> tuple[Array, Array]:
        every = np.concatenate(plans)
        every["stopping"] = 0
        counts = [len(own) for own in plans]
        cuts = Cuts.together(starts).repeated(counts)
        returns = np.zeros(len(every))
        actions = np.zeros((len(every), self._decisions, 2) if recorded else (0, 0, 2))
        together = 3 * len(plans[0]) if every["leader"].any() else _TOGETHER  # leaders of three cuts fill a row
        groups = math.ceil(len(every) / together)
        roll_out = RollOut(together, self._ticks, self._decisions, returns, actions)
        parallel_for(roll_out_some, groups, cuts, every, roll_out, fewest=1)
        return returns, actions

    def best(
        self, rngs: Sequence[np.random.Generator], *, rounds: int, offspring: int = 16
    ) -> list[tuple[StructArray, float]]:
        """Search for ``rounds``; return each cut's best plan, (1,), and return."""
        plans = [self.plain_plans(target) for target in self._targets]
        best = [
            _better(own, returns, own[:1], -math.inf) for own, returns in zip(plans, self.returns(plans), strict=True)
        ]
        sizes = [1.0] * len(best)
        for _ in range(rounds):
            tries = [
                self.varied(plan, target, size, offspring, rng)
                for (plan, _), target, size, rng in zip(best, self._targets, sizes, rngs, strict=True)
            ]
            for k, returns in enumerate(self.returns(tries)):
                before = best[k][1]
                best[k] = _better(tries[k], returns, *best[k])
                sizes[k] = min(1.3 * sizes[k], 1.0) if best[k][1] > before else max(0.7 * sizes[k], 0.05)
        return best

    def plain_plans(self, target: float) -> StructArray:
        """Return a grid of constant plans for a length [m] with varied stops."""
        speeds, angles = np.array([0.0254, 0.0190, 0.0127, 0.0064]), np.radians([45.0, 60.0, 90.0])
        stops = target + np.linspace(-0.004, 0.044, 33)  # the blade leads the tip by up to 4 cm
        v, theta, stop = (grid.ravel() for grid in np.meshgrid(speeds, angles, stops, indexing="ij"))
        plans = np.zeros(len(v), PLAN)
        plans["speed"], plans["angle"] = v[:, None], theta[:, None]
        plans["upright_from"] = plans["slow_from"] = _NEVER
        plans["last_speed"] = v
        plans["stop"] = stop
        plans["retreat"] = 0.010
        plans["rest_lag"] = 0.5e-3
        plans["leader"] = np.tile(np.arange(len(stops))[::-1], len(speeds) * len(angles))  # the last to stop
        return plans

    def varied(
        self, plan: StructArray, target: float, size: float, count: int, rng: np.random.Generator
    ) -> StructArray:
        """Return ``count`` mutations of ``plan``, (1,), each number with probability 1/3."""
        plans = np.repeat(plan, count)
        plans["leader"] = 0

        def change(name: str, step: float, low: float, high: float) -> None:
            values = plans[name]
            chosen = rng.random(values.shape) < 1.0 / 3.0
            plans[name] = np.clip(values + size * step * chosen * rng.standard_normal(values.shape), low, high)

        change("speed", 0.006, _MIN_SPEED, _MAX_SPEED)
        change("angle", math.radians(12.0), INCLINED, UPRIGHT)
        change("last_speed", 0.006, _MIN_SPEED, _MAX_SPEED)
        change("stop", 0.002, 0.5 * target, target + 0.05)
        change("retreat", 0.004, 0.002, _MAX_SPEED)
        change("rest_lag", 1e-3, 0.0, 0.004)
        for name in ("upright_from", "slow_from"):
            near = np.where(plans[name] == _NEVER, target - 0.010, plans[name])
            moved = near + size * 0.005 * rng.standard_normal(count)
            plans[name] = np.where(rng.random(count) < 1.0 / 3.0, moved, plans[name])
        return plans


def _better(plans: StructArray, returns: Array, plan: StructArray, value: float) -> tuple[StructArray, float]:
    k = int(np.argmax(returns))
    if returns[k] <= value:
        return plan, value
    better = plans[k : k + 1].copy()
    better["leader"] = 0
    return better, float(returns[k])


class PlannerWithTruth(ArrayPolicy):
    """The oracle: it knows the specimen and plans the whole cut.

    An upper bound that no real policy can reach.

    Its plans come from a search, so the true optimum is slightly better.
    """

    privileged = True
    cure: ClassVar[str] = "20 come within 0.002 of 200."

    def __init__(self, *, rounds: int = 20) -> None:
        self._rounds = int(in_range("rounds", rounds, 0, 10**6, "1", self.cure))

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        self._rngs = list(rngs)
        self._actions: list[Array32 | None] = [None] * len(rngs)
        self._decided = np.zeros(len(rngs), int)

    def forget(self, cuts: Indices) -> None:
        """Forget those cuts that are given by index."""
        for n in cuts:
            self._actions[n] = None

    def set_state(self, cutting: Episode) -> None:
        """Plan the cut that is about to begin."""
        self.set_states([cutting])

    def set_states(self, cuttings: Sequence[Any]) -> None:
        """Plan the cuts that are about to begin, on all cores."""
        self._actions = list(self.planned(cuttings))
        self._decided = np.zeros(len(cuttings), int)

    def planned(self, cuttings: Sequence[Any]) -> Iterable[Array32]:
        """Return each cut's actions by decision, shape (decisions, k)."""
        search = Search(*cuttings)
        plans = [plan for plan, _ in search.best(self._rngs, rounds=self._rounds)]
        return (actions.astype(np.float32) for actions in search.commands(plans))

    def act(self, observations: Array32) -> Array32:
        """Return the next action of each plan, whatever the observations."""
        planned = [actions for actions in self._actions if actions is not None]
        if len(planned) < len(observations):
            raise RuntimeError("this planner must be shown the cut: call set_state(env.unwrapped.cutting) after reset.")
        self._decided += 1
        return np.stack([actions[n - 1] for actions, n in zip(planned, self._decided.tolist(), strict=True)])


class PlannerNominal(Script):
    """A planner for the mean liver.

    It follows the plan and stops where the tip is estimated to reach the target.

    Parameters
    ----------
    tissue : TissueDescription, optional
        Default: the measured pig liver.
    """

    def __init__(
        self, *, tissue: TissueDescription | None = None, rounds: int = 20, unloading: StopAndUnload | None = None
    ) -> None:
        super().__init__(unloading)
        self._tissue = tissue or measured_liver()
        self._rounds = int(in_range("rounds", rounds, 0, 10**6, "1", "20 come within 0.002 of 200."))
        self._plans: dict[float, StructArray] = {}

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; plans are kept."""
        super().begin(rngs)
        self._chosen = np.zeros(len(rngs), PLAN)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._chosen[cuts] = np.zeros((), PLAN)

    def command(self, seen: Array) -> Array32:
        """Return the plans' commands for the present positions."""
        position, plans = seen[:, POSITION_COLUMN], self._chosen
        for n in np.flatnonzero(plans["stop"] == 0.0):  # not yet chosen
            plans[n] = self.plan_for(position[n] + seen[n, DISTANCE_COLUMN])[0]
        each, segment = np.arange(len(plans)), np.clip((position / STRETCH).astype(int), 0, KNOTS - 1)
        speeds = np.where(position >= plans["slow_from"], plans["last_speed"], plans["speed"][each, segment])
        angles = np.where(position >= plans["upright_from"], UPRIGHT, plans["angle"][each, segment])
        return to_actions(speeds, angles)

    def plan_for(self, target: float) -> StructArray:
        """Return the cached plan, (1,), for a target length [m], by centimetre."""
        length = round(target, 2)
        if length not in self._plans:
            search = Search(_mean_cut(self._tissue, length))
            self._plans[length] = search.best([np.random.default_rng(0)], rounds=self._rounds)[0][0]
        return self._plans[length]


def _mean_cut(tissue: TissueDescription, target: float) -> Episode:
    specimen = Specimen.mean(tissue)
    plant = SimulatedPlant(specimen, sensor=SensorParameters(force_noise=0.0))
    goal = Goal(
        tissue=tissue,
        friction_per_depth=specimen.friction_per_depth,
        target_length=target,
        deadline=_DEADLINE,
        ticks=_TICKS,
    )
    return Episode(plant, goal, from_truth=True)
