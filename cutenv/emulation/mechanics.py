"""Mechanics of the emulated rig.

Motor, gear, screw and carriage under a drive's control, and the tissue.

All quantities are referred to the carriage: metres and newtons for the blade, radians and newton metres for the hinge.
A motor of inertia J at gear ratio i and lead h adds a mass of J (2 pi i / h)^2 there, far more than the carriage
itself, which is why tissue hardly slows a screw. A stiff spring with play joins the motor's side, where the encoder is,
to the carriage.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv._engine.elementary import exp
from cutenv._engine.jit import njit, njit_internal
from cutenv.emulation.tissue_in_plane import TissueInPlane, measured, within
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import Axis, PositionControl
from cutenv.rig.errors import RigError
from cutenv.sim.cutting.descent import HIGHEST, LOWEST
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import Sensor, SensorParameters
from cutenv.sim.plant import DescendingPlant, SimulatedPlant
from cutenv.sim.tissue.specimen import Specimen

SUBSTEP = 5e-5  # time step of the equations of motion [s]
_SUBSTEPS = 20  # a millisecond
_DELAYS = 128  # commands under way at most, one a millisecond
BLOCKED, BLOCKED_ONWARD = 1, 2  # faults of the motor: it cannot move; it cannot move toward greater positions
# modes of the drive: no torque; follow the target speed; bring the demanded speed to zero by the ramp alone
MODE_OFF, MODE_VELOCITY, MODE_RAMP = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class Mechanics:
    """Motor, gear and load.

    The defaults are those of the blade's carriage, :func:`hinge` gives the other's.
    """

    lag: float = parameter(
        0.040,
        unit="s",
        low=0.0,
        high=1.0,
        provenance="assumed",
        source="as the simulated rig's: time constant of a target",
    )
    dead_time: float = parameter(
        0.0, unit="s", low=0.0, high=0.1, provenance="choice", source="between a target and the first motion"
    )
    backlash: float = parameter(
        20e-6, unit="m or rad", low=0.0, high=0.01, provenance="assumed", source="of a preloaded screw"
    )
    friction: float = parameter(
        20.0, unit="N or N m", low=0.0, high=1000.0, provenance="assumed", source="Coulomb's, of motor, gear and screw"
    )
    viscosity: float = parameter(
        300.0, unit="N s/m or N m s/rad", low=0.0, high=1e5, provenance="assumed", source="of motor, gear and screw"
    )
    rotor_inertia: float = parameter(
        1e-6, unit="kg m2", low=1e-9, high=1e-3, provenance="assumed", source="of a motor of 22 mm with its gear"
    )
    torque_constant: float = parameter(
        0.02, unit="N m/A", low=1e-4, high=1.0, provenance="assumed", source="of such a motor"
    )
    mass: float = parameter(
        1.5, unit="kg or kg m2", low=1e-6, high=100.0, provenance="assumed", source="carriage, sensor and blade"
    )
    carriage_friction: float = parameter(
        2.0, unit="N or N m", low=0.0, high=100.0, provenance="assumed", source="Coulomb's, of the guide"
    )
    stiffness: float = parameter(
        1.5e6, unit="N/m or N m/rad", low=1.0, high=1e8, provenance="assumed", source="of screw and nut"
    )
    loop: float = parameter(
        0.0025,
        unit="s",
        low=0.001,
        high=0.02,
        provenance="assumed",
        source="time constant of the drive's velocity loop",
    )
    proportional_gain: float = parameter(
        0.0, unit="N/m or N m/rad", low=0.0, high=1e8, provenance="choice",
        source="off: a velocity loop; otherwise PD control of position, which needs no lag and has none",
    )  # fmt: skip
    derivative_gain: float = parameter(
        0.0, unit="N s/m or N m s/rad", low=0.0, high=1e7, provenance="choice", source="of PD control"
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.derivative_gain > 0.0 and self.proportional_gain == 0.0:
            raise ValueError(
                f"derivative_gain = {self.derivative_gain:g} is of PD control, and proportional_gain is 0: give both."
            )
        if self.dead_time > (_DELAYS - 1) * 1e-3:
            raise ValueError(f"dead_time = {self.dead_time:g} s is above {1e-3 * (_DELAYS - 1):g} s: take less.")
        if self.stiffness * SUBSTEP**2 > 0.1 * self.mass:
            raise ValueError(
                f"stiffness = {self.stiffness:g} on mass = {self.mass:g} swings too fast for steps of {SUBSTEP:g} s:"
                f" take a stiffness below {0.1 * self.mass / SUBSTEP**2:g}, or more mass."
            )


def hinge(*, lag: float = 0.040, dead_time: float = 0.0, backlash: float = 0.0005, friction: float = 0.05) -> Mechanics:
    """Return the mechanics of the blade's hinge, in radians."""
    return Mechanics(
        lag=lag, dead_time=dead_time, backlash=backlash, friction=friction, viscosity=0.005, rotor_inertia=1e-6,
        torque_constant=0.02, mass=2e-4, carriage_friction=0.005, stiffness=200.0, loop=0.0025,
    )  # fmt: skip


