"""Loops over updates of the cutting law: one cut, a prescribed path, and thousands of cuts in parallel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.intrinsics import keep_alive, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.dtypes import DRIVE, LAW, PROFILE, STATE, TICK
from cutenv.cutting.law import stored_energy
from cutenv.cutting.row import LANES, ONE, ROW, begin, note, plain_views, put, take, take_tissue
from cutenv.cutting.sensor import SENSOR
from cutenv.cutting.update import cut_row, update_row
from cutenv.tissue.specimen import LENGTH


class Physics(NamedTuple):
    """The records of n cuts that the law needs to continue, structured arrays of shape (n,); hidden truth included."""

    states: StructArray
    profiles: StructArray
    laws: StructArray
    drives: StructArray
    sensors: StructArray


CUT: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("states", STATE, (1,)),
            ("profiles", PROFILE, (1,)),
            ("laws", LAW, (1,)),
            ("drives", DRIVE, (1,)),
            ("sensors", SENSOR, (1,)),
            ("rows", ONE, (1,)),  # memory of the calls
        ],
    )
)
"""One cut in one record, from Python passed in a third of the time of its parts; each is an array of shape (1,)."""


class EnergyAccount(NamedTuple):
    """Energies since reset [J]."""

    work: float
    stored: float
    fracture: float
    friction: float
    loss: float
    ledger: float
    residual: float
    """Work minus all the others."""


@njit_inline
def account(state: Struct, profile: Struct) -> EnergyAccount:
    """Return the energy account of a cut."""
    stored = stored_energy(profile, state.blade - state.creep, state.tip) + state.locked
    residual = state.work - stored - state.fracture - state.friction - state.loss - state.ledger
    return EnergyAccount(state.work, stored, state.fracture, state.friction, state.loss, state.ledger, residual)


@njit
def account_one(cuts: StructArray) -> EnergyAccount:
    """Return the energy account of one cut, :data:`CUT` of shape (1,)."""
    return account(cuts[0].states[0], cuts[0].profiles[0])


@njit
def hold(cuts: StructArray, speed: float, angle: float, readings: StructArray) -> None:
    """Simulate one cut under one command for ``len(readings)`` milliseconds.

    Parameters
    ----------
    cuts : Records
        The cut, :data:`CUT` of shape (1,), changed in place.
    speed, angle : float
        Command [m/s], [rad].
    readings : Records
        :data:`~cutenv.cutting.dtypes.READING`, filled, one for each millisecond.
    """
    c = cuts[0]
    row, plain = first_row(c.rows), plain_views(c.rows, c.states, c.laws, c.drives)
    take(row, plain, c.profiles[0], c.drives[0], c.sensors[0], 0, 0)
    row.given[0], row.aim[0] = speed, angle
    begin(row, plain, 1)
    for i in range(len(readings)):
        update_row(row, c.profiles, c.sensors, TICK, i == 0)
        note(row, 0, readings[i], TICK)
    put(row, plain, 0, 0)


@njit
def follow(
    states: StructArray,
    profiles: StructArray,
    laws: StructArray,
    positions: StructArray,
    angles: StructArray,
    dt: float,
    readings: StructArray,
) -> None:
    """Move the blade exactly through ``positions`` [m] and ``angles`` [rad], shape (n,), one every ``dt`` [s].

    No drive, no sensor: the force of a reading is the true one.  For derivations and checks of the law itself.

    Parameters
    ----------
    states, profiles, laws : Records
        One cut, shape (1,); the state is changed in place.
    positions, angles : array, shape (n,)
        The path, within the specimen.
    dt : float
        Time between them [s].
    readings : Records
        :data:`~cutenv.cutting.dtypes.READING`, shape (n,), filled.

    Raises
    ------
    ValueError
        If the path leaves the specimen.
    """
    drives, rows = np.zeros(1, DRIVE), np.zeros(1, ONE)
    row = first_row(rows)
    plain = plain_views(rows, states, laws, drives)
    take_tissue(row, plain, profiles[0], 0, 0)
    begin(row, plain, 1)
    for i in range(len(positions)):
        if not 0.0 <= positions[i] <= LENGTH:
            raise ValueError("positions leave the specimen: give metres from the clamp, 0 to 0.15")
        row.dx[0], row.next_angle[0] = positions[i] - row.blade[0], angles[i]
        row.turns = 1 if angles[i] != row.angle[0] else 0
        cut_row(row, profiles, dt)
        row.felt[0] = row.force[0]
        note(row, 0, readings[i], dt)
    put(row, plain, 0, 0)
    keep_alive(rows)


@njit_nogil
def hold_some(
    passed: WorkQueue, core: int, cuts: Physics, commands: StructArray, ticks: int, felt: StructArray
) -> None:
    """Advance n cuts by ``ticks`` updates, each under one constant command; the bare physics loop, without a task.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts : Physics
        The cuts, changed in place.
    commands : array, shape (n, 2)
        Speed [m/s] and angle [rad].
    ticks : int
        Number of updates, one millisecond each.
    felt : array, shape (n,)
        Filled with the last force measured [N].
    """
    cuts = without_refcount(cuts)
    rows = np.zeros(1, ROW)
    row, plain = first_row(rows), plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    begun, end = next_chunk(passed, core, LANES)
    while begun < end:
        taken = end - begun
        for k in range(taken):
            n = begun + k
            take(row, plain, cuts.profiles[n], cuts.drives[n], cuts.sensors[n], k, n)
            row.given[k], row.aim[k] = commands[n, 0], commands[n, 1]
        begin(row, plain, taken)
        for i in range(ticks):
            update_row(row, cuts.profiles, cuts.sensors, TICK, i == 0)
        for k in range(taken):
            put(row, plain, k, begun + k)
            felt[begun + k] = row.felt[k]
        mark_done(passed, core, taken)
        begun, end = next_chunk(passed, core, LANES)
    keep_alive(rows)
