"""Bench with nothing on it, for a fake rig whose blade moves in air."""

from __future__ import annotations

import numpy as np

from cutenv.cutting.drive import Drive, advance_in_air, delayed_command, lag_gain
from cutenv.cutting.dtypes import STATE, TICK
from cutenv.cutting.sensor import Sensor
from cutenv.plant.simulator import ANGLE_RANGE
from cutenv.rig.config.identified import drive_of
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.fake.specimen_plant import CrossDrive, FreeAcross

_MIDDLE = 0.5  # [1] share of the way between the ends of travel at which the blade starts
_FAR = 100.0  # [m] to the model's own end stops


class AirPlant(FreeAcross):
    """Bench of :class:`cutenv.rig.fake.fake_rig.FakeRig` with the simulator's drive and sensor, and no specimen.

    Parameters
    ----------
    settings : RigSettings
        Settings with the travel, and the angle at the start.
    drive : Rig, optional
        Drive of the blade; by default the one that the settings describe.
    sensor : Sensor, optional
        Force sensor; that of the simulator by default.
    start : float, optional
        Position of the blade at the start [m]; by default the middle of its travel.
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
        """Advance by a millisecond; a quick stop brakes at its own rate, without the velocity loop's lag."""
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
