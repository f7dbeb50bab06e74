"""Drive, law and sensor, one after the other, a millisecond at a time: for one cut and for thousands in parallel."""

from __future__ import annotations

import numba

from cutenv.compiled import compiled, compiled_parallel
from cutenv.cutting.drive import motion, next_angle
from cutenv.cutting.law import cut, elastic_force, friction_force, initiation_excess, stored_energy
from cutenv.cutting.records import Record, Records
from cutenv.cutting.sensor import measure
from cutenv.tissue.specimen import SPACING

ENERGIES = ("work", "stored", "fracture", "friction", "loss", "ledger", "residual")
"""The energy account; residual is work minus all the others."""


@compiled
def update(
    state: Record,
    profile: Records,
    law: Record,
    drive: Record,
    sensor: Record,
    speed: float,
    angle: float,
    dt: float,
    reading: Record,
) -> None:
    """One force update under a commanded speed [m/s] and angle [rad]; fills ``reading``."""
    elastic = elastic_force(profile, state.blade, state.tip)
    dx = motion(state, drive, speed, elastic, friction_force(state, profile, law, state.speed), dt)
    elastic, friction, jump = cut(state, profile, law, dx, next_angle(state, drive, angle, dt), dt)
    state.tick += 1
    measured = measure(sensor, elastic + friction, state.tick - 1)
    _note(state, reading, measured, elastic, friction, jump, dt)


@compiled
def follow(
    state: Record, profile: Records, law: Record, positions: Records, angles: Records, dt: float, readings: Records
) -> None:
    """Lead the blade exactly through ``positions`` [m] and ``angles`` [rad], shape (n,), one every ``dt`` [s].

    No drive, no sensor: the reading is the true force.  For derivations and for checks of the law itself.
    """
    end = (len(profile) - 1) * SPACING
    for i in range(len(positions)):
        if not 0.0 <= positions[i] <= end:
            raise ValueError("positions leave the specimen: give metres from the clamp, 0 to 0.15")
        dx = positions[i] - state.blade
        elastic, friction, jump = cut(state, profile, law, dx, angles[i], dt)
        state.speed = dx / dt
        state.tick += 1
        _note(state, readings[i], elastic + friction, elastic, friction, jump, dt)


@compiled
def _note(
    state: Record, reading: Record, measured: float, elastic: float, friction: float, jump: float, dt: float
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


@compiled
def simulate(
    state: Record,
    profile: Records,
    law: Record,
    drive: Record,
    sensor: Record,
    speeds: Records,
    angles: Records,
    dt: float,
    readings: Records,
) -> None:
    """Run one cut through ``len(readings)`` updates of ``dt`` [s].

    ``speeds`` [m/s] and ``angles`` [rad], shape (n_commands,), are spread evenly over the updates: one command may
    last for many of them.
    """
    if len(readings) < len(speeds):
        raise ValueError("fewer readings than commands: every command lasts for at least one update")
    per_command = len(readings) // len(speeds)
    for i in range(len(readings)):
        k = min(i // per_command, len(speeds) - 1)
        update(state, profile, law, drive, sensor, speeds[k], angles[k], dt, readings[i])


@compiled
def hold(
    states: Records,
    profile: Records,
    laws: Records,
    drives: Records,
    sensors: Records,
    speed: float,
    angle: float,
    dt: float,
    readings: Records,
) -> None:
    """Run one cut through ``len(readings)`` updates under one command.

    The records come in arrays of length 1, which a call from Python passes several times faster than records.
    """
    for i in range(len(readings)):
        update(states[0], profile, laws[0], drives[0], sensors[0], speed, angle, dt, readings[i])


@compiled
def account(states: Records, profile: Records, laws: Records, energies: Records, hidden: Records) -> None:
    """Fill ``energies``, shape (7,) [J], in the order of :data:`ENERGIES`, and ``hidden``, shape (4,).

    ``hidden`` holds crack tip [m], blade [m], unstable growth so far [m] and the initiation excess eta [1].
    """
    state = states[0]
    stored = stored_energy(profile, state.blade, state.tip)
    energies[0] = state.work
    energies[1] = stored
    energies[2] = state.fracture
    energies[3] = state.friction
    energies[4] = state.loss
    energies[5] = state.ledger
    energies[6] = state.work - stored - state.fracture - state.friction - state.loss - state.ledger
    hidden[0] = state.tip
    hidden[1] = state.blade
    hidden[2] = state.uncontrolled
    hidden[3] = initiation_excess(laws[0], state.angle)


@compiled_parallel
def simulate_batch(
    states: Records,
    profiles: Records,
    laws: Records,
    drives: Records,
    sensors: Records,
    speeds: Records,
    angles: Records,
    dt: float,
    readings: Records,
) -> None:
    """:func:`simulate` for n cuts on all cores: every argument but ``dt`` has a leading axis of length n."""
    for n in numba.prange(len(states)):
        simulate(states[n], profiles[n], laws[n], drives[n], sensors[n], speeds[n], angles[n], dt, readings[n])
