"""The simulated plant: a specimen under the cutting law, a drive and a force sensor."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._base.validation import array_in_range, in_range
from cutenv.cutting.drive import Drive, Rig
from cutenv.cutting.dtypes import READING, new_state
from cutenv.cutting.parameters import LawParameters, law_records, profile_records
from cutenv.cutting.sensor import SensorParameters, sensor_records
from cutenv.cutting.simulate import CUT, Physics, account_one, hold
from cutenv.tissue.specimen import LENGTH, N_POINTS, SPACING, Specimen

ANGLE_RANGE = (math.radians(45.0), math.radians(90.0))
"""Measured angles of the blade [rad]."""

_ANGLE_LOW, _ANGLE_HIGH = ANGLE_RANGE[0] - 1e-9, ANGLE_RANGE[1] + 1e-9  # slack for rounding through degrees and back
MAX_SPEED = 0.5
"""Largest commanded speed [m/s]."""


class SimulatedPlant:
    """A simulated specimen, cut by a driven blade whose force a sensor measures.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    drive : Rig, PDRig or Hand, optional
        Drive of the blade; default the rig.
    sensor : SensorParameters, optional
        Noise, resolution and delay of the force sensor.
    law : LawParameters, optional
        Constants of the cutting law.
    seed, episode : int
        Random key of the sensor's noise.
    angle : float
        Angle at the start [rad].
    depth : array, shape (301,), optional
        Depth measured beforehand [m]; default the specimen's own.

    Attributes
    ----------
    cuts : Records
        The full state, :data:`~cutenv.cutting.simulate.CUT`, shape (1,).
    """

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
    ) -> None:
        check_angle(angle)
        self.specimen = specimen
        self.depth = (
            specimen.depth if depth is None else array_in_range("depth", depth, 1e-4, 0.2, "m", "2 cm is 0.02.")
        )
        if self.depth.shape != (N_POINTS,):
            raise ValueError(f"depth has shape {self.depth.shape}; give {N_POINTS} values, one every {SPACING} m.")
        self.cuts = np.zeros(1, CUT)
        self.cuts["states"] = new_state(1, angle)
        self.cuts["profiles"] = profile_records([specimen])
        self.cuts["laws"] = law_records([specimen], law)
        self.cuts["drives"] = (drive or Rig()).records(travel=LENGTH - SPACING)
        self.cuts["sensors"] = sensor_records([sensor or SensorParameters()], [seed], [episode])
        self._readings = np.zeros(1, READING)

    def advance(self, speed: float, angle: float, ticks: int) -> StructArray:
        """Command ``speed`` [m/s] and ``angle`` [rad] for ``ticks`` milliseconds; see :class:`~cutenv.plant.Plant`."""
        if not (-MAX_SPEED <= speed <= MAX_SPEED and _ANGLE_LOW <= angle <= _ANGLE_HIGH):
            in_range("speed", speed, -MAX_SPEED, MAX_SPEED, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
            check_angle(angle)
        if len(self._readings) != ticks or ticks == 0:
            if in_range("ticks", ticks, 1, 10**7, "1", "Give a whole number of milliseconds.") % 1.0:
                raise ValueError(f"ticks = {ticks:g} is not a whole number of milliseconds.")
            self._readings = np.zeros(int(ticks), READING)
        hold(self.cuts, speed, angle, self._readings)
        return self._readings

    @property
    def states(self) -> StructArray:
        """The hidden state, :data:`~cutenv.cutting.dtypes.STATE`, shape (1,)."""
        states: StructArray = self.cuts["states"][0]
        return states

    @property
    def profiles(self) -> StructArray:
        """The hidden truth along the cut, :data:`~cutenv.cutting.dtypes.PROFILE`, shape (1,)."""
        profiles: StructArray = self.cuts["profiles"][0]
        return profiles

    def snapshot(self) -> Physics:
        """Return copies of the hidden state and of everything that determines its future, each of shape (1,)."""
        return Physics(*(self.cuts[name][0].copy() for name in Physics._fields))

    def energy(self) -> dict[str, float]:
        """Return the energies since the start [J]: work, stored, fracture, friction, loss, ledger, and residual.

        The residual is work minus all the others.
        """
        return account_one(self.cuts)._asdict()


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