def position_control(mechanics: Mechanics, axis: Axis) -> PositionControl | None:
    """Return an emulated axis's PD control, None for velocity loops."""
    if mechanics.proportional_gain == 0.0:
        return None
    return PositionControl(
        proportional_gain=mechanics.proportional_gain,
        derivative_gain=mechanics.derivative_gain,
        moved_mass=float(f"{moved_mass(mechanics, axis) + mechanics.mass:.6g}"),
        drag=mechanics.viscosity,
    )


def moved_mass(mechanics: Mechanics, axis: Axis) -> float:
    """Return the motor's inertia at the carriage [kg or kg m2]."""
    return mechanics.rotor_inertia * (2 * math.pi * axis.gear / axis.lead) ** 2


MOTOR: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            # demands of the drive
            ("mode", "i8"),
            ("target", "f8"),  # speed
            ("acceleration", "f8"),
            ("deceleration", "f8"),
            ("ramp", "f8"),  # deceleration of a stop
            ("fastest", "f8"),  # greatest demanded speed
            ("strongest", "f8"),  # greatest force of the motor
            # state
            ("demand_position", "f8"),
            ("demand", "f8"),  # speed after lag and ramp
            ("position", "f8"),  # on the motor's side
            ("speed", "f8"),
            ("integral", "f8"),  # of the velocity loop, as a force
            ("force", "f8"),  # of the motor
            ("carriage", "f8"),
            ("carriage_speed", "f8"),
            ("slipped", "f8"),  # lag of the carriage due to slip
            ("tick", "i8"),
            ("line", "f8", (_DELAYS,)),  # targets under way
            # faults
            ("blocked", "i8"),
            ("slip", "f8"),  # share of the motor's motion that does not reach the carriage
            ("runaway", "f8"),  # speed instead of the target's, unless nan
            # parameters
            ("lag", "f8"),
            ("delay", "i8"),  # [ms]
            ("backlash", "f8"),
            ("friction", "f8"),
            ("viscosity", "f8"),
            ("inertia", "f8"),  # of the motor's side, referred to the carriage
            ("mass", "f8"),
            ("carriage_friction", "f8"),
            ("stiffness", "f8"),
            ("loop", "f8"),
            ("proportional_gain", "f8"),  # of PD control of position; 0: the velocity loop
            ("derivative_gain", "f8"),
            ("low", "f8"),  # mechanical ends of the carriage's travel
            ("high", "f8"),
        ],
    )
)
"""Layout of one axis's state and parameters."""


def motor_record(axis: Axis, mechanics: Mechanics, *, position: float, margin: float) -> StructArray:
    """Return one resting axis, shape (1,), with mechanical ends ``margin`` beyond travel."""
    motors = np.zeros(1, MOTOR)
    for name in (
        "lag", "backlash", "friction", "viscosity", "mass", "carriage_friction", "stiffness", "loop",
        "proportional_gain", "derivative_gain",
    ):  # fmt: skip
        motors[name] = getattr(mechanics, name)
    if mechanics.proportional_gain > 0.0:
        motors["lag"] = 0.0
    motors["delay"] = round(1e3 * mechanics.dead_time)
    motors["inertia"] = moved_mass(mechanics, axis)
    motors["low"], motors["high"] = axis.low - margin, axis.high + margin
    motors["position"] = motors["carriage"] = motors["demand_position"] = position
    motors["runaway"] = np.nan
    return motors


def force_per_ampere(axis: Axis, mechanics: Mechanics) -> float:
    """Return the motor's force at the carriage [N/A or N m/A]."""
    return mechanics.torque_constant * 2 * math.pi * axis.gear / axis.lead


