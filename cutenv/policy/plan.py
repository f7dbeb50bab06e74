"""Plans of a whole cut and their rollouts through a known tissue, compiled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.intrinsics import keep_alive
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.dtypes import READING
from cutenv.cutting.motion import STRAIGHT, Moving
from cutenv.cutting.row import LANES, ROW, lane_views, plain_views
from cutenv.task.assessment import COUNT
from cutenv.task.declare import Cuts, Stepping
from cutenv.task.gentle import GENTLE_CUT
from cutenv.task.info import INFO
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, speed_action
from cutenv.task.stepper import Ahead, Decision, flat_views, step_row

N_COMPONENTS = len(COMPONENTS)
KNOTS = 28
"""Number of segments of a plan, each with its own speed and angle."""
STRETCH = 0.005
"""Length of a segment along the cut [m]; the last one extends to the end."""
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
    """Return speed [m/s] and angle [rad] before the stop, for a blade at ``position`` [m]."""
    k = min(max(int(position / STRETCH), 0), KNOTS - 1)
    speed = plan.last_speed if position >= plan.slow_from else plan.speed[k]
    angle = UPRIGHT if position >= plan.upright_from else plan.angle[k]
    return speed, angle


_step_row, _SCALARS = step_row(GENTLE_CUT), STRAIGHT.scalars
_LANES, _COUNTS = STRAIGHT.lanes(LANES), GENTLE_CUT.counts(LANES)


class RollOut(NamedTuple):
    """Settings of following n plans, and what is filled."""

    together: int
    """Number of plans that one thread follows at a time; a plan and its leader are among the same ones."""
    ticks: int
    """Milliseconds between decisions."""
    decisions: int
    """Largest number of decisions."""
    returns: StructArray
    """Filled with the return of each plan, shape (n,)."""
    actions: StructArray
    """Filled with the actions taken, shape (n, decisions, 2), unless it has no rows; not for plans with a leader."""


@njit_nogil
def roll_out_some(passed: WorkQueue, core: int, cuts: Cuts, plans: StructArray, roll_out: RollOut) -> None:
    """Follow n plans, each to the end of its own cut, with the reward assessed from hidden state.

    A plan with a leader takes over its cut where it stops, so that what they share is simulated once.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue, of as many plans each as are followed together, and number of the thread, see
        :func:`cutenv._engine.parallel.parallel_for`.
    cuts : Cuts
        n straight cuts at their start, changed in place.
    plans : Records
        :data:`PLAN`, shape (n,).
    roll_out : RollOut
        Settings, and what is filled.
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
    """Return the end of the next row: of cuts from ``begun`` to before ``last``, so many that its lanes suffice."""
    taken = 0
    for n in range(begun, last):
        if not waits[n]:
            if taken == LANES:
                return n
            taken += 1
    return last


@njit_internal
def _take_over(cuts: Cuts, plans: StructArray, waits: StructArray, returns: StructArray, n: int) -> int:
    """Let plan ``n`` take over its leader's cut if it stops here; return 1 if that cut is over before, else 0."""
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
    """Fill ``action`` with the plan's for the present state, rounded to float32 as an environment's is."""
    speed, angle = planned_command(plan, state.blade)
    if plan.stopping == 0 and state.blade >= plan.stop:
        plan.stopping = 1
    if plan.stopping > 0:
        if state.speed <= 0.0 and state.blade - state.tip <= plan.rest_lag:
            plan.stopping = 2
        speed, angle = (0.0 if plan.stopping == 2 else -plan.retreat), UPRIGHT
    action[0] = np.float64(np.float32(speed_action(speed)))
    action[1] = np.float64(np.float32((angle - ANGLE_CENTRE) / ANGLE_SCALE))
