"""Vertical motion for a row of cuts: levels and forces as a structure of arrays (SIMD lanes), beside that of the law.

Arithmetic is in loops that compile to vector instructions, as in :mod:`cutenv.cutting.update`.  Floor and tissue
respond one cut after the other.
"""

from __future__ import annotations

import math

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit_inline, njit_internal
from cutenv.cutting.beside_row import Beside, beside_dtype, put_beside, scalars_of, take_beside
from cutenv.cutting.descent import (
    DESCENT,
    renew,
    renew_between,
    renew_edge,
    rise_with_depth,
)
from cutenv.cutting.drive import velocity_loop_step
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import LONGEST_ADVANCE, depth_at, grid_index, stiffness_at, toughness_at
from cutenv.cutting.row import LANES
from cutenv.cutting.update import grow_row, leap_row, load_row, look_row, relax_row, run_row, turn_row
from cutenv.tissue.floor import press
from cutenv.tissue.grid import POINTS_PER_METRE

LOWEST, HIGHEST = -0.025, 0.025
"""Ends of the blade's vertical travel [m]."""
_LEAST_CHANGE = 1e-6  # of the level engaged, from which the stiffness's rise with depth is taken [m]
_PASSING = (  # scratch: it lives only in the row
    ("descent_speed", "f8"),  # commanded, downwards [m/s]
    ("next_level", "f8"),  # to which the blade goes in this update [m]
)
LEVEL_ROW = beside_dtype(DESCENT, _PASSING, LANES)
"""Vertical motions beside a :data:`~cutenv.cutting.row.ROW`."""
ONE_LEVEL = beside_dtype(DESCENT, _PASSING, 1)
"""Vertical motion beside a :data:`~cutenv.cutting.row.ONE`."""
LEVEL_SCALARS = scalars_of(DESCENT)
"""Scalars that a record of a vertical motion begins with."""


@njit_inline
def lower_row(levels: Struct) -> None:
    """Advance every vertical drive by a millisecond under its commanded speed downwards, ``levels.descent_speed``."""
    for n in range(len(levels.level)):
        level, speed, wanted = levels.level[n], levels.level_speed[n], -levels.descent_speed[n]
        height, next_speed = velocity_loop_step(
            level - LOWEST, speed, wanted, levels.gain[n], levels.acceleration[n], HIGHEST - LOWEST, TICK
        )
        rests = wanted == 0.0 and speed == 0.0
        levels.level_speed[n] = speed if rests else next_speed
        levels.next_level[n] = level if rests or next_speed == 0.0 else height + LOWEST


@njit_inline
def descending_row(
    row: Struct,
    levels: Struct,
    beside: Beside,
    profiles: StructArray,
    descents: StructArray,
    slabs: StructArray,
    dt: float,
) -> None:
    """Advance the law as :func:`~cutenv.cutting.update.cut_row`; then each blade goes to ``levels.next_level``."""
    slab = slabs[0]
    if row.turns > 0:
        turn_row(row, profiles)
    if row.relaxing > 0:
        relax_row(row, dt)
    load_row(row, dt)
    if row.points > 0 or row.leaps > 0:
        for n in range(row.taken):
            i, j, far = row.tip_point[n], row.blade_point[n], row.da[n] > LONGEST_ADVANCE
            if i != row.seen_tip_point[n] or j != row.seen_blade_point[n] or far:
                profile, descent = profiles[row.cut[n]], descents[row.cut[n]]
                if far:
                    renew_between(profile, descent, slab, row.tip[n], row.blade[n])
                renew(profile, descent, slab, i)
                renew(profile, descent, slab, i + 1)
                renew_edge(profile, descent, j)
                renew_edge(profile, descent, j + 1)
    if row.leaps > 0:
        leap_row(row, profiles)
    if row.points > 0:
        look_row(row, profiles)
    grow_row(row)
    if row.runs > 0:
        for n in range(row.taken):
            if row.waits[n] == 0:
                renew_between(profiles[row.cut[n]], descents[row.cut[n]], slab, row.tip[n], row.blade[n])
        run_row(row, profiles)
    due = 0
    for n in range(len(row.blade)):
        row.force[n] = row.elastic[n] + row.rubbing[n]
        levels.waiting[n] -= 1
        due += 1 if levels.waiting[n] <= 0 else 0
    move_to_level(row, levels)
    if due > 0:
        for n in range(row.taken):
            if row.going[n] == 1 and levels.waiting[n] <= 0:
                put_beside(beside, n, row.cut[n])
                respond(row, profiles[row.cut[n]], descents[row.cut[n]], slab, n)
                take_beside(beside, n, row.cut[n])
    tell_forces(row, levels)