_AT_REST = 1e-5  # [m/s or rad/s] below which a demanded speed becomes zero, as in the simulator's drive


@njit_internal
def govern(motor: Struct, target: float, dt: float) -> None:
    """Advance the demanded speed, by lag, acceleration limits or stop ramp."""
    before = motor.demand
    if motor.mode == MODE_RAMP:
        rate = motor.ramp
        demand = math.copysign(max(abs(before) - rate * dt, 0.0), before)
    else:
        wanted = min(max(target, -motor.fastest), motor.fastest)
        change = wanted - before
        if motor.lag > 0.0:
            change *= 1.0 - exp(-dt / motor.lag)
        limit = motor.acceleration * dt
        if before * change < 0.0:
            limit = motor.deceleration * dt
        demand = before + min(max(change, -limit), limit)
        if wanted == 0.0 and abs(demand) < _AT_REST:
            demand = 0.0
    motor.demand_position += 0.5 * (before + demand) * dt
    motor.demand = demand


@njit_internal
def rubbed(speed: float, force: float, friction: float, inertia: float, dt: float) -> float:
    """Return the speed after ``dt`` under ``force`` and never-reversing Coulomb friction."""
    free = speed + force * dt / inertia
    return math.copysign(max(abs(free) - friction * dt / inertia, 0.0), free)


@njit
def turn_motor(motors: StructArray, load: float) -> None:
    """Advance one axis, shape (1,), a millisecond under ``load``, negative toward the clamp."""
    motor = motors[0]
    dt = SUBSTEP
    motor.line[motor.tick % _DELAYS] = motor.target
    target = motor.line[(motor.tick - motor.delay) % _DELAYS]
    if not math.isnan(motor.runaway):
        target = motor.runaway
    motor.tick += 1
    gain = (motor.inertia + motor.mass) / motor.loop
    gain_integral = gain / (4.0 * motor.loop)
    damping = 0.4 * math.sqrt(motor.stiffness * motor.mass)
    for _ in range(_SUBSTEPS):
        if motor.mode == MODE_OFF:
            motor.demand = 0.0
            motor.demand_position = motor.position
            motor.integral = 0.0
            motor.force = 0.0
        else:
            govern(motor, target, dt)
            error = motor.demand - motor.speed
            wanted = gain * error + motor.integral
            if motor.proportional_gain > 0.0:
                motor.integral = 0.0
                behind = motor.demand_position - motor.position
                wanted = motor.proportional_gain * behind + motor.derivative_gain * error
            motor.force = min(max(wanted, -motor.strongest), motor.strongest)
            if motor.force == wanted or error * wanted < 0.0:  # anti-windup
                motor.integral += gain_integral * error * dt
        apart = motor.position - motor.slipped - motor.carriage
        stretch = math.copysign(max(abs(apart) - 0.5 * motor.backlash, 0.0), apart)
        spring = 0.0
        if stretch != 0.0:
            spring = motor.stiffness * stretch + damping * ((1.0 - motor.slip) * motor.speed - motor.carriage_speed)
        if motor.blocked == BLOCKED:
            motor.speed = 0.0
        else:
            push = motor.force - spring - motor.viscosity * motor.speed
            motor.speed = rubbed(motor.speed, push, motor.friction, motor.inertia, dt)
            if motor.blocked == BLOCKED_ONWARD:
                motor.speed = min(motor.speed, 0.0)
        motor.position += motor.speed * dt
        motor.slipped += motor.slip * motor.speed * dt
        motor.carriage_speed = rubbed(motor.carriage_speed, spring + load, motor.carriage_friction, motor.mass, dt)
        motor.carriage += motor.carriage_speed * dt
        if motor.carriage < motor.low or motor.carriage > motor.high:  # a mechanical end stops the motor as well
            motor.carriage = min(max(motor.carriage, motor.low), motor.high)
            motor.carriage_speed = 0.0
            motor.speed = 0.0
            motor.position = motor.carriage + motor.slipped


CLAMP_TOLERANCE = 0.002  # greatest distance of the blade from the clamp at which a specimen can be mounted [m]
# distance from the blade's lower end up to the sensor, of an emulated or fake rig with an axis across the cut [m]
ARM = 0.1


