"""What moves the blade: a rig that holds position, or a hand that feels the tissue through its own compliance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutenv.compiled import compiled
from cutenv.cutting.records import DRIVE, TICK, Record, Records
from cutenv.parameter import check_parameters, parameter


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A motor and lead screw far stiffer than tissue (thesis 3.3.1): position does not yield to force."""

    motor_lag: float = parameter(
        0.040, unit="s", low=0.001, high=1.0, provenance="assumed",
        why="velocity loop of a small geared motor", sweep=(0.010, 0.080),
    )  # fmt: skip
    acceleration: float = parameter(
        0.1, unit="m/s2", low=0.001, high=10.0, provenance="assumed",
        why="full speed in a quarter of a second", sweep=(0.05, 0.5),
    )  # fmt: skip
    rotation_rate: float = parameter(
        math.radians(90.0), unit="rad/s", low=0.01, high=20.0, provenance="assumed",
        why="90 degrees in one second", sweep=(math.radians(45.0), math.radians(180.0)),
    )  # fmt: skip
    dead_time: float = parameter(
        0.0, unit="s", low=0.0, high=0.015, provenance="assumed",
        why="off; bus and drive between a command and the first motion", sweep=(0.0, 0.010),
    )  # fmt: skip
    backlash: float = parameter(
        0.0, unit="m", low=0.0, high=0.005, provenance="assumed",
        why="off; play between the motor, whose encoder tells the position, and the blade", sweep=(0.0, 0.2e-3),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)

    def records(self, travel: float) -> Records:
        """The drive as the compiled law takes it, shape (1,); the blade stays within 0 to ``travel`` [m]."""
        drives = np.zeros(1, DRIVE)
        drives["lag"] = self.motor_lag
        drives["acceleration"] = self.acceleration
        drives["rotation_rate"] = self.rotation_rate
        drives["travel"] = travel
        drives["dead_ticks"] = round(self.dead_time / TICK)
        drives["backlash"] = self.backlash
        return drives


@dataclass(frozen=True, kw_only=True)
class Hand:
    """A person: hand and blade joined by a spring and a damper, so that a sudden drop of force makes it lurch."""

    motor_lag: float = parameter(
        0.080, unit="s", low=0.001, high=1.0, provenance="assumed",
        why="a person follows an intended speed more slowly than a motor", sweep=(0.04, 0.15),
    )  # fmt: skip
    acceleration: float = parameter(
        0.5, unit="m/s2", low=0.001, high=10.0, provenance="assumed",
        why="slow deliberate movement of the hand", sweep=(0.2, 2.0),
    )  # fmt: skip
    rotation_rate: float = parameter(
        math.radians(90.0), unit="rad/s", low=0.01, high=20.0, provenance="assumed",
        why="90 degrees in one second", sweep=(math.radians(45.0), math.radians(180.0)),
    )  # fmt: skip
    mass: float = parameter(
        0.15, unit="kg", low=0.01, high=5.0, provenance="assumed",
        why="scalpel, fingers and part of the hand", sweep=(0.05, 0.5),
    )  # fmt: skip
    coupling_stiffness: float = parameter(
        400.0, unit="N/m", low=10.0, high=1e5, provenance="assumed",
        why="order of a pinch grip's stiffness", sweep=(100.0, 1500.0),
    )  # fmt: skip
    coupling_damping: float = parameter(
        6.0, unit="N s/m", low=0.0, high=1e3, provenance="assumed",
        why="order of a pinch grip's damping", sweep=(2.0, 20.0),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.coupling_stiffness * TICK**2 > self.mass:
            raise ValueError(
                f"coupling_stiffness = {self.coupling_stiffness:g} N/m on mass = {self.mass:g} kg swings too fast for "
                f"updates of {TICK:g} s: take a stiffness below {self.mass / TICK**2:g} N/m, or more mass."
            )

    def records(self, travel: float) -> Records:
        """The drive as the compiled law takes it, shape (1,); the blade stays within 0 to ``travel`` [m]."""
        drives = Rig(
            motor_lag=self.motor_lag, acceleration=self.acceleration, rotation_rate=self.rotation_rate
        ).records(travel)
        drives["mass"] = self.mass
        drives["coupling_stiffness"] = self.coupling_stiffness
        drives["coupling_damping"] = self.coupling_damping
        return drives


_AT_REST = 1e-5  # [m/s], below the step of an encoder: 10 nm in a millisecond


@compiled
def next_angle(state: Record, drive: Record, target: float, dt: float) -> float:
    """The blade's angle after ``dt``, turning toward ``target`` at the drive's rate [rad]."""
    turn = drive.rotation_rate * dt
    return state.angle + min(max(target - state.angle, -turn), turn)  # type: ignore[no-any-return]


@compiled
def made_up(drive: Record, dt: float) -> float:
    """The share of what is missing to the commanded speed that the velocity loop makes up in ``dt`` [1]."""
    return 1.0 - math.exp(-dt / drive.lag)


@compiled
def delayed(state: Record, drive: Record, target: float) -> float:
    """The commanded speed [m/s] that has reached the drive; commands have to last longer than the dead time."""
    if drive.dead_ticks == 0:
        return target
    if target != state.next_target:
        state.next_target = target
        state.waiting = drive.dead_ticks
    if state.waiting > 0:
        state.waiting -= 1
    else:
        state.target = target
    return state.target  # type: ignore[no-any-return]


@compiled
def advance_command(state: Record, drive: Record, share: float, target: float, dt: float) -> None:
    """Follow a commanded speed [m/s] through the velocity loop, ``share`` of :func:`made_up`, and its limit."""
    change = (target - state.hand_speed) * share
    limit = drive.acceleration * dt
    speed = state.hand_speed + min(max(change, -limit), limit)
    if target == 0.0 and abs(speed) < _AT_REST:
        speed = 0.0  # a lag alone would creep for ever, and friction with it
    end = state.hand + 0.5 * (state.hand_speed + speed) * dt
    if end < 0.0 or end > drive.travel:  # the end stop
        end = min(max(end, 0.0), drive.travel)
        speed = 0.0
    state.hand = end
    state.hand_speed = speed


@compiled
def motion(
    state: Record, drive: Record, share: float, target: float, elastic: float, friction: float, dt: float
) -> float:
    """Displacement of the blade [m] in ``dt`` under a commanded speed; sets ``state.speed`` to its speed.

    The rig's blade goes where the carriage goes.  The hand's blade is a mass on a spring and a damper that the tissue's
    ``elastic`` force pulls back and ``friction`` (its size) slows, but never reverses; semi-implicit Euler.  With
    backlash the guides' friction holds the rig's blade until the carriage's nut pushes it: forward from behind, and
    back once the play is used up.
    """
    advance_command(state, drive, share, delayed(state, drive, target), dt)
    if drive.mass <= 0.0:
        dx = state.hand - state.blade
        if dx < 0.0 and drive.backlash > 0.0:
            dx = min(dx + drive.backlash, 0.0)
        state.speed = dx / dt
        return dx  # type: ignore[no-any-return]
    coupling = drive.coupling_stiffness * (state.hand - state.blade) + drive.coupling_damping * state.hand_speed
    speed = (state.speed + (coupling - elastic) * dt / drive.mass) / (1.0 + drive.coupling_damping * dt / drive.mass)
    speed = math.copysign(max(abs(speed) - friction * dt / drive.mass, 0.0), speed)
    end = min(max(state.blade + speed * dt, 0.0), drive.travel)
    dx = end - state.blade
    state.speed = dx / dt
    return dx  # type: ignore[no-any-return]