@njit_inline
def move_to_level(row: Struct, levels: Struct) -> None:
    """Move each blade to its next level: it rubs, and its edge presses on springs."""
    for n in range(len(row.blade)):
        fall = levels.level[n] - levels.next_level[n]
        levels.level[n] = levels.next_level[n]
        grip = math.copysign(row.friction_per_depth[n] * row.depth[n], fall) if fall != 0.0 else 0.0
        was, spring = levels.bearing[n], levels.spring[n]
        bearing = was + spring * fall
        rises = bearing < 0.0  # it leaves the floor on the way
        pressing = -0.5 * was**2 / spring if rises else 0.5 * (was + bearing) * fall
        rubbed = grip * fall
        levels.grip[n] = grip
        levels.bearing[n] = 0.0 if rises else bearing
        levels.pressed[n] += pressing
        row.work[n] += pressing + rubbed
        row.friction[n] += rubbed


@njit_inline
def tell_forces(row: Struct, levels: Struct) -> None:
    """Tell the forces upwards, and add that of slicing to the force along the cut."""
    for n in range(len(row.blade)):
        lag = max(row.blade[n] - row.creep[n] - row.tip[n], 0.0)
        levels.vertical[n] = levels.bearing[n] + levels.grip[n] + 0.5 * levels.rise[n] * lag**2
        # It reverses as friction on the faces does.
        drag = levels.slicing[n] * row.bristle[n] * row.per_presliding_length[n] if levels.slicing[n] > 0.0 else 0.0
        levels.drag[n] = drag
        row.force[n] += drag


@njit_internal
def respond(row: Struct, profile: Struct, descent: Struct, slab: Struct, n: int) -> None:
    """Let the floor of the cut and the tissue respond to the motion since they last did."""
    a, x = row.tip[n], row.blade[n]
    moved, fall = x - descent.blade, descent.settled - descent.level
    lag, grown, cell = x - row.creep[n] - a, a - descent.tip, int(a * POINTS_PER_METRE + 0.5)
    onwards = cell != descent.cell
    for i in range(descent.cell + 1, cell + 1):
        descent.floor[i] = descent.engaged
    descent.waiting, descent.blade, descent.settled = descent.response, x, descent.level
    descent.cell, descent.tip = cell, a
    # A loading blade carries the tissue with it: the edge is drawn through it as far as the tip advances.  What a run
    # advances at once is drawn as the blade moves on, so that the force of slicing stays that of its motion.
    if lag >= 0.0:
        descent.owed_slip += grown
        slip = min(descent.owed_slip, max(moved, 0.0))
        descent.owed_slip -= slip
    else:
        descent.owed_slip, slip = 0.0, abs(moved)

    at, sliced = a + min(lag, 0.0), 0.0  # the leading end of the edge, in the tissue
    under = int(at * POINTS_PER_METRE + 0.5)
    if fall != 0.0 or descent.pressed != 0.0 or under != descent.under:
        descent.under = under
        pressing, released, spent, sliced, descent.bearing, descent.spring = press(descent, at, a, slip)
        surplus = spent - released
        row.work[n] += (pressing - descent.pressed) + max(surplus, 0.0)
        row.fracture[n] += spent
        row.loss[n] += max(-surplus, 0.0)
        descent.pressed = pressing - released
        sliced = max(surplus, 0.0) if fall <= 0.0 else min(max(surplus, 0.0), sliced)
    engaged = max(descent.level, descent.floor[cell])
    if engaged != descent.engaged:
        gained = engage(row, profile, descent, slab, n, engaged, max(lag, 0.0))
        row.work[n] += gained
        sliced += max(gained, 0.0) if fall == 0.0 else 0.0
    elif onwards or descent.rise == 0.0:
        descent.rise = rise_with_depth(descent, slab, cell)
    descent.untold = max(descent.untold - descent.slicing * abs(moved), 0.0) + (sliced if moved != 0.0 else 0.0)
    descent.slicing = descent.untold * POINTS_PER_METRE


@njit_internal
def engage(row: Struct, profile: Struct, descent: Struct, slab: Struct, n: int, engaged: float, lag: float) -> float:
    """Engage one blade down to another level ``engaged`` [m]; return the work that it takes [J]."""
    a, x, K, toughness = row.tip[n], row.blade[n], row.K[n], row.toughness[n]
    change = descent.engaged - engaged
    descent.engaged = engaged
    descent.version += 1
    renew_between(profile, descent, slab, a, a)
    j = grid_index(x)[0]
    renew_edge(profile, descent, j)
    renew_edge(profile, descent, j + 1)
    row.K[n], row.dK[n] = stiffness_at(profile, a)
    row.toughness[n], row.depth[n] = toughness_at(profile, a), depth_at(profile, x)
    row.seen_tip_point[n], row.seen_blade_point[n] = -1, -1
    row.held_force[n] *= row.toughness[n] / toughness
    row.elastic[n] = row.K[n] * lag
    row.force[n] += row.elastic[n] - K * lag
    if abs(change) > _LEAST_CHANGE:
        descent.rise = (row.K[n] - K) / change
    else:
        descent.rise = rise_with_depth(descent, slab, descent.cell)
    return 0.5 * (row.K[n] - K) * lag**2  # type: ignore[no-any-return]
