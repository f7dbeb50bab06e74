"""One update of drive, law and sensor, and loops over updates: for one cut and for thousands in parallel."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.drive import lag_gain, motion, rate_limited
from cutenv.cutting.dtypes import DRIVE, LAW, PROFILE, STATE
from cutenv.cutting.friction import grip
from cutenv.cutting.law import cut, depth_at, elastic_force, stored_energy
from cutenv.cutting.sensor import SENSOR, measure
from cutenv.tissue.specimen import LENGTH

ENERGIES = ("work", "stored", "fracture", "friction", "loss", "ledger", "residual")
"""The energy account; residual is work minus all the others."""

CUT: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("state", STATE),
            ("profile", PROFILE),
            ("law", LAW),
            ("drive", DRIVE),
            ("sensor", SENSOR),
            ("state_before", STATE),  # before the last call of :func:`hold`
            ("sensor_before", SENSOR),
        ],
    )
)
"""Structured dtype of one cut: everything that the law needs to continue."""


@njit
def update(
    state: Struct,
    profile: Struct,
    law: Struct,
    drive: Struct,
    sensor: Struct,
    share: float,
    speed: float,
    angle: float,
    dt: float,
    reading: Struct,
) -> None:
    """Advance a cut by one force update under a commanded speed [m/s] and angle [rad]; fills ``reading``.

    ``share`` is the gain of the drive, :func:`~cutenv.cutting.drive.lag_gain`, the same for every update of ``dt``.
    """
    elastic, depth = 0.0, 0.0
    if drive.mass > 0.0:  # a hand yields to force, a rig does not
        elastic, depth = elastic_force(profile, state.blade - state.creep, state.tip), depth_at(profile, state.blade)
    dx = motion(state, drive, share, speed, elastic, grip(law, depth, state.bristle), dt)
    elastic, friction, jump = cut(
        state, profile, law, dx, rate_limited(state.angle, angle, drive.rotation_rate, dt), dt
    )
    state.tick += 1
    measured = measure(sensor, elastic + friction, state.tick - 1)
    _note(state, reading, measured, elastic, friction, jump, dt)
    if drive.backlash > 0.0:  # the encoder sits at the motor
        reading.position = state.hand
        reading.speed = state.hand_speed


@njit
def follow(
    state: Struct,
    profile: Struct,
    law: Struct,
    positions: StructArray,
    angles: StructArray,
    dt: float,
    readings: StructArray,
) -> None:
    """Move the blade exactly through ``positions`` [m] and ``angles`` [rad], shape (n,), one every ``dt`` [s].

    No drive, no sensor: the reading is the true force.  For derivations and checks of the law itself.
    """
    for i in range(len(positions)):
        if not 0.0 <= positions[i] <= LENGTH:
            raise ValueError("positions leave the specimen: give metres from the clamp, 0 to 0.15")
        dx = positions[i] - state.blade
        elastic, friction, jump = cut(state, profile, law, dx, angles[i], dt)
        state.speed = dx / dt
        state.tick += 1
        _note(state, readings[i], elastic + friction, elastic, friction, jump, dt)


@njit_internal
def _note(
    state: Struct, reading: Struct, measured: float, elastic: float, friction: float, jump: float, dt: float
) -> None:
    reading.time = state.tick * dt
    reading.force = measured
    reading.position = state.blade
    reading.speed = state.speed
    reading.angle = state.angle
    reading.true_force = elastic + friction
    reading.elastic_force = elastic
    reading.tip = state.tip
    reading.jump = jump


@njit
def simulate(
    state: Struct,
    profile: Struct,
    law: Struct,
    drive: Struct,
    sensor: Struct,
    speeds: StructArray,
    angles: StructArray,
    dt: float,
    readings: StructArray,
) -> None:
    """Run one cut through ``len(readings)`` updates of ``dt`` [s].

    ``speeds`` [m/s] and ``angles`` [rad], shape (n_commands,), are spread evenly over the updates: one command may
    last for many of them.
    """
    if len(readings) < len(speeds):
        raise ValueError("fewer readings than commands: every command lasts for at least one update")
    per_command = len(readings) // len(speeds)
    share = lag_gain(drive, dt)
    for i in range(len(readings)):
        k = min(i // per_command, len(speeds) - 1)
        update(state, profile, law, drive, sensor, share, speeds[k], angles[k], dt, readings[i])


@njit
def hold(cuts: StructArray, speed: float, angle: float, dt: float, readings: StructArray) -> None:
    """Run one cut, :data:`CUT` of shape (1,), through ``len(readings)`` updates under one command.

    From Python, an array of length 1 is passed ten times faster than a structured scalar, and one argument faster than
    many.
    """
    c = cuts[0]
    c.state_before = c.state
    c.sensor_before = c.sensor
    share = lag_gain(c.drive, dt)
    for i in range(len(readings)):
        update(c.state, c.profile, c.law, c.drive, c.sensor, share, speed, angle, dt, readings[i])


@njit_inline
def account(state: Struct, profile: Struct, energies: StructArray) -> None:
    """Fill ``energies``, shape (7,) [J], in the order of :data:`ENERGIES`."""
    stored = stored_energy(profile, state.blade - state.creep, state.tip) + state.locked
    energies[0] = state.work
    energies[1] = stored
    energies[2] = state.fracture
    energies[3] = state.friction
    energies[4] = state.loss
    energies[5] = state.ledger
    energies[6] = state.work - stored - state.fracture - state.friction - state.loss - state.ledger


@njit
def account_one(cuts: StructArray, energies: StructArray) -> None:
    """Fill ``energies`` for one cut, shape (1,), by :func:`account`."""
    account(cuts[0].state, cuts[0].profile, energies)


@njit_nogil
def simulate_some(
    passed: WorkQueue,
    core: int,
    states: StructArray,
    profiles: StructArray,
    laws: StructArray,
    drives: StructArray,
    sensors: StructArray,
    speeds: StructArray,
    angles: StructArray,
    dt: float,
    readings: StructArray,
) -> None:
    """Run :func:`simulate` for n cuts on one thread: see :func:`cutenv._engine.parallel.parallel_for`.

    Every argument but ``dt`` has a leading axis of length n.
    """
    n, end = next_chunk(passed, core, 1)
    while n < end:
        simulate(states[n], profiles[n], laws[n], drives[n], sensors[n], speeds[n], angles[n], dt, readings[n])
        mark_done(passed, core, 1)
        n, end = next_chunk(passed, core, 1)
