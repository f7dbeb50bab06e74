"""Loops over updates of the law in the plane: a prescribed path of the blade, and commanded speeds and turns."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.intrinsics import keep_alive, without_refcount
from cutenv._engine.jit import njit, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.beside_row import beside_views, pad_beside, put_beside, take_beside
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.row import LANES, ONE, ROW, begin, note, plain_views, put, take, take_tissue
from cutenv.cutting.sensor import feel_row
from cutenv.cutting.simulate import EnergyAccount, Physics, account
from cutenv.cutting.steered_row import (
    ONE_PLACE,
    PLACE_ROW,
    PLACE_SCALARS,
    aim_place,
    steered_row,
)
from cutenv.cutting.update import drive_row


@njit
def account_of_steered(cuts: Physics, steerings: StructArray) -> EnergyAccount:
    """Return the energy account of a cut, shape (1,); what is held sideways is stored, too."""
    found = account(cuts.states[0], cuts.profiles[0])
    held = steerings[0].held
    return EnergyAccount(
        found.work, found.stored + held, found.fracture, found.friction, found.loss, found.ledger,
        found.residual - held,
    )  # fmt: skip


@njit
def follow_turns(
    cuts: Physics,
    steerings: StructArray,
    path: StructArray,
    dt: float,
    readings: StructArray,
    lateral: Array,
) -> None:
    """Move the blade of one cut exactly along a path, one row of it every ``dt`` [s]; no drive, no sensor.

    Parameters
    ----------
    cuts : Physics
        One cut, each part of shape (1,); its states and profiles are changed in place.
    steerings : Records
        Its place in the plane, :data:`~cutenv.cutting.steering.STEERING` of shape (1,), changed.
    path : array, shape (n, 3)
        Turn to the left [rad], below 0.5; then the way since the start [m], whose change is a motion where the blade
        points; angle of the blade [rad].
    dt : float
        [s]
    readings : Records
        :data:`~cutenv.cutting.dtypes.READING`, shape (n,), filled; positions are arc lengths of the line.
    lateral : array, shape (n,)
        Filled with the force of the tissue on the blade, to its right [N].
    """
    rows, all_places = np.zeros(1, ONE), np.zeros(1, ONE_PLACE)
    row, places = first_row(rows), first_row(all_places)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    beside = beside_views(all_places, steerings, 1, PLACE_SCALARS)
    take_tissue(row, plain, cuts.profiles[0], 0, 0)
    take_beside(beside, 0, 0)
    begin(row, plain, 1)
    for i in range(len(path)):
        way = row.blade[0] - row.hand[0]  # the law moves both along the line alike, but for the blade's own motion
        aim_place(places, 0, path[i, 0])
        row.dx[0], row.next_angle[0] = path[i, 1] - way, path[i, 2]
        row.turns = 1 if path[i, 2] != row.angle[0] else 0
        steered_row(row, places, cuts.profiles, steerings, dt)
        row.felt[0] = row.force[0]
        note(row, 0, readings[i], dt)
        lateral[i] = row.lateral[0]
    put(row, plain, 0, 0)
    put_beside(beside, 0, 0)
    keep_alive(rows)
    keep_alive(all_places)


@njit
def hold_steered(
    cuts: Physics,
    steerings: StructArray,
    speed: float,
    angle: float,
    turn_rate: float,
    readings: StructArray,
    lateral: Array,
) -> None:
    """Simulate one cut under one command for ``len(readings)`` milliseconds.

    Parameters
    ----------
    cuts : Physics
        One cut, each part of shape (1,), changed in place.
    steerings : Records
        Its place in the plane, :data:`~cutenv.cutting.steering.STEERING` of shape (1,), changed.
    speed, angle, turn_rate : float
        Command [m/s], [rad], [rad/s]; the last one to the left.
    readings, lateral : Records, array
        Filled, one for each millisecond; ``lateral`` is the true force on the blade to its right [N].
    """
    rows, all_places = np.zeros(1, ONE), np.zeros(1, ONE_PLACE)
    row, places = first_row(rows), first_row(all_places)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    beside = beside_views(all_places, steerings, 1, PLACE_SCALARS)
    take(row, plain, cuts.profiles[0], cuts.drives[0], cuts.sensors[0], 0, 0)
    take_beside(beside, 0, 0)
    row.given[0], row.aim[0] = speed, angle
    aim_place(places, 0, turn_rate * TICK)
    begin(row, plain, 1)
    for i in range(len(readings)):
        drive_row(row, TICK)
        steered_row(row, places, cuts.profiles, steerings, TICK)
        feel_row(row, cuts.sensors, i == 0)
        note(row, 0, readings[i], TICK)
        lateral[i] = row.lateral[0]
    put(row, plain, 0, 0)
    put_beside(beside, 0, 0)
    keep_alive(rows)
    keep_alive(all_places)


@njit_nogil
def hold_some_steered(
    passed: WorkQueue,
    core: int,
    cuts: Physics,
    steerings: StructArray,
    commands: StructArray,
    ticks: int,
    felt: StructArray,
) -> None:
    """Advance n cuts by ``ticks`` updates, each under one constant command; the bare physics loop, without a task.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts, steerings : Physics, Records
        The cuts and their places in the plane, changed in place.
    commands : array, shape (n, 3)
        Speed [m/s], angle [rad], rate of turn to the left [rad/s].
    ticks : int
        Number of updates, one millisecond each.
    felt : array, shape (n, 2)
        Filled with the last force measured along the blade's direction, and the true one to its right [N].
    """
    cuts = without_refcount(cuts)
    rows, all_places = np.zeros(1, ROW), np.zeros(1, PLACE_ROW)
    row, places = first_row(rows), first_row(all_places)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    beside = beside_views(all_places, steerings, LANES, PLACE_SCALARS)
    begun, end = next_chunk(passed, core, LANES)
    while begun < end:
        taken = end - begun
        for k in range(taken):
            n = begun + k
            take(row, plain, cuts.profiles[n], cuts.drives[n], cuts.sensors[n], k, n)
            take_beside(beside, k, n)
            row.given[k], row.aim[k] = commands[n, 0], commands[n, 1]
            aim_place(places, k, commands[n, 2] * TICK)
        begin(row, plain, taken)
        pad_beside(beside, taken)
        for i in range(ticks):
            drive_row(row, TICK)
            steered_row(row, places, cuts.profiles, steerings, TICK)
            feel_row(row, cuts.sensors, i == 0)
        for k in range(taken):
            put(row, plain, k, begun + k)
            put_beside(beside, k, begun + k)
            felt[begun + k, 0], felt[begun + k, 1] = row.felt[k], row.lateral[k]
        mark_done(passed, core, taken)
        begun, end = next_chunk(passed, core, LANES)
    keep_alive(rows)
    keep_alive(all_places)
