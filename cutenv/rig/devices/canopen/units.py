"""Conversion between a drive's integers and metres or radians, by encoder, gear, lead and direction."""

from __future__ import annotations

from dataclasses import dataclass

from cutenv._base.validation import in_range
from cutenv.rig.config.axes import Axis

_INT32 = 2**31 - 1
_EDGES = 4  # increments in one pulse of the encoder
_STEPS_TO_TOP = 100  # least number of velocity units up to the top speed: fewer are too coarse


@dataclass(frozen=True, kw_only=True)
class AxisUnits:
    """Conversion between an axis in SI and its drive's integers, which count the motor's shaft.

    "Length" below is metres, or radians of an axis that turns.

    Attributes
    ----------
    axis : Axis
        Encoder, gear, lead and direction.
    steps : int
        Steps of the drive's velocity unit in one rpm: 1000 for milli-rpm, 1 for whole rpm.

    Raises
    ------
    ValueError
        If the axis exceeds what the drive can count, or the velocity unit is too coarse.
    """

    axis: Axis
    steps: int

    def __post_init__(self) -> None:
        axis = self.axis
        for name, end in (("low", axis.low), ("high", axis.high)):
            self._count(
                name, self._increments(end), "increments", "Check pulses, gear and lead, or shorten the travel."
            )
        self._count("speed", axis.speed * self._per_speed, f"1/{self.steps} rpm", "Check gear and lead.")
        for name in ("acceleration", "quick_stop"):
            self._count(name, getattr(axis, name) * self._rpm, "rpm/s", "Check gear and lead.")
        self._count("following_error", abs(self._increments(axis.following_error)), "increments", "Check pulses.")
        if axis.speed * self._per_speed < _STEPS_TO_TOP:
            raise ValueError(
                f"speed = {axis.speed:g} is only {axis.speed * self._per_speed:.1f} of the drive's velocity units"
                f" (1/{self.steps} rpm), too coarse to be controlled by. Let the drive count milli-rpm (object 0x60A9;"
                " its firmware may need an update), or check gear and lead."
            )

    def increments(self, position: float) -> int:
        """Return a position [length] in increments of the drive, rounded to the nearest."""
        return round(self._increments(position))

    def position(self, increments: int) -> float:
        """Return the position of so many increments [length]."""
        return increments / self._per_length

    def velocity(self, speed: float) -> int:
        """Return a speed [length/s] in the drive's velocity unit, rounded to the nearest.

        Raises
        ------
        TypeError, ValueError
            If it is not a number, or beyond the axis's top speed.
        """
        top = self.axis.speed * (1.0 + 1e-9)  # a product in the caller may be off in its last digit
        in_range("speed", speed, -top, top, "m/s or rad/s", "Raise the axis's speed in the rig's file, or go slower.")
        return round(self.axis.direction * speed * self._per_speed)

    def speed(self, velocity: int) -> float:
        """Return the speed of so many velocity units [length/s]."""
        return self.axis.direction * velocity / self._per_speed

    def ramp(self, acceleration: float) -> int:
        """Return an acceleration [length/s2] in the drive's unit [rpm/s], rounded to the nearest, at least 1."""
        return max(round(acceleration * self._rpm), 1)

    def acceleration(self, ramp: int) -> float:
        """Return the acceleration of so many rpm/s [length/s2]."""
        return ramp / self._rpm

    @property
    def speed_step(self) -> float:
        """Least difference of two speeds that the drive can distinguish [length/s]."""
        return 1.0 / self._per_speed

    @property
    def _rpm(self) -> float:
        """Speed of the motor at one length a second [rpm]."""
        return 60.0 * self.axis.gear / self.axis.lead

    @property
    def _per_speed(self) -> float:
        return self.steps * self._rpm

    @property
    def _per_length(self) -> float:
        return self.axis.direction * _EDGES * self.axis.pulses * self.axis.gear / self.axis.lead

    def _increments(self, position: float) -> float:
        return position * self._per_length

    @staticmethod
    def _count(name: str, value: float, unit: str, cure: str) -> None:
        in_range(f"{name}, as the drive counts it,", value, -_INT32, _INT32, unit, cure)
