"""Reward and ends of gentle cutting, assessed every millisecond so that nothing is missed between decisions.

Reward of a step = progress / L - costs.  All costs are non-negative and additive: they are charged as they occur.
Every end is charged the same terminal cost; an end for safety also pays the largest cost that stopping could still
have had, so that it never pays to end early:

    time left, tip error at its cap, a full wedge, and a tissue left loaded.

Costs that only time bounds (force, lag, jumps, backward travel) are not part of that largest cost: a policy that
stops and unloads avoids them, so a breach costs more than stopping in every state.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import depth_at, stiffness_at, toughness_at
from cutenv.task_quantities import (
    ANGLE_TOLERANCE,
    SHALLOWEST,
    TIP_TOLERANCE,
    force_per_depth,
    lag,
    overshoot,
    tip_error,
    wedge,
)

FORCE_ALLOWED = 400.0
"""Force per depth of cut up to which no force cost is charged [N/m]."""
LAG_ALLOWED = 0.010
"""Lag of the tip behind the blade up to which no lag cost is charged [m]."""
OVERSHOOT_ALLOWED = 0.005
"""Overshoot of the tip beyond the target above which the task ends [m]."""
LAG_CHARGED = 0.010
"""Largest excess lag that is charged [m]: in a soft and tough specimen no blade can keep the tip nearer."""
TIP_ERROR_CAP = 3.0
"""Largest tip error that is charged, in multiples of the tolerance."""
TRAVEL_TO_FINISH = 0.010
"""Position that the blade must have reached before the task can be finished [m]."""
SPEED_AT_REST = 0.5e-3
"""Speed below which the blade counts as at rest [m/s]."""
FORCE_UNLOADED = 0.1
"""Force above friction below which the blade counts as unloaded [N]."""
TIME_AT_REST = 0.3
"""Time at rest and unloaded after which the cut is finished [s]."""
DECELERATION = 0.1
"""Deceleration of a stopping blade, in the cost of haste [m/s2]."""
TIME_SCALE = 30.0
"""Time that costs its weight once [s]."""
WORST_STORED = 2.0
"""Largest stored energy that is charged at an end, in R B 3 mm: a tip 12 mm behind at F = R B."""

_PROGRESS, _UNCONTROLLED, _JUMP, _FORCE, _LAG, _BACKWARD, _HASTE, _TIME, _TIP, _WEDGE, _STORED, _SAFETY = range(12)
_FINISHED, _FORCE_LIMIT, _OVERSHOOT, _DEADLINE = range(1, 5)


class Tally(NamedTuple):
    """Accumulators of a step, updated every millisecond: memory of the assessment, and sums to be weighted."""

    position: float
    """Position of the blade [m]."""
    touched: int
    """1 once the blade has loaded the tissue."""
    furthest: float
    """Furthest position of the blade so far [m]."""
    time: float
    """Time since reset [s]."""
    quiet: float
    """Time for which the blade has been at rest and unloaded [s]."""
    tip: float
    """Crack tip as assessed [m]."""
    end: int
    """Index in :data:`~cutenv.task.episode_dtypes.ENDS`."""
    updates: int
    """Number of updates in this step."""
    out_of_range: int
    """Number of updates at a speed outside the measured range."""
    over_limit: float
    """Largest force above the limit [N]."""
    uncontrolled: float
    """Sum of unstable growth [m]."""
    jumped: float
    """Sum of squared unstable growth [m2]."""
    over_force: float
    """Sum over updates of the force per depth above the free allowance [N/m]."""
    over_lag: float
    """Sum over updates of the lag above the free allowance [m]."""
    backward: float
    """Backward travel [m]."""
    haste: float
    """Integral of speed squared over travel [m3/s2]."""


@njit_internal
def fresh(progress: Struct) -> Tally:
    """Return the tally at the beginning of a step."""
    return Tally(
        progress.position, progress.touched, progress.furthest, progress.time, progress.quiet, progress.tip,
        0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip


@njit_inline
def counted(
    tally: Tally,
    task: Struct,
    x: float,
    velocity: float,
    force: float,
    felt: float,
    a: float,
    jump: float,
    depth: float,
) -> Tally:
    """Return the tally one millisecond later.

    Parameters
    ----------
    tally : Tally
        The tally before.
    task : Record
        Limits and target, by name as in :data:`~cutenv.task.episode_dtypes.TASK`.
    x, velocity : float
        Position [m] and velocity [m/s] of the blade.
    force, felt : float
        Force on the blade, true or measured; measured force [N].
    a, jump : float
        Crack tip and unstable growth, true or estimated [m].
    depth : float
        Depth of cut at the blade [m].
    """
    moved = x - tally.position
    speed, size = abs(velocity), abs(force)
    depth = max(depth, SHALLOWEST)
    force_limit = task.force_limit_per_depth * depth

    over_force = force_per_depth(size, depth) - FORCE_ALLOWED if size > FORCE_ALLOWED * depth else 0.0
    backward = max(-moved, 0.0) if tally.touched == 1 else 0.0
    furthest = max(tally.furthest, x)
    time = tally.time + TICK
    measured = speed == 0.0 or task.speed_min <= speed <= task.speed_max

    unloaded = felt < task.friction_per_depth * depth + FORCE_UNLOADED
    resting = speed < SPEED_AT_REST and unloaded and furthest >= TRAVEL_TO_FINISH
    quiet = tally.quiet + TICK if resting else 0.0

    end = 0
    if time >= task.deadline - 0.5 * TICK:
        end = _DEADLINE
    if quiet >= TIME_AT_REST - 0.5 * TICK:
        end = _FINISHED
    if a > task.target + OVERSHOOT_ALLOWED:
        end = _OVERSHOOT
    if size > force_limit:
        end = _FORCE_LIMIT

    return Tally(
        x,
        1 if x > a else tally.touched,
        furthest,
        time,
        quiet,
        a,
        end,
        tally.updates + 1,
        tally.out_of_range + (0 if measured else 1),
        max(tally.over_limit, size - force_limit),
        tally.uncontrolled + jump,
        tally.jumped + jump**2,
        tally.over_force + over_force,
        tally.over_lag + min(max(lag(x, a) - LAG_ALLOWED, 0.0), LAG_CHARGED),
        tally.backward + backward,
        tally.haste + speed**2 * abs(moved),
    )


@njit_internal
def assess(
    task: Struct,
    progress: Struct,
    profile: Struct,
    readings: StructArray,
    from_truth: bool,
    tips: StructArray,
    jumps: StructArray,
    terms: StructArray,
) -> None:
    """Charge one step to the reward's terms and determine whether the task has ended.

    Parameters
    ----------
    task : Record
        :data:`~cutenv.task.episode_dtypes.TASK`.
    progress : Record
        :data:`~cutenv.task.episode_dtypes.PROGRESS`, changed in place.
    profile : Record
        :data:`~cutenv.cutting.dtypes.PROFILE`: the tissue, true or nominal.
    readings : Records
        :data:`~cutenv.cutting.dtypes.READING`, shape (ticks,).
    from_truth : bool
        True: force on the blade, crack tip and unstable growth are the readings' true ones. False: the force is the
        measured one and the others are estimates.
    tips, jumps : array, shape (ticks,)
        Estimates of the tip and of unstable growth at each tick [m].
    terms : array, shape (12,)
        Filled with the terms of this step in the order of :data:`~cutenv.task.episode_dtypes.TERMS`; their sum is the
        reward.
    """
    tally = fresh(progress)
    for i in range(len(readings)):
        reading = readings[i]
        tally = counted(
            tally,
            task,
            reading.position,
            reading.speed,
            reading.true_force if from_truth else reading.force,
            reading.force,
            reading.tip if from_truth else tips[i],
            reading.jump if from_truth else jumps[i],
            depth_at(profile, reading.position),
        )
        if tally.end != 0:
            break
    charge(task, progress, profile, tally, readings[tally.updates - 1].angle, terms)


@njit_inline
def charge(task: Struct, progress: Struct, profile: Struct, tally: Tally, angle: float, terms: StructArray) -> None:
    """Charge the accumulated costs of a step to the reward's terms; the blade ended at ``angle`` [rad]."""
    L = task.target
    progress.position, progress.touched, progress.furthest = tally.position, tally.touched, tally.furthest
    progress.time, progress.quiet, progress.end = tally.time, tally.quiet, tally.end
    tip_before = progress.tip
    progress.tip, progress.angle = tally.tip, angle
    progress.over_limit, progress.out_of_range = tally.over_limit, tally.out_of_range
    progress.updates = tally.updates
    progress.overshoot = overshoot(tally.tip, L)

    terms[:] = 0.0
    terms[_PROGRESS] = (min(tally.tip, L) - min(tip_before, L)) / L
    terms[_UNCONTROLLED] -= task.uncontrolled * tally.uncontrolled / L
    terms[_JUMP] -= task.jump * tally.jumped / (0.010 * 0.010)
    terms[_FORCE] -= task.force * tally.over_force * TICK / 100.0
    terms[_LAG] -= task.lag * tally.over_lag * TICK / 0.010
    terms[_BACKWARD] -= task.backward * tally.backward / L
    terms[_HASTE] -= task.haste * tally.haste / (2.0 * DECELERATION * TIP_TOLERANCE * L)
    terms[_TIME] -= task.time * tally.updates * TICK / TIME_SCALE
    if tally.end != 0:
        charge_end(task, progress, profile, terms)


