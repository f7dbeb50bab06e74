"""Benches of a fake rig: a specimen, a recorded cut, or nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from cutenv.emulation.tissue_in_plane import TissueInPlane
from cutenv.rig.config.identified import drive_of
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import CrossAxis, HeightAxis, RigSettings
from cutenv.rig.safety.monitors import NOMINAL_LAG
from cutenv.sim.cutting.drive import Drive, advance_in_air, delayed_command, lag_gain
from cutenv.sim.cutting.dtypes import READING, STATE, TICK, LawParameters
from cutenv.sim.cutting.sensor import Sensor, SensorParameters
from cutenv.sim.plant import DescendingPlant, ReplayPlant, SimulatedPlant
from cutenv.sim.plant.simulator import ANGLE_RANGE
from cutenv.sim.tissue.lines import straight
from cutenv.sim.trace import Trace

_FELT = [(READING.names or ()).index(name) for name in ("position", "speed", "force")]


class DrivenPlant(Protocol):
    """Load that a fake rig's blade and sensor work on."""

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance a millisecond at a speed [m/s] and turn rate [rad/s]."""
        ...

    def block(self) -> None:
        """Advance by a millisecond in which nothing can move."""
        ...

    @property
    def motion(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and angle [rad]."""
        ...

    @property
    def force(self) -> float:
        """Force as measured by the sensor [N]."""
        ...

    def shift(self, axis: str, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Command the next millisecond of "height" (up) or "side" (left) [m/s]."""
        ...

    def cross_motion(self, axis: str) -> tuple[float, float]:
        """Return the height, or place to the left [m], and speed [m/s]."""
        ...

    def cross_force(self, axis: str) -> float:
        """Return the tissue's force, upwards or to the right [N]."""
        ...


class CrossDrive:
    """Height or side axis of a blade in air.

    ``place``, ``speed``: place of the blade [m] and its speed [m/s], upwards or to the left.
    """

    def __init__(self, axis: CrossAxis) -> None:
        self.place = self.speed = 0.0
        self._acceleration, self._quick_stop = axis.acceleration, axis.quick_stop
        self._gain = -math.expm1(-TICK / NOMINAL_LAG)

    def step(self, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Advance a millisecond at a speed [m/s]; quick stops brake at their own rate."""
        if blocked:
            self.speed = 0.0
            return
        reach = (self._quick_stop if stopping else self._acceleration) * TICK
        change = -self.speed if stopping else (speed - self.speed) * self._gain
        before = self.speed
        self.speed += min(max(change, -reach), reach)
        if speed == 0.0 and abs(self.speed) < 1e-5:
            self.speed = 0.0
        self.place += 0.5 * (before + self.speed) * TICK


class FreeAcross:
    """Part of a bench where the blade moves freely across."""

    _across: Mapping[str, CrossDrive] = MappingProxyType({})

    def shift(self, axis: str, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Move by a millisecond, in air."""
        self._across[axis].step(speed, stopping=stopping, blocked=blocked)

    def cross_motion(self, axis: str) -> tuple[float, float]:
        """Return a cross axis's place [m] and speed [m/s]."""
        return self._across[axis].place, self._across[axis].speed

    def cross_force(self, axis: str) -> float:
        """Nothing presses on the blade."""
        return 0.0


class SpecimenPlant(FreeAcross):
    """Specimen under the cutting law, with simulated drive and sensor.

    On a rig with a height axis the law is that with vertical motion, and the specimen may be in layers. ``mounted``:
    specimen, with the blade at the clamp and at height 0; its key selects the sensor's noise; ``drive``, ``sensor``,
    ``law`` are as for :class:`cutenv.sim.plant.SimulatedPlant`.
    """

    def __init__(
        self, mounted: MountedSpecimen, settings: RigSettings, *, drive: Drive | None = None,
        sensor: SensorParameters | None = None,
        law: LawParameters | None = None,
    ) -> None:  # fmt: skip
        self._angle = settings.fixed_angle
        constants: dict[str, Any] = {
            "drive": drive or drive_of(settings), "sensor": sensor, "law": law, "seed": mounted.seed,
            "episode": mounted.episode, "angle": self._angle,
        }  # fmt: skip
        self.plant: SimulatedPlant  # the simulated specimen
        if settings.height is None:
            self.plant = SimulatedPlant(mounted.drawn(), **constants)
        else:
            self.plant = descending = DescendingPlant(mounted.drawn(), layers=mounted.layers, **constants)
            self._rise = _Rise(descending, settings.height)
        self._drives, self._states = self.plant.cuts["drives"][0], self.plant.states
        self._usual, self._quick_stop = self._drives[0].copy(), settings.blade.quick_stop
        self._across = {name: CrossDrive(axis) for name, axis in settings.cross_axes.items() if name != "height"}
        self._stopping: bool | None = None
        self._position = self._speed = self._force = 0.0
        self._advance(0.0)

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance a millisecond; a quick stop brakes without the velocity loop's lag."""
        self._angle += turn * TICK
        if stopping != self._stopping:
            self._stopping = stopping
            self._drives["acceleration"] = self._quick_stop if stopping else self._usual.acceleration
            self._drives["lag"] = min(TICK, self._usual.lag) if stopping else self._usual.lag
        self._advance(0.0 if stopping else speed)

    def _advance(self, speed: float) -> None:
        """Advance a millisecond, at the nearest angle with measurements."""
        angle = min(max(self._angle, ANGLE_RANGE[0]), ANGLE_RANGE[1])
        across = (self._rise.falling(),) if isinstance(self.plant, DescendingPlant) else ()
        (reading,) = self.plant.advance(speed, angle, 1, *across).tolist()  # records are slow to read one by one
        self._position, self._speed, self._force = (reading[k] for k in _FELT)

    def block(self) -> None:
        """Advance a millisecond, the blade blocked along the cut."""
        self._states["hand_speed"] = self._states["speed"] = 0.0
        self._advance(0.0)

    def shift(self, axis: str, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Command the next millisecond [m/s]; the tissue feels that of the height."""
        if axis != "height":
            return super().shift(axis, speed, stopping=stopping, blocked=blocked)
        self._rise.command = speed, stopping, blocked
        return None

    @property
    def motion(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and angle [rad]."""
        return self._position, self._speed, self._angle

    def cross_motion(self, axis: str) -> tuple[float, float]:
        """Return a cross axis's place [m] and speed [m/s]."""
        return super().cross_motion(axis) if axis != "height" else self._rise.motion

    def cross_force(self, axis: str) -> float:
        """Return the tissue's upward force [N]; zero for the side axis."""
        return self._rise.force if axis == "height" else 0.0

    @property
    def force(self) -> float:
        """Force along the cut as measured by the sensor [N]."""
        return self._force


class _Rise:
    """Height axis on a plant with vertical motion."""

    def __init__(self, plant: DescendingPlant, axis: HeightAxis) -> None:
        self._plant, self._quick_stop = plant, axis.quick_stop
        self._usual = plant.descents[0].copy()
        self.command = 0.0, False, False  # speed upwards [m/s], a quick stop, a blocked blade

    def falling(self) -> float:
        """Set the drive's next millisecond; return downward speed [m/s]."""
        speed, stopping, blocked = self.command
        descents, stops = self._plant.descents, stopping or blocked
        descents["acceleration"] = self._quick_stop if stops else self._usual["acceleration"]
        descents["gain"] = 1.0 if stops else self._usual["gain"]
        if blocked:
            descents["level_speed"] = 0.0
        return 0.0 if stops else -speed

    @property
    def motion(self) -> tuple[float, float]:
        """Height [m] and speed upwards [m/s]."""
        return self._plant.level, float(self._plant.descents["level_speed"][0])

    @property
    def force(self) -> float:
        """Force of the tissue on the blade, upwards [N]."""
        return float(self._plant.vertical_force[-1])


class RecordedPlant(FreeAcross):
    """Recorded cut, replayed millisecond by millisecond, whatever is commanded.

    At its end the blade rests.
    """

    def __init__(self, trace: Trace) -> None:
        self._tape = ReplayPlant(trace)
        self._reading = self._tape.readings[0]
        self._holding = True

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance by a millisecond; a quick stop holds the record."""
        self._holding = stopping or self._tape.left == 0
        if not self._holding:
            self._reading = self._tape.advance(speed, math.pi / 2, 1)[0]

    def block(self) -> None:
        """Hold the record."""
        self._holding = True

    @property
    def motion(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and angle [rad]."""
        speed = 0.0 if self._holding else float(self._reading["speed"])
        return float(self._reading["position"]), speed, float(self._reading["angle"])

    @property
    def force(self) -> float:
        """Force as recorded from the sensor [N]."""
        return float(self._reading["force"])


_MIDDLE = 0.5  # [1] share of the way between the ends of travel at which the blade starts
_FAR = 100.0  # [m] to the model's own end stops


class AirPlant(FreeAcross):
    """Bench of :class:`cutenv.emulation.fake_rig.FakeRig` with drive and sensor, no specimen.

    ``settings``: settings with the travel, and the angle at the start; ``drive``: drive of the blade; by default the
    one that the settings describe; ``sensor``: force sensor; that of the simulator by default; ``start``: position of
    the blade at the start [m]; by default the middle of its travel.
    """

    def __init__(
        self,
        settings: RigSettings,
        *,
        drive: Drive | None = None,
        sensor: Sensor | None = None,
        start: float | None = None,
    ) -> None:
        self._drive = drive or drive_of(settings)
        self._across = {name: CrossDrive(axis) for name, axis in settings.cross_axes.items()}
        self._records = self._drive.records(2.0 * _FAR)
        self._states = np.zeros(1, STATE)
        middle = _MIDDLE * (settings.limits.low + settings.limits.high)
        self._states["hand"] = self._states["blade"] = _FAR + (middle if start is None else start)
        self._usual = self._records[0].copy()
        self._quick_stop = settings.blade.quick_stop
        self._angle, hinge = settings.fixed_angle, settings.angle
        self._reach = ANGLE_RANGE if hinge is None else (hinge.low, hinge.high)
        self._sensor = sensor or Sensor()
        self._force = 0.0
        self._feel()

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance a millisecond; a quick stop brakes without the velocity loop's lag."""
        drive, state = self._records[0], self._states[0]
        drive.acceleration = self._quick_stop if stopping else self._usual.acceleration
        drive.lag = min(TICK, self._usual.lag) if stopping else self._usual.lag
        target = 0.0 if stopping else float(delayed_command(state, drive, speed))
        advance_in_air(state, drive, lag_gain(drive, TICK), target, TICK)
        self._angle = min(max(self._angle + turn * TICK, self._reach[0]), self._reach[1])
        self._feel()

    def block(self) -> None:
        """Advance by a millisecond in which nothing can move."""
        self._states["hand_speed"] = self._states["speed"] = 0.0
        self._feel()

    def _feel(self) -> None:
        """Measure the force of a millisecond."""
        self._force = self._sensor.measure(0.0)

    @property
    def motion(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and angle [rad]."""
        state = self._states[0]
        return float(state["blade"]) - _FAR, float(state["speed"]), self._angle

    @property
    def force(self) -> float:
        """Force as measured by the sensor [N]."""
        return self._force


_ACROSS = 2**32  # added to the seed of the noise of the force to the side


class SteeredBench(AirPlant):
    """Specimen under the law in the plane, with drive and sensors.

    Drive and sensor are the simulator's; a second sensor measures to the side. ``mounted``: specimen along its line,
    with the blade at the clamp, in the middle; its key selects the sensor's noise and the rig has an axis to the side;
    ``drive``, ``sensor``, ``law`` are as for :class:`cutenv.sim.plant.SimulatedPlant`.
    """

    def __init__(
        self, mounted: MountedSpecimen, settings: RigSettings, *, drive: Drive | None = None,
        sensor: SensorParameters | None = None,
        law: LawParameters | None = None,
    ) -> None:  # fmt: skip
        settings.require_side_axis(by="SteeredBench")
        # the specimen, with what is hidden on a rig
        self.tissue = TissueInPlane(mounted.drawn(), mounted.line or straight(), law=law, angle=settings.fixed_angle)
        self._to_side = Sensor(sensor, seed=(mounted.seed + _ACROSS) % 2**64, episode=mounted.episode)
        self._side_force = 0.0
        along = Sensor(sensor, seed=mounted.seed, episode=mounted.episode)
        super().__init__(settings, drive=drive, sensor=along, start=0.0)

    def _feel(self) -> None:
        x, _, angle = self.motion
        self.tissue.advance(x, self._across["side"].place, angle)
        self._force = self._sensor.measure(self.tissue.force)
        self._side_force = self._to_side.measure(self.tissue.side_force)

    def cross_force(self, axis: str) -> float:
        """Return the tissue's measured force to the right [N]; zero for height."""
        return self._side_force if axis == "side" else 0.0
