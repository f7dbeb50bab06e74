"""Plans of a whole cut and their rollouts through a known tissue, compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.dtypes import READING
from cutenv.cutting.row import LANES, ROW, plain_views
from cutenv.task.assessment import COUNT
from cutenv.task.cuts import Cuts, flat_views, step_row
from cutenv.task.info import INFO
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, SPEED_SCALE

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


@njit_nogil
def roll_out_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    plans: StructArray,
    ticks: int,
    decisions: int,
    returns: StructArray,
    actions: StructArray,
) -> None:
    """Follow n plans, each to the end of its own cut, with the reward assessed from hidden state.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts : Cuts
        n cuts at their start, changed in place.
    plans : Records
        :data:`PLAN`, shape (n,).
    ticks, decisions : int
        Milliseconds between decisions; largest number of decisions.
    returns : array, shape (n,)
        Filled with the return of each plan.
    actions : array, shape (n, decisions, 2) or (0, 0, 2)
        Filled with the actions taken, unless it has no rows.
    """
    count = len(plans)
    action, observations, rewards = np.zeros((count, 2)), np.zeros((count, N_COMPONENTS), np.float32), np.zeros(count)
    ends, over, infos = np.zeros(count, np.int64), np.zeros(count, np.bool_), np.zeros(count, INFO)
    readings = np.zeros((0, 0), READING)
    rows, counts = np.zeros(1, ROW), np.zeros(1, COUNT)
    row, lanes = first_row(rows), first_row(counts)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    fetched = flat_views(cuts, plain, infos)
    first, last = next_chunk(passed, core, LANES)
    while first < last:
        left = last - first
        for n in range(first, last):
            returns[n] = 0.0
        for decision in range(decisions):
            for n in range(first, last):
                if not over[n]:
                    _choose(plans[n], cuts.states[n], action[n])
                    if len(actions) > 0:
                        actions[n, decision, 0], actions[n, decision, 1] = action[n, 0], action[n, 1]
            step_row(
                cuts, row, lanes, plain, first, last, ticks, True, over, action, observations, rewards, ends, infos,
                readings, fetched, (0, 0),
            )  # fmt: skip
            for n in range(first, last):
                returns[n] += rewards[n]
                if ends[n] != 0:
                    over[n] = True
                    left -= 1
            if left == 0:
                break
        mark_done(passed, core, last - first)
        first, last = next_chunk(passed, core, LANES)


@njit_internal
def _choose(plan: Struct, state: Struct, action: StructArray) -> None:
    """Fill ``action`` with the plan's for the present state, rounded to float32 as an environment's is."""
    speed, angle = planned_command(plan, state.blade)
    if plan.stopping == 0 and state.blade >= plan.stop:
        plan.stopping = 1
    if plan.stopping > 0:
        if state.speed <= 0.0 and state.blade - state.tip <= plan.rest_lag:
            plan.stopping = 2
        speed, angle = (0.0 if plan.stopping == 2 else -plan.retreat), UPRIGHT
    action[0] = np.float64(np.float32(speed / SPEED_SCALE))
    action[1] = np.float64(np.float32((angle - ANGLE_CENTRE) / ANGLE_SCALE))
