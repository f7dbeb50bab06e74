"""Loops over updates of the cutting law: one cut, a path, many in parallel."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.declared import compiled_for
from cutenv._engine.intrinsics import first_row, keep_alive, without_refcount
from cutenv._engine.jit import njit, njit_nogil
from cutenv._engine.parallel import WorkQueue, mark_done, next_chunk
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.law import EnergyAccount, account
from cutenv.sim.cutting.motion import STRAIGHT, Motion, Moving
from cutenv.sim.cutting.row import (
    LANES,
    ROW,
    begin,
    gather,
    lane_views,
    note,
    pad,
    plain_views,
    put,
    scatter,
    take,
    take_tissue,
)
from cutenv.sim.cutting.update import cut_row, update_row
from cutenv.sim.tissue.specimen import LENGTH


class Physics(NamedTuple):
    """Records of n cuts that the law needs to continue, hidden truth included."""

    states: StructArray
    profiles: StructArray
    laws: StructArray
    drives: StructArray
    sensors: StructArray
    motions: StructArray  # records of the motion, record
    shared: StructArray  # record that all cuts share, shape (1,)


CUT = STRAIGHT.cut  # one straight cut in one record


@compiled_for(njit)
def account_one(motion: Motion) -> Callable[..., EnergyAccount]:
    """Return the function that tells the energies of one cut."""
    stored = motion.stored

    def account_one(cuts: StructArray) -> EnergyAccount:
        """Return the energy account of one cut, :attr:`~cutenv.sim.cutting.motion.Motion.cut` of shape (1,)."""
        c = cuts[0]
        found = account(c.states[0], c.profiles[0])
        if stored is None:
            return found
        further = stored(c.motions[0])
        return EnergyAccount(
            found.work, found.stored + further, found.fracture, found.friction, found.loss, found.ledger,
            found.residual - further,
        )  # fmt: skip

    return account_one


@compiled_for(njit)
def hold(motion: Motion) -> Callable[..., None]:
    """Return the function that simulates one cut under one command."""
    update, scalars, command, force = update_row(motion), motion.scalars, motion.command, motion.force

    def hold(
        cuts: StructArray,
        shared: StructArray,
        commanded: tuple[float, float, float],
        readings: StructArray,
        across: Array,
    ) -> None:
        """Simulate one cut under one command for ``len(readings)`` milliseconds.

        ``cuts``, (1,), is :attr:`~cutenv.sim.cutting.motion.Motion.cut`, changed in place; ``shared`` what all cuts of
        its motion share.  ``commanded`` are speed [m/s], angle [rad], and command of the motion's further axis.
        ``readings`` are filled, and, if it is not empty, ``across`` with the true force on the blade upwards or to its
        right [N], (n,).
        """
        c = cuts[0]
        row, plain = first_row(c.rows), plain_views(c.rows, c.states, c.laws, c.drives)
        motions = Moving(first_row(c.lanes), lane_views(c.lanes, c.motions, 1, scalars), c.motions, shared)
        take(row, plain, c, 0, 0)
        gather(motions.views, 0, 0)
        row.given[0], row.aim[0] = commanded[0], commanded[1]
        if command is not None:
            command(motions.lanes, 0, commanded[2])
        begin(row, plain, 1)
        for i in range(len(readings)):
            update(row, motions, c.profiles, c.sensors, i == 0)
            note(row, 0, readings[i], TICK)
            if force is not None and len(across) > 0:
                across[i] = force(motions.lanes, 0)
        put(row, plain, 0, 0)
        scatter(motions.views, 0, 0)

    return hold


@compiled_for(njit)
def follow(motion: Motion) -> Callable[..., None]:
    """Return the function that leads a blade exactly along a path."""
    cut, scalars, lead, force = cut_row(motion), motion.scalars, motion.lead, motion.force
    bounded = not motion.stops_at_ends

    def follow(
        cuts: StructArray, shared: StructArray, path: Array, dt: float, readings: StructArray, across: Array
    ) -> None:
        """Move a blade exactly along ``path``, without drive and sensor.

        The arguments are those of :func:`hold`, but for ``path``, (n, 3), every ``dt`` [s]: position within the
        specimen [m], angle [rad], and the further axis: level [m], or turn to the left [rad] below 0.5, after which the
        position is the way since the start, whose change leads where the blade points.  The readings' force is the true
        one.  ValueError if the path leaves the specimen.
        """
        c = cuts[0]
        row, plain = first_row(c.rows), plain_views(c.rows, c.states, c.laws, c.drives)
        motions = Moving(first_row(c.lanes), lane_views(c.lanes, c.motions, 1, scalars), c.motions, shared)
        take_tissue(row, plain, c.profiles[0], 0, 0)
        gather(motions.views, 0, 0)
        begin(row, plain, 1)
        for i in range(len(path)):
            if bounded and not 0.0 <= path[i, 0] <= LENGTH:
                raise ValueError("positions leave the specimen: give metres from the clamp, 0 to 0.15")
            led_from = row.blade[0] if lead is None else lead(row, motions.lanes, path[i, 2])
            row.dx[0], row.next_angle[0] = path[i, 0] - led_from, path[i, 1]
            row.turns = 1 if path[i, 1] != row.angle[0] else 0
            cut(row, motions, c.profiles, dt)
            row.felt[0] = row.force[0]
            note(row, 0, readings[i], dt)
            if force is not None and len(across) > 0:
                across[i] = force(motions.lanes, 0)
        put(row, plain, 0, 0)
        scatter(motions.views, 0, 0)

    return follow


@compiled_for(njit_nogil)
def hold_some(motion: Motion) -> Callable[..., None]:
    """Return the function that simulates many cuts under constant commands."""
    update, scalars, command, force = update_row(motion), motion.scalars, motion.command, motion.force
    lanes_of_row = motion.lanes(LANES)

    def hold_some(
        passed: WorkQueue, core: int, cuts: Physics, commands: StructArray, ticks: int, felt: StructArray
    ) -> None:
        """Advance n cuts by ``ticks`` milliseconds, each under one constant command.

        ``passed`` and ``core`` are those of :func:`cutenv._engine.parallel.parallel_for`.  ``commands``, (n, 3), are
        speed [m/s], angle [rad], and that of the further axis; ``felt``, (n, 2), is filled with the last force measured
        along the cut, and the true one across it [N].
        """
        cuts = without_refcount(cuts)
        rows, lanes = np.zeros(1, ROW), np.zeros(1, lanes_of_row)
        row, plain = first_row(rows), plain_views(rows, cuts.states, cuts.laws, cuts.drives)
        motions = Moving(first_row(lanes), lane_views(lanes, cuts.motions, LANES, scalars), cuts.motions, cuts.shared)
        begun, end = next_chunk(passed, core, LANES)
        while begun < end:
            taken = end - begun
            for k in range(taken):
                n = begun + k
                take(row, plain, cuts, k, n)
                gather(motions.views, k, n)
                row.given[k], row.aim[k] = commands[n, 0], commands[n, 1]
                if command is not None:
                    command(motions.lanes, k, commands[n, 2])
            begin(row, plain, taken)
            pad(motions.views, taken)
            for i in range(ticks):
                update(row, motions, cuts.profiles, cuts.sensors, i == 0)
            for k in range(taken):
                put(row, plain, k, begun + k)
                scatter(motions.views, k, begun + k)
                felt[begun + k, 0] = row.felt[k]
                felt[begun + k, 1] = 0.0 if force is None else force(motions.lanes, k)
            mark_done(passed, core, taken)
            begun, end = next_chunk(passed, core, LANES)
        keep_alive(rows)
        keep_alive(lanes)

    return hold_some
