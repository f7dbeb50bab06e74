"""Drives of the blade.

A rig's velocity loop, a rig's PD position control, or a hand that holds it softly.

PD control is a spring and a damper between the wanted and the actual position, and so is a hand's grip: one law, with a
motor's numbers or a person's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv._engine.elementary import exp
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.sim.cutting.dtypes import DRIVE, TICK
from cutenv.sim.cutting.friction import Grip


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Motor and lead screw, whose position does not yield to force (thesis 3.3.1)."""

    motor_lag: float = parameter(
        0.040, unit="s", low=0.001, high=1.0, provenance="assumed",
        source="velocity loop of a small geared motor", sensitivity=(0.010, 0.080),
    )  # fmt: skip
    acceleration: float = parameter(
        0.1, unit="m/s2", low=0.001, high=10.0, provenance="assumed",
        source="full speed in a quarter of a second", sensitivity=(0.05, 0.5),
    )  # fmt: skip
    rotation_rate: float = parameter(
        math.radians(90.0), unit="rad/s", low=0.01, high=20.0, provenance="assumed",
        source="90 degrees in one second", sensitivity=(math.radians(45.0), math.radians(180.0)),
    )  # fmt: skip
    dead_time: float = parameter(
        0.0, unit="s", low=0.0, high=0.015, provenance="assumed",
        source="off; bus and drive between a command and the first motion", sensitivity=(0.0, 0.010),
    )  # fmt: skip
    backlash: float = parameter(
        0.0, unit="m", low=0.0, high=0.005, provenance="assumed",
        source="off; play between the motor, whose encoder tells the position, and the blade",
        sensitivity=(0.0, 0.2e-3),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)

    def records(self, travel: float) -> StructArray:
        """Return the drive as :data:`DRIVE`, shape (1,), limited to ``travel`` [m]."""
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
    """Person's hand that leads the blade by spring and damper, and lurches."""

    motor_lag: float = parameter(
        0.080, unit="s", low=0.001, high=1.0, provenance="assumed",
        source="a person follows an intended speed more slowly than a motor", sensitivity=(0.04, 0.15),
    )  # fmt: skip
    acceleration: float = parameter(
        0.5, unit="m/s2", low=0.001, high=10.0, provenance="assumed",
        source="slow deliberate movement of the hand", sensitivity=(0.2, 2.0),
    )  # fmt: skip
    rotation_rate: float = parameter(
        math.radians(90.0), unit="rad/s", low=0.01, high=20.0, provenance="assumed",
        source="90 degrees in one second", sensitivity=(math.radians(45.0), math.radians(180.0)),
    )  # fmt: skip
    mass: float = parameter(
        0.15, unit="kg", low=0.01, high=5.0, provenance="assumed",
        source="scalpel, fingers and part of the hand", sensitivity=(0.05, 0.5),
    )  # fmt: skip
    coupling_stiffness: float = parameter(
        400.0, unit="N/m", low=10.0, high=1e5, provenance="assumed",
        source="order of a pinch grip's stiffness", sensitivity=(100.0, 1500.0),
    )  # fmt: skip
    coupling_damping: float = parameter(
        6.0, unit="N s/m", low=0.0, high=1e3, provenance="assumed",
        source="order of a pinch grip's damping", sensitivity=(2.0, 20.0),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.coupling_stiffness * TICK**2 > self.mass:
            raise ValueError(
                f"coupling_stiffness = {self.coupling_stiffness:g} N/m on mass = {self.mass:g} kg swings too fast for "
                f"updates of {TICK:g} s. Give a stiffness below {self.mass / TICK**2:g} N/m, or a larger mass."
            )

    def records(self, travel: float) -> StructArray:
        """Return the drive as :data:`DRIVE`, shape (1,), limited to ``travel`` [m]."""
        drives = Rig(
            motor_lag=self.motor_lag, acceleration=self.acceleration, rotation_rate=self.rotation_rate
        ).records(travel)
        drives["mass"] = self.mass
        drives["coupling_stiffness"] = self.coupling_stiffness
        drives["coupling_damping"] = self.coupling_damping
        return drives


@dataclass(frozen=True, kw_only=True)
class PDRig:
    """A motor under PD position control (thesis 3.1).

    Position error and its derivative command the motor's force.

    The wanted position is that of a carriage which reaches the commanded speed at constant ``acceleration``.  All
    quantities are referred to the carriage.  Under the tissue's force F the blade yields by F / ``proportional_gain``,
    and at a constant speed v it follows ``drag`` v / ``proportional_gain`` behind.  The thesis gives no gains.  Coulomb
    friction of motor and guides, at most some hundredths of a millimetre of position, is left out: the emulated rig
    has it.
    """

    proportional_gain: float = parameter(
        750e3, unit="N/m", low=100.0, high=1e8, provenance="assumed",
        source="a bandwidth of 10 Hz with the mass below; the thesis gives no gains", sensitivity=(75e3, 3e6),
    )  # fmt: skip
    derivative_gain: float = parameter(
        24e3, unit="N s/m", low=1.0, high=1e7, provenance="assumed",
        source="critical damping of both; the thesis gives no gains", sensitivity=(6e3, 48e3),
    )  # fmt: skip
    moved_mass: float = parameter(
        190.0, unit="kg", low=0.1, high=1e5, provenance="assumed",
        source="a rotor of 1e-6 kg m2 with a gear of 4.4 on a screw of 2 mm, at the carriage: the emulated rig's",
        sensitivity=(40.0, 1000.0),
    )  # fmt: skip
    drag: float = parameter(
        300.0, unit="N s/m", low=0.0, high=1e6, provenance="assumed",
        source="viscous friction of motor, gear and screw: the emulated rig's", sensitivity=(0.0, 3000.0),
    )  # fmt: skip
    acceleration: float = parameter(
        0.1, unit="m/s2", low=0.001, high=10.0, provenance="assumed",
        source="of the wanted motion: full speed in a quarter of a second", sensitivity=(0.05, 0.5),
    )  # fmt: skip
    rotation_rate: float = parameter(
        math.radians(90.0), unit="rad/s", low=0.01, high=20.0, provenance="assumed",
        source="90 degrees in one second", sensitivity=(math.radians(45.0), math.radians(180.0)),
    )  # fmt: skip
    dead_time: float = parameter(
        0.0, unit="s", low=0.0, high=0.015, provenance="assumed",
        source="off; bus and drive between a command and the first motion", sensitivity=(0.0, 0.010),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        stiffest = 0.1 * self.moved_mass / TICK**2
        if self.proportional_gain > stiffest:
            raise ValueError(
                f"proportional_gain = {self.proportional_gain:g} N/m on moved_mass = {self.moved_mass:g} kg swings too"
                f" fast for updates of {TICK:g} s. Give a gain below {stiffest:g} N/m, or a larger mass."
            )

    def records(self, travel: float) -> StructArray:
        """Return the drive as :data:`DRIVE`, shape (1,), limited to ``travel`` [m]."""
        drives = Rig(
            acceleration=self.acceleration, rotation_rate=self.rotation_rate, dead_time=self.dead_time
        ).records(travel)
        drives["lag"] = _NO_LAG
        drives["mass"] = self.moved_mass
        drives["coupling_stiffness"] = self.proportional_gain
        drives["coupling_damping"] = self.derivative_gain
        drives["drag"] = self.drag
        return drives


Drive = Rig | PDRig | Hand
DRIVES: Mapping[str, type[Rig] | type[PDRig] | type[Hand]] = MappingProxyType({"rig": Rig, "pd": PDRig, "hand": Hand})
"""Drives by the names that an environment's keyword ``drive`` takes."""

_NO_LAG = 1e-5  # [s], far below an update: the wanted speed is the commanded one, within its acceleration
_AT_REST = 1e-5  # [m/s], below the resolution of an encoder: 10 nm in a millisecond


@njit_inline
def rate_limited(angle: float, target: float, rotation_rate: float, dt: float) -> float:
    """Return the rate-limited angle of the blade [rad] after ``dt``."""
    turn = rotation_rate * dt
    return angle + min(max(target - angle, -turn), turn)


@njit
def lag_gain(drive: Struct, dt: float) -> float:
    """Return the velocity loop's gain over ``dt``, 1 - exp(-dt / lag)."""
    return 1.0 - exp(-dt / drive.lag)


@njit_inline
def dead_time_step(
    command: float, dead_ticks: int, next_target: float, waiting: int, target: float
) -> tuple[float, int, float]:
    """Advance a dead time, shorter than a command, by one tick.

    Return (pending command, ticks left, active command), speeds in [m/s].
    """
    if command != next_target:
        next_target = command
        waiting = dead_ticks
    if waiting > 0:
        return next_target, waiting - 1, target
    return next_target, waiting, command


@njit
def delayed_command(state: Struct, drive: Struct, target: float) -> float:
    """Return the commanded speed [m/s], delayed by the dead time."""
    if drive.dead_ticks == 0:
        return target
    state.next_target, state.waiting, state.target = dead_time_step(
        target, drive.dead_ticks, state.next_target, state.waiting, state.target
    )
    return state.target  # type: ignore[no-any-return]


class VelocityLoop(NamedTuple):
    """First-order lag with an acceleration limit and end stops."""

    gain: float  # gain in an update, lag_gain
    acceleration: float  # limit [m/s2]
    travel: float  # the carriage stays within 0 to this [m]


@njit_inline
def velocity_loop_step(loop: VelocityLoop, hand: float, speed: float, target: float, dt: float) -> tuple[float, float]:
    """Return the carriage's position [m] and speed [m/s] after ``dt``."""
    limit = loop.acceleration * dt
    next_speed = speed + min(max((target - speed) * loop.gain, -limit), limit)
    if target == 0.0 and abs(next_speed) < _AT_REST:
        next_speed = 0.0  # a lag alone would creep for ever, and friction with it
    end = hand + 0.5 * (speed + next_speed) * dt
    if end < 0.0 or end > loop.travel:  # the end stop
        return min(max(end, 0.0), loop.travel), 0.0
    return end, next_speed


@njit
def advance_command(state: Struct, drive: Struct, share: float, target: float, dt: float) -> None:
    """Advance a state's carriage, or hand, by :func:`velocity_loop_step`."""
    loop = VelocityLoop(share, drive.acceleration, drive.travel)
    state.hand, state.hand_speed = velocity_loop_step(loop, state.hand, state.hand_speed, target, dt)


@njit_inline
def backlash_motion(hand: float, blade: float, backlash: float) -> float:
    """Return the displacement [m] of a blade coupled with backlash.

    With backlash, the guides' friction holds the blade until the carriage's nut pushes it: forward from behind, and
    back once the play is used up.
    """
    dx = hand - blade
    if dx < 0.0 and backlash > 0.0:
        return min(dx + backlash, 0.0)
    return dx


@njit_internal
def coupling_step(drive: Struct, state: Struct, elastic: float, friction: Grip, dt: float) -> float:
    """Return the displacement [m] of a blade on spring and damper.

    They are those of PD control or of a hand's grip.  By semi-implicit Euler.  ``state`` has position and speed of hand
    and blade.  The tissue's ``elastic`` force [N] pulls it back.  Friction sticks like a spring or slips: the solution
    is the sticking speed, clipped to the speeds of slipping forward and backward, however stiff the bristles are.
    """
    coupling = drive.coupling_stiffness * (state.hand - state.blade) + drive.coupling_damping * state.hand_speed
    answer = dt / drive.mass  # change of speed per force [s/kg]
    pushed = state.speed + (coupling - elastic) * answer
    slowed = 1.0 + (drive.coupling_damping + friction.damping + drive.drag) * answer
    sticking = (pushed - friction.held * answer) / (slowed + friction.stiffness * dt * answer)
    slipping_on, slipping_back = (
        (pushed - friction.limit * answer) / slowed,
        (pushed + friction.limit * answer) / slowed,
    )
    speed = min(max(sticking, slipping_on), slipping_back)
    return min(max(state.blade + speed * dt, 0.0), drive.travel) - state.blade  # type: ignore[no-any-return]


_NO_GRIP = Grip(0.0, 0.0, 0.0, 0.0)


@njit
def advance_in_air(state: Struct, drive: Struct, share: float, target: float, dt: float) -> None:
    """Advance the carriage, and a spring-coupled blade, in free air."""
    advance_command(state, drive, share, target, dt)
    if drive.mass > 0.0:
        dx = coupling_step(drive, state, 0.0, _NO_GRIP, dt)
        state.blade += dx
        state.speed = dx / dt
    else:
        state.blade, state.speed = state.hand, state.hand_speed