@njit
def charge_end(task: Struct, progress: Struct, profile: Struct, terms: StructArray) -> None:
    """Charge the terminal cost, the same for every end, and the additional cost of an end for safety."""
    x = progress.position
    a = progress.tip
    stored = 0.5 * stiffness_at(profile, a)[0] * lag(x, a) ** 2
    terms[_TIP] -= task.tip_error * min(tip_error(a, task.target) / TIP_TOLERANCE, TIP_ERROR_CAP)
    terms[_WEDGE] -= wedge(progress.angle, task.wedge)  # weight times the wedge's width over depth
    terms[_STORED] -= task.stored * min(stored / (toughness_at(profile, a) * 0.003), WORST_STORED)
    if progress.end in (_FORCE_LIMIT, _OVERSHOOT):
        time_left = max(task.deadline - progress.time, 0.0)
        terms[_SAFETY] -= task.time * time_left / TIME_SCALE
        terms[_SAFETY] -= task.tip_error * TIP_ERROR_CAP + task.wedge + task.stored * WORST_STORED


@njit
def succeeded(task: Struct, progress: Struct) -> bool:
    """Return True if finished, with the tip within 3 mm of the target and the blade within 10 degrees of upright."""
    near = tip_error(progress.tip, task.target) <= TIP_TOLERANCE
    upright = abs(0.5 * math.pi - progress.angle) <= ANGLE_TOLERANCE
    success: bool = progress.end == _FINISHED and near and upright
    return success


@njit
def succeeded_all(tasks: StructArray, progresses: StructArray) -> StructArray:
    """Return :func:`succeeded` for n cuts, shape (n,)."""
    successes = np.zeros(len(tasks), np.bool_)
    for n in range(len(tasks)):
        successes[n] = succeeded(tasks[n], progresses[n])
    return successes
