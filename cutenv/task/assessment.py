"""The reward and the ends of gentle cutting, assessed at every millisecond so that nothing hides between decisions.

Reward of a step = progress / L - costs.  All costs are non-negative and extensive: they add up as they occur.  At the
end, whichever it is, the same terminal cost is charged; an end for safety also pays the worst that stopping could
still have cost, so that it never pays to end early:

    time left, tip error at its cap, a full wedge, and a tissue left loaded.

Costs that have no bound (force, lag, jumps, backward travel) are not in that worst case: a policy that stops and
unloads escapes them, so a breach is dearer than stopping in every state.
"""

from __future__ import annotations

import math

import numpy as np

from cutenv.compiled import compiled
from cutenv.cutting.law import depth_at, stiffness_at, toughness_at
from cutenv.cutting.records import TICK, Record, Records
from cutenv.terms import ANGLE_TOLERANCE, TIP_TOLERANCE, force_per_depth, lag, overshoot, tip_error, wedge

FORCE_ALLOWED = 400.0
"""Force per depth of cut that costs nothing [N/m]."""
LAG_ALLOWED = 0.010
"""Lag of the tip behind the blade that costs nothing [m]."""
OVERSHOOT_ALLOWED = 0.005
"""Tip beyond the target, above which the task ends [m]."""
TIP_ERROR_CAP = 3.0
"""Largest tip error that is charged, in tolerances."""
TRAVEL_TO_FINISH = 0.010
"""The task can be finished once the blade has been this far [m]."""
SPEED_AT_REST = 0.5e-3
"""[m/s]"""
FORCE_UNLOADED = 0.1
"""Above friction, below which the blade counts as unloaded [N]."""
TIME_AT_REST = 0.3
"""Rest and unloaded for this long is finished [s]."""
DECELERATION = 0.1
"""Of a blade that is stopped, in the cost of haste [m/s2]."""
TIME_SCALE = 30.0
"""Time that costs its weight once [s]."""
WORST_STORED = 2.0
"""Stored energy charged to an end for safety, in R B 3 mm: a tip 12 mm behind at F = R B."""

_PROGRESS, _UNCONTROLLED, _JUMP, _FORCE, _LAG, _BACKWARD, _HASTE, _TIME, _TIP, _WEDGE, _STORED, _SAFETY = range(12)
_FINISHED, _FORCE_LIMIT, _OVERSHOOT, _DEADLINE = range(1, 5)
_SHALLOWEST = 0.001  # [m], below which force per depth would be noise over nothing


