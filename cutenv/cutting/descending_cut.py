"""Loops over updates of the law where depth is a degree of freedom: a prescribed path, and commanded speeds."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.intrinsics import keep_alive, without_refcount
from cutenv._engine.jit import njit, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.beside_row import beside_views, pad_beside, put_beside, take_beside
from cutenv.cutting.descending_row import LEVEL_ROW, LEVEL_SCALARS, ONE_LEVEL, descending_row, lower_row
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.row import LANES, ONE, ROW, begin, note, plain_views, put, take, take_tissue
from cutenv.cutting.sensor import feel_row
from cutenv.cutting.simulate import EnergyAccount, Physics, account
from cutenv.cutting.update import drive_row
from cutenv.tissue.specimen import LENGTH


@njit
def account_of_descending(cuts: Physics, descents: StructArray) -> EnergyAccount:
    """Return the energy account of a cut, shape (1,); what presses on the floor is stored, too."""
    found = account(cuts.states[0], cuts.profiles[0])
    pressed = descents[0].pressed
    return EnergyAccount(
        found.work, found.stored + pressed, found.fracture, found.friction, found.loss, found.ledger,
        found.residual - pressed,
    )  # fmt: skip


@njit
def follow_levels(
    cuts: Physics,
    descents: StructArray,
    slabs: StructArray,
    path: StructArray,
    dt: float,
    readings: StructArray,
    vertical: Array,
) -> None:
    """Move the blade of one cut exactly along a path, one row of it every ``dt`` [s]; no drive, no sensor.

    Parameters
    ----------
    cuts : Physics
        One cut, each part of shape (1,); its states and profiles are changed in place.
    descents, slabs : Records
        Its vertical motion, :data:`~cutenv.cutting.descent.DESCENT` of shape (1,), changed; its slab, shape (1,).
    path : array, shape (n, 3)
        Position [m], level [m] and angle [rad], within the specimen.
    dt : float
        [s]
    readings : Records
        :data:`~cutenv.cutting.dtypes.READING`, shape (n,), filled.
    vertical : array, shape (n,)
        Filled with the force of the tissue on the blade, upwards [N].

    Raises
    ------
    ValueError
        If the path leaves the specimen.
    """
    rows, all_levels = np.zeros(1, ONE), np.zeros(1, ONE_LEVEL)
    row, levels = first_row(rows), first_row(all_levels)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    beside = beside_views(all_levels, descents, 1, LEVEL_SCALARS)
    take_beside(beside, 0, 0)
    take_tissue(row, plain, cuts.profiles[0], 0, 0)
    begin(row, plain, 1)
    for i in range(len(path)):
        if not 0.0 <= path[i, 0] <= LENGTH:
            raise ValueError("positions leave the specimen: give metres from the clamp, 0 to 0.15")
        row.dx[0], levels.next_level[0], row.next_angle[0] = path[i, 0] - row.blade[0], path[i, 1], path[i, 2]
        row.turns = 1 if path[i, 2] != row.angle[0] else 0
        descending_row(row, levels, beside, cuts.profiles, descents, slabs, dt)
        row.felt[0] = row.force[0]
        note(row, 0, readings[i], dt)
        vertical[i] = levels.vertical[0]
    put(row, plain, 0, 0)
    put_beside(beside, 0, 0)
    keep_alive(rows)
    keep_alive(all_levels)


@njit
def hold_descending(
    cuts: Physics,
    descents: StructArray,
    slabs: StructArray,
    speed: float,
    angle: float,
    descent_speed: float,
    readings: StructArray,
    vertical: Array,
) -> None:
    """Simulate one cut under one command for ``len(readings)`` milliseconds.

    Parameters
    ----------
    cuts : Physics
        One cut, each part of shape (1,), changed in place.
    descents, slabs : Records
        Its vertical motion, :data:`~cutenv.cutting.descent.DESCENT` of shape (1,), changed; its slab, shape (1,).
    speed, angle, descent_speed : float
        Command [m/s], [rad], [m/s]; the last one downwards.
    readings, vertical : Records, array
        Filled, one for each millisecond; ``vertical`` is the true force upwards on the blade [N].
    """
    rows, all_levels = np.zeros(1, ONE), np.zeros(1, ONE_LEVEL)
    row, levels = first_row(rows), first_row(all_levels)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    beside = beside_views(all_levels, descents, 1, LEVEL_SCALARS)
    take(row, plain, cuts.profiles[0], cuts.drives[0], cuts.sensors[0], 0, 0)
    take_beside(beside, 0, 0)
    row.given[0], row.aim[0], levels.descent_speed[0] = speed, angle, descent_speed
    begin(row, plain, 1)
    for i in range(len(readings)):
        drive_row(row, TICK)
        lower_row(levels)
        descending_row(row, levels, beside, cuts.profiles, descents, slabs, TICK)
        feel_row(row, cuts.sensors, i == 0)
        note(row, 0, readings[i], TICK)
        vertical[i] = levels.vertical[0]
    put(row, plain, 0, 0)
    put_beside(beside, 0, 0)
    keep_alive(rows)
    keep_alive(all_levels)


@njit_nogil
def hold_some_descending(
    passed: WorkQueue,
    core: int,
    cuts: Physics,
    descents: StructArray,
    slabs: StructArray,
    commands: StructArray,
    ticks: int,
    felt: StructArray,
) -> None:
    """Advance n cuts by ``ticks`` updates, each under one constant command; the bare physics loop, without a task.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts, descents : Physics, Records
        The cuts and their vertical motions, changed in place.
    slabs : Records
        The slab of them all, shape (1,).
    commands : array, shape (n, 3)
        Speed [m/s], angle [rad], speed downwards [m/s].
    ticks : int
        Number of updates, one millisecond each.
    felt : array, shape (n, 2)
        Filled with the last force measured along the cut, and the true one upwards [N].
    """
    cuts = without_refcount(cuts)
    rows, all_levels = np.zeros(1, ROW), np.zeros(1, LEVEL_ROW)
    row, levels = first_row(rows), first_row(all_levels)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    beside = beside_views(all_levels, descents, LANES, LEVEL_SCALARS)
    begun, end = next_chunk(passed, core, LANES)
    while begun < end:
        taken = end - begun
        for k in range(taken):
            n = begun + k
            take(row, plain, cuts.profiles[n], cuts.drives[n], cuts.sensors[n], k, n)
            take_beside(beside, k, n)
            row.given[k], row.aim[k], levels.descent_speed[k] = commands[n, 0], commands[n, 1], commands[n, 2]
        begin(row, plain, taken)
        pad_beside(beside, taken)
        for i in range(ticks):
            drive_row(row, TICK)
            lower_row(levels)
            descending_row(row, levels, beside, cuts.profiles, descents, slabs, TICK)
            feel_row(row, cuts.sensors, i == 0)
        for k in range(taken):
            put(row, plain, k, begun + k)
            put_beside(beside, k, begun + k)
            felt[begun + k, 0], felt[begun + k, 1] = row.felt[k], levels.vertical[k]
        mark_done(passed, core, taken)
        begun, end = next_chunk(passed, core, LANES)
    keep_alive(rows)
    keep_alive(all_levels)