class EmulatedTissue:
    """Specimen, blade and force sensor, a millisecond at a time.

    A specimen along a line feels the blade in the plane, another one in height, where the rig has the axis. ``axes``:
    axes across the cut, "height" and "side". ``forces``: force of the tissue on the blade, upwards, and to the right,
    in the last one [N], with what a fault adds.
    """

    def __init__(
        self, sensor: SensorParameters | None = None, law: LawParameters | None = None, axes: Iterable[str] = ()
    ) -> None:
        self._sensor, self._law = sensor or SensorParameters(), law
        # height of the blade's lower end, and place to the left, in the next millisecond [m], by axis
        self.places = dict.fromkeys(axes, 0.0)
        self.forces, self._added = dict(self.places), dict(self.places)
        self._extra = self._force = 0.0
        self._felt = Sensor(self._sensor)
        self.take_away()

    def take_away(self) -> None:
        """Remove the specimen: the blade is in free air, without force."""
        self.mounted: MountedSpecimen | None = None
        self._plant: SimulatedPlant | None = None
        self._plane: TissueInPlane | None = None

    def mount(self, specimen: Specimen, mounted: MountedSpecimen, *, position: float, angle: float) -> None:
        """Clamp a fresh specimen, its crack at the blade.

        The blade must be at the clamp, at height 0, in the middle. ``mounted``: key of the specimen; seed and episode
        select the sensor's noise, as in the simulator; ``position``, ``angle``: position [m] and angle [rad] of the
        blade; :attr:`places` are those of the other axes. Raise RigError if the blade is somewhere else.
        """
        for name, place in self.places.items():
            if abs(place) > CLAMP_TOLERANCE:
                raise RigError(
                    f"the {name} axis stands at {1e3 * place:.1f} mm: move it to 0 (within {1e3 * CLAMP_TOLERANCE:g} "
                    "mm) before a specimen is laid."
                )
        if abs(position) > CLAMP_TOLERANCE:
            raise RigError(
                f"the blade stands at {1e3 * position:.1f} mm: drive it to the clamp (within "
                f"{1e3 * CLAMP_TOLERANCE:g} mm) "
                "before a specimen is laid."
            )
        self.take_away()
        self.mounted = mounted
        self._felt = Sensor(self._sensor, seed=mounted.seed, episode=mounted.episode)
        if mounted.line is not None:
            self._plane = TissueInPlane(specimen, mounted.line, law=self._law, angle=angle)
        elif "height" in self.places:
            self._plant = DescendingPlant(specimen, layers=mounted.layers, law=self._law, angle=measured(angle))
        else:
            self._plant = SimulatedPlant(specimen, law=self._law, angle=measured(angle))
        if self._plant is not None:
            self._plant.states["blade"] = self._plant.states["tip"] = within(position)

    def add_force(self, force: float) -> None:
        """Add ``force`` [N] along the cut; 0 removes it."""
        self._extra = force

    def add_across(self, axis: str, force: float) -> None:
        """Add ``force`` [N] upwards or to the right; 0 removes it.

        Raise ValueError if the rig has no such axis: there is no force along it.
        """
        if axis not in self._added:
            raise ValueError(f"this rig has no {axis} axis. Start the emulator with --{axis}.")
        self._added[axis] = force

    def advance(self, position: float, angle: float) -> float:
        """Move the blade to ``position`` [m], ``angle`` [rad] and :attr:`places`.

        Return the reading along the cut [N].

        It takes a millisecond. Outside the specimen, and of what a law describes, the blade is held at its border.
        """
        self.forces, self._force = dict(self._added), self._extra
        if self._plane is not None:
            self._plane.advance(position, self.places["side"], angle)
            self._force += self._plane.force
            self.forces["side"] += self._plane.side_force
        elif (plant := self._plant) is not None:
            level = min(max(self.places.get("height", 0.0), LOWEST), HIGHEST)
            self._force += float(plant.lead(within(position), measured(angle), level)["true_force"][0])
            if isinstance(plant, DescendingPlant):
                self.forces["height"] += float(plant.vertical_force[0])
        return self._felt.measure(self._force)

    @property
    def true_force(self) -> float:
        """Tissue's force on the blade, toward the clamp [N]."""
        return self._force

    @property
    def tip(self) -> float:
        """Position of the crack tip, along any line [m]."""
        if self._plane is not None:
            return self._plane.tip
        return math.nan if self._plant is None else float(self._plant.states["tip"][0])
