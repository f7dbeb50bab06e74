"""Bench of a fake rig, on which its blade and sensor work: a specimen under the cutting law, or a recorded cut."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

from cutenv.cutting.drive import Drive
from cutenv.cutting.dtypes import READING, TICK
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import SensorParameters
from cutenv.plant import ReplayPlant, SimulatedPlant
from cutenv.plant.simulator import ANGLE_RANGE
from cutenv.rig.config.identified import drive_of
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.fake.cross_drive import CrossDrive
from cutenv.tissue.specimen import Specimen
from cutenv.trace import Trace

_FELT = [(READING.names or ()).index(name) for name in ("position", "speed", "force")]


class DrivenPlant(Protocol):
    """Load that a fake rig's blade and sensor work on."""

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance by a millisecond under a commanded speed [m/s] and rate of turn [rad/s]."""
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
        """Command the motion of the next millisecond of "height" [m/s], upwards, or of "side", to the left."""
        ...

    def beside(self, axis: str) -> tuple[float, float]:
        """Return height of the blade's lower end, or its place to the left [m], and the speed of it [m/s]."""
        ...

    def cross_force(self, axis: str) -> float:
        """Return the force of the tissue on the blade, upwards, or to the right [N]."""
        ...


class FreeAcross:
    """Part of a bench on which the blade feels nothing of the axes across the cut: it moves freely there."""

    _across: Mapping[str, CrossDrive] = MappingProxyType({})

    def shift(self, axis: str, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Move by a millisecond, in air."""
        self._across[axis].step(speed, stopping=stopping, blocked=blocked)

    def beside(self, axis: str) -> tuple[float, float]:
        """Return place [m] and speed [m/s] of an axis across the cut."""
        return self._across[axis].place, self._across[axis].speed

    def cross_force(self, axis: str) -> float:
        """Nothing presses on the blade."""
        return 0.0


class SpecimenPlant(FreeAcross):
    """Specimen under the cutting law, with the simulator's own drive and sensor."""

    def __init__(
        self, specimen: Specimen, settings: RigSettings, *, drive: Drive | None = None,
        sensor: SensorParameters | None = None, law: LawParameters | None = None, seed: int = 0, episode: int = 0,
    ) -> None:  # fmt: skip
        drive = drive or drive_of(settings)
        self._across = {name: CrossDrive(axis) for name, axis in settings.cross_axes.items()}
        self.plant = SimulatedPlant(
            specimen, drive=drive, sensor=sensor, law=law, seed=seed, episode=episode, angle=settings.fixed_angle
        )
        self._angle = settings.fixed_angle
        self._usual, self._quick_stop = self.plant.cuts["drives"].ravel()[0].copy(), settings.blade.quick_stop
        self._stopping: bool | None = None
        self._position = self._speed = self._force = 0.0
        self._advance(0.0)

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance by a millisecond; a quick stop brakes at its own rate, without the velocity loop's lag."""
        self._angle += turn * TICK
        if stopping != self._stopping:
            self._stopping = stopping
            self.plant.cuts["drives"]["acceleration"] = self._quick_stop if stopping else self._usual.acceleration
            self.plant.cuts["drives"]["lag"] = min(TICK, self._usual.lag) if stopping else self._usual.lag
        self._advance(0.0 if stopping else speed)

    def _advance(self, speed: float) -> None:
        """Advance by a millisecond, at the nearest angle for which the law was measured."""
        angle = min(max(self._angle, ANGLE_RANGE[0]), ANGLE_RANGE[1])
        (reading,) = self.plant.advance(speed, angle, 1).tolist()  # numbers: records are slow to read one by one
        self._position, self._speed, self._force = (reading[k] for k in _FELT)

    def block(self) -> None:
        """Advance by a millisecond in which nothing can move."""
        self.plant.cuts["states"]["hand_speed"] = self.plant.cuts["states"]["speed"] = 0.0
        self._advance(0.0)

    @property
    def motion(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and angle [rad]."""
        return self._position, self._speed, self._angle

    @property
    def force(self) -> float:
        """Force as measured by the sensor [N]."""
        return self._force


class RecordedPlant(FreeAcross):
    """Recorded cut, replayed millisecond by millisecond, whatever is commanded; at its end the blade rests."""

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
