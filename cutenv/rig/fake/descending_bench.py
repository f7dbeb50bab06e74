"""Bench of a fake rig with a height axis: a specimen in layers, which feels the blade's vertical motion."""

from __future__ import annotations

import math

from cutenv.cutting.descent import DescentParameters
from cutenv.cutting.drive import Drive
from cutenv.cutting.dtypes import READING, TICK
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import SensorParameters
from cutenv.plant import DescendingPlant
from cutenv.plant.simulator import ANGLE_RANGE
from cutenv.rig.config.identified import drive_of
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.fake.cross_drive import CrossDrive
from cutenv.rig.fake.specimen_plant import FreeAcross
from cutenv.tissue.layers import Layers
from cutenv.tissue.specimen import Specimen

_FELT = [(READING.names or ()).index(name) for name in ("position", "speed", "force")]


class DescendingBench(FreeAcross):
    """Specimen under the cutting law with vertical motion, with the simulator's own drives and sensor.

    Parameters
    ----------
    specimen : Specimen
        Specimen, with the blade at the clamp and at height 0.
    settings : RigSettings
        Settings of a rig with a height axis.
    layers, drive, sensor, law, descent, seed, episode
        As for :class:`cutenv.plant.DescendingPlant`.

    Attributes
    ----------
    plant : DescendingPlant
        The simulated specimen.
    """

    def __init__(
        self, specimen: Specimen, settings: RigSettings, *, layers: Layers | None = None, drive: Drive | None = None,
        sensor: SensorParameters | None = None, law: LawParameters | None = None,
        descent: DescentParameters | None = None, seed: int = 0, episode: int = 0,
    ) -> None:  # fmt: skip
        axis = settings.require_height_axis(by="DescendingBench")
        drive, self._descent = drive or drive_of(settings), descent or DescentParameters()
        self._angle = settings.fixed_angle
        self.plant = DescendingPlant(
            specimen, layers=layers, drive=drive, sensor=sensor, law=law, descent=self._descent, seed=seed,
            episode=episode, angle=self._angle,
        )  # fmt: skip
        self._usual = self.plant.cuts["drives"][0, 0].copy()
        self._quick_stops = settings.blade.quick_stop, axis.quick_stop
        self._rise, self._rise_stops, self._rise_blocked = 0.0, False, False
        self._across = {name: CrossDrive(each) for name, each in settings.cross_axes.items() if name != "height"}
        self._position = self._speed = self._force = 0.0
        self._advance(0.0, stopping=False)

    def step(self, speed: float, turn: float, stopping: bool) -> None:
        """Advance by a millisecond; a quick stop brakes at its own rate, without the velocity loop's lag."""
        self._angle += turn * TICK
        self._advance(0.0 if stopping else speed, stopping=stopping)

    def block(self) -> None:
        """Advance by a millisecond in which the blade cannot move along the cut."""
        self.plant.states["hand_speed"] = self.plant.states["speed"] = 0.0
        self._advance(0.0, stopping=False)

    def shift(self, axis: str, speed: float, *, stopping: bool, blocked: bool) -> None:
        """Command the motion of the next millisecond [m/s]; the height's is felt by the tissue."""
        if axis != "height":
            return super().shift(axis, speed, stopping=stopping, blocked=blocked)
        self._rise, self._rise_stops, self._rise_blocked = speed, stopping, blocked
        return None

    def _advance(self, speed: float, *, stopping: bool) -> None:
        plant, descent = self.plant, self._descent
        drives, descents = plant.cuts["drives"][0], plant.descents
        drives["acceleration"] = self._quick_stops[0] if stopping else self._usual.acceleration
        drives["lag"] = min(TICK, self._usual.lag) if stopping else self._usual.lag
        rising_stops = self._rise_stops or self._rise_blocked
        descents["acceleration"] = self._quick_stops[1] if rising_stops else descent.vertical_acceleration
        descents["gain"] = 1.0 if rising_stops else -math.expm1(-TICK / descent.vertical_lag)
        if self._rise_blocked:
            descents["level_speed"] = 0.0
        angle = min(max(self._angle, ANGLE_RANGE[0]), ANGLE_RANGE[1])  # the nearest for which the law was measured
        falling = 0.0 if rising_stops else -self._rise
        (reading,) = plant.advance(speed, angle, 1, falling).tolist()  # numbers: records are slow to read one by one
        self._position, self._speed, self._force = (reading[k] for k in _FELT)

    @property
    def motion(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and angle [rad]."""
        return self._position, self._speed, self._angle

    def beside(self, axis: str) -> tuple[float, float]:
        """Return place [m] and speed [m/s] of an axis across the cut."""
        if axis != "height":
            return super().beside(axis)
        return self.plant.level, float(self.plant.descents["level_speed"][0])

    def cross_force(self, axis: str) -> float:
        """Return the force of the tissue on the blade, upwards [N]; it feels nothing of an axis to the side."""
        return float(self.plant.vertical_force[-1]) if axis == "height" else 0.0

    @property
    def force(self) -> float:
        """Force along the cut as measured by the sensor [N]."""
        return self._force
