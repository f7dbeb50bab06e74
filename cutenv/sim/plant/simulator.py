"""The simulated plant: a specimen under law, drive and force sensor."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import array_in_range, in_range
from cutenv.sim.cutting.drive import Drive, Rig
from cutenv.sim.cutting.dtypes import READING, TICK, LawParameters, law_records, new_state, profile_records
from cutenv.sim.cutting.motion import STRAIGHT, Motion
from cutenv.sim.cutting.sensor import SensorParameters, sensor_records
from cutenv.sim.cutting.simulate import Physics, account_one, follow, hold
from cutenv.sim.tissue.specimen import LENGTH, N_POINTS, SPACING, Specimen

ANGLE_RANGE = (math.radians(45.0), math.radians(90.0))  # measured angles of the blade [rad]

_MOST_TICKS = 10**7  # of one call
_NONE_ACROSS: Array = np.zeros(0)  # forces across the cut of a motion that has none
_ANGLE_LOW, _ANGLE_HIGH = ANGLE_RANGE[0] - 1e-9, ANGLE_RANGE[1] + 1e-9  # slack for rounding through degrees and back
MAX_SPEED = 0.5  # largest commanded speed [m/s]


class SimulatedPlant:
    """Simulated specimen, cut by a driven blade with force sensor.

    Parameters
    ----------
    drive : Rig, PDRig or Hand, optional
        Default the rig.
    seed, episode : int
        Random key of the sensor's noise.
    angle : float
        Angle at the start [rad].
    depth : array, shape (301,), optional
        Depth measured beforehand [m]; default the specimen's own.
    motion : Motion, optional
        Motion of the blade, whose records an episode of a task begins; default along the cut alone.

    Attributes
    ----------
    cuts : StructArray
        The full state, :attr:`~cutenv.sim.cutting.motion.Motion.cut` of shape (1,).
    shared : StructArray
        What all cuts of its motion and tissue share, shape (1,).
    """

    motion: Motion = STRAIGHT
    """Motion of the blade."""
    further: ClassVar[tuple[str, float, str, str]] = ("further", 0.0, "m/s", "This blade has no further axis.")
    """Command of the motion's further axis: its name, largest size, unit and cure."""

    def __init__(
        self,
        specimen: Specimen,
        *,
        drive: Drive | None = None,
        sensor: SensorParameters | None = None,
        law: LawParameters | None = None,
        seed: int = 0,
        episode: int = 0,
        angle: float = ANGLE_RANGE[1],
        depth: NDArray[np.float64] | None = None,
        motion: Motion | None = None,
    ) -> None:
        check_angle(angle)
        self.motion = motion or type(self).motion
        self.specimen = specimen
        self.depth = (
            specimen.depth if depth is None else array_in_range("depth", depth, 1e-4, 0.2, "m", "2 cm is 0.02.")
        )
        if self.depth.shape != (N_POINTS,):
            raise ValueError(f"depth has shape {self.depth.shape}; give {N_POINTS} values, one every {SPACING} m.")
        self.cuts = np.zeros(1, self.motion.cut)
        self.shared: StructArray = np.zeros(1, self.motion.shared)
        self.cuts["states"] = new_state(1, angle)
        self.cuts["laws"] = law_records([specimen], law)
        self.cuts["drives"] = (drive or Rig()).records(travel=self._begin())
        self.cuts["sensors"] = sensor_records([sensor or SensorParameters()], [seed], [episode])
        self._across: Array = np.zeros(0)

    def _begin(self) -> float:
        """Fill profiles and motion records; return the blade's travel [m]."""
        self.cuts["profiles"] = profile_records([self.specimen])
        return LENGTH - SPACING

    def advance(self, speed: float, angle: float, ticks: int) -> StructArray:
        """Command ``speed`` [m/s] and ``angle`` [rad] for ``ticks`` ms; see :class:`~cutenv.sim.plant.Plant`."""
        return self._advance(speed, angle, ticks, 0.0)

    def _advance(self, speed: float, angle: float, ticks: int, further: float) -> StructArray:
        """Advance under checked commands, with the motion's further axis."""
        if not (-MAX_SPEED <= speed <= MAX_SPEED and _ANGLE_LOW <= angle <= _ANGLE_HIGH):
            in_range("speed", speed, -MAX_SPEED, MAX_SPEED, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
            check_angle(angle)
        name, largest, unit, cure = self.further
        if not -largest <= further <= largest:
            in_range(name, further, -largest, largest, unit, cure)
        if type(ticks) is not int or not 1 <= ticks <= _MOST_TICKS:
            whole = "Give a whole number of milliseconds."
            if in_range("ticks", ticks, 1, _MOST_TICKS, "1", whole) % 1.0:
                raise ValueError(f"ticks = {ticks:g} is not a whole number of milliseconds.")
            ticks = int(ticks)
        readings = np.zeros(ticks, READING)
        self._across = _NONE_ACROSS if self.motion is STRAIGHT else np.zeros(ticks)
        hold(self.motion)(self.cuts, self.shared, (speed, angle, further), readings, self._across)
        return readings

    def lead(
        self, positions: ArrayLike, angles: ArrayLike, further: ArrayLike = 0.0, *, dt: float = TICK
    ) -> StructArray:
        """Lead the blade exactly along a path, without drive and sensor.

        The path, see :func:`cutenv.sim.cutting.simulate.follow`, is of arrays of shape (n,) or () [m], [rad] and [m] or
        [rad], every ``dt`` [s]; the force of the readings, (n,), is the true one.  ValueError if the path leaves the
        specimen.
        """
        shape = np.broadcast_shapes(np.shape(positions), np.shape(angles), np.shape(further))
        path = np.empty((*shape, 3))
        path[..., 0], path[..., 1], path[..., 2] = positions, angles, further
        path = path.reshape(-1, 3)
        readings, self._across = np.zeros(len(path), READING), np.zeros(len(path))
        follow(self.motion)(self.cuts, self.shared, path, dt, readings, self._across)
        return readings

    @property
    def states(self) -> StructArray:
        """The hidden state, :data:`~cutenv.sim.cutting.dtypes.STATE`, shape (1,)."""
        states: StructArray = self.cuts["states"][0]
        return states

    @property
    def profiles(self) -> StructArray:
        """The hidden truth along the cut, :data:`~cutenv.sim.cutting.dtypes.PROFILE`, shape (1,)."""
        profiles: StructArray = self.cuts["profiles"][0]
        return profiles

    def snapshot(self) -> Physics:
        """Return copies of the whole hidden state, each of shape (1,)."""
        parts = {name: self.cuts[name][0].copy() for name in Physics._fields if name != "shared"}
        return Physics(**parts, shared=self.shared)

    def energy(self) -> dict[str, float]:
        """Return the energies since the start [J], with their residual.

        The residual is work minus all the others.
        """
        energies: dict[str, float] = account_one(self.motion)(self.cuts)._asdict()
        return energies


def check_angle(angle: float) -> None:
    """Raise ValueError if ``angle`` [rad] is outside the measured range."""
    in_range(
        "angle",
        angle,
        _ANGLE_LOW,
        _ANGLE_HIGH,
        "rad",
        "Angles from 45 to 90 degrees were measured; angles are in radians: 90 degrees is 1.5708.",
    )