@compiled
def assess(
    task: Record,
    progress: Record,
    profile: Record,
    readings: Records,
    from_truth: bool,
    tips: Records,
    jumps: Records,
    terms: Records,
) -> None:
    """Charge one step to the reward's terms and find out whether the task has ended.

    Parameters
    ----------
    task : Record
        :data:`~cutenv.task.records.TASK`.
    progress : Record
        :data:`~cutenv.task.records.PROGRESS`, changed in place.
    profile : Record
        :data:`~cutenv.cutting.records.PROFILE`: the tissue, true or nominal.
    readings : Records
        :data:`~cutenv.cutting.records.READING`, shape (ticks,).
    from_truth : bool
        Whether force on the blade, crack tip and unstable growth are the true ones of the readings, or the force is
        the measured one and the others are estimates.
    tips, jumps : array, shape (ticks,)
        Estimates of the tip and of unstable growth at each tick [m].
    terms : array, shape (12,)
        Filled with the terms of this step in the order of :data:`~cutenv.task.records.TERMS`; their sum is the reward.
    """
    L = task.target
    force_limit, friction = task.force_limit_per_depth, task.friction_per_depth
    x, touched, furthest = progress.position, progress.touched, progress.furthest
    time, quiet, end = progress.time, progress.quiet, 0
    tip_before = a = progress.tip
    over_limit, out_of_range, updates = 0.0, 0, 0
    # Sums of what the weights are for; multiplied once, at the end.
    uncontrolled = jumped = over_force = over_lag = backward = haste = 0.0
    for i in range(len(readings)):
        reading = readings[i]
        moved = reading.position - x
        x = reading.position
        a = reading.tip if from_truth else tips[i]
        jump = reading.jump if from_truth else jumps[i]
        speed = abs(reading.speed)
        force = abs(reading.true_force if from_truth else reading.force)
        depth = max(depth_at(profile, x), _SHALLOWEST)

        if jump != 0.0:
            uncontrolled += jump
            jumped += jump**2
        if force > FORCE_ALLOWED * depth:
            over_force += force_per_depth(force, depth) - FORCE_ALLOWED
        over_lag += max(lag(x, a) - LAG_ALLOWED, 0.0)
        if touched == 1:
            backward += max(-moved, 0.0)
        haste += speed**2 * abs(moved)

        touched = 1 if x > a else touched
        furthest = max(furthest, x)
        time += TICK
        updates += 1
        over_limit = max(over_limit, force - force_limit * depth)
        if speed != 0.0 and not task.speed_min <= speed <= task.speed_max:
            out_of_range += 1

        unloaded = reading.force < friction * depth + FORCE_UNLOADED
        quiet = quiet + TICK if speed < SPEED_AT_REST and unloaded and furthest >= TRAVEL_TO_FINISH else 0.0

        if force > force_limit * depth:
            end = _FORCE_LIMIT
        elif a > L + OVERSHOOT_ALLOWED:
            end = _OVERSHOOT
        elif quiet >= TIME_AT_REST - 0.5 * TICK:
            end = _FINISHED
        elif time >= task.deadline - 0.5 * TICK:
            end = _DEADLINE
        if end != 0:
            break

    progress.position, progress.touched, progress.furthest = x, touched, furthest
    progress.time, progress.quiet, progress.end = time, quiet, end
    progress.tip, progress.angle = a, readings[updates - 1].angle
    progress.over_limit, progress.out_of_range, progress.updates = over_limit, out_of_range, updates
    progress.overshoot = overshoot(a, L)

    terms[:] = 0.0
    terms[_PROGRESS] = (min(a, L) - min(tip_before, L)) / L
    terms[_UNCONTROLLED] -= task.uncontrolled * uncontrolled / L
    terms[_JUMP] -= task.jump * jumped / 0.010**2
    terms[_FORCE] -= task.force * over_force * TICK / 100.0
    terms[_LAG] -= task.lag * over_lag * TICK / 0.010
    terms[_BACKWARD] -= task.backward * backward / L
    terms[_HASTE] -= task.haste * haste / (2.0 * DECELERATION * TIP_TOLERANCE * L)
    terms[_TIME] -= task.time * updates * TICK / TIME_SCALE
    if end != 0:
        charge_end(task, progress, profile, terms)


@compiled
def charge_end(task: Record, progress: Record, profile: Record, terms: Records) -> None:
    """The terminal cost, the same for every end, and what an end for safety pays besides."""
    x = progress.position
    a = progress.tip
    stored = 0.5 * stiffness_at(profile, a)[0] * lag(x, a) ** 2
    terms[_TIP] -= task.tip_error * min(tip_error(a, task.target) / TIP_TOLERANCE, TIP_ERROR_CAP)
    terms[_WEDGE] -= wedge(progress.angle, task.wedge)  # as deep as the weight: costs as much as it is wide
    terms[_STORED] -= task.stored * stored / (toughness_at(profile, a) * 0.003)
    if progress.end in (_FORCE_LIMIT, _OVERSHOOT):
        time_left = max(task.deadline - progress.time, 0.0)
        terms[_SAFETY] -= task.time * time_left / TIME_SCALE
        terms[_SAFETY] -= task.tip_error * TIP_ERROR_CAP + task.wedge + task.stored * WORST_STORED


@compiled
def succeeded(task: Record, progress: Record) -> bool:
    """Finished, tip within 3 mm of the target, blade within 10 degrees of upright."""
    near = tip_error(progress.tip, task.target) <= TIP_TOLERANCE
    upright = abs(0.5 * math.pi - progress.angle) <= ANGLE_TOLERANCE
    success: bool = progress.end == _FINISHED and near and upright
    return success


@compiled
def succeeded_all(tasks: Records, progresses: Records) -> Records:
    """:func:`succeeded` of n cuts, shape (n,)."""
    successes = np.zeros(len(tasks), np.bool_)
    for n in range(len(tasks)):
        successes[n] = succeeded(tasks[n], progresses[n])
    return successes
