"""A simulated plant whose blade is steered along a drawn line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range
from cutenv.cutting.drive import Drive, Rig
from cutenv.cutting.dtypes import READING, new_state
from cutenv.cutting.parameters import LawParameters, law_records, profile_records
from cutenv.cutting.sensor import SensorParameters, sensor_records
from cutenv.cutting.simulate import Physics
from cutenv.cutting.steered_cut import account_of_steered, hold_steered
from cutenv.cutting.steering import SteeringParameters, place_of_blade, place_of_tip, steering_records
from cutenv.plant.simulator import ANGLE_RANGE, MAX_SPEED, check_angle
from cutenv.tissue.grid import SPACING
from cutenv.tissue.lines import CutLine, length_within
from cutenv.tissue.specimen import Specimen

MAX_TURN_RATE = 4.0
"""Largest rate of turn of the blade [rad/s]: a bend of 6 mm at full speed."""


class SteeredPlant:
    """A simulated specimen, cut by a blade that is driven where it points and turned to the left and right.

    The specimen's profiles of modulus, toughness and depth lie along the line.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    line : CutLine
        Line to cut along, see :mod:`cutenv.tissue.lines`; the blade stands at its start and points along it.
    drive : Rig, optional
        Drive of the blade.
    sensor : SensorParameters, optional
        Noise, resolution and delay of the force sensor.
    law : LawParameters, optional
        Constants of the cutting law.
    steering : SteeringParameters, optional
        Constants of the law in the plane.
    seed, episode : int
        Random key of the sensor's noise.
    angle : float
        Inclination of the blade at the start [rad].

    Attributes
    ----------
    cuts : Physics
        The hidden state, each part of shape (1,).
    steerings : Records
        The place in the plane, :data:`~cutenv.cutting.steering.STEERING`, shape (1,).
    lateral_force : array, shape (ticks,)
        True force of the tissue on the blade, to its right, during the last :meth:`advance` [N].
    """

    def __init__(
        self,
        specimen: Specimen,
        line: CutLine,
        *,
        drive: Drive | None = None,
        sensor: SensorParameters | None = None,
        law: LawParameters | None = None,
        steering: SteeringParameters | None = None,
        seed: int = 0,
        episode: int = 0,
        angle: float = ANGLE_RANGE[1],
    ) -> None:
        check_angle(angle)
        self.specimen, self.line = specimen, line
        profiles = profile_records([specimen])
        self.steerings = steering_records([specimen], [line], profiles, steering)
        self.cuts = Physics(
            new_state(1, angle), profiles, law_records([specimen], law),
            (drive or Rig()).records(travel=length_within(line) - SPACING),
            sensor_records([sensor or SensorParameters()], [seed], [episode]),
        )  # fmt: skip
        self.lateral_force: Array = np.zeros(0)

    @property
    def blade(self) -> tuple[float, float]:
        """Place of the blade, along and across the slab [m]."""
        return place_of_blade(self.cuts.states, self.steerings)

    @property
    def tip(self) -> tuple[float, float]:
        """Place of the crack tip, along and across the slab [m]; hidden on a rig."""
        return place_of_tip(self.cuts.states, self.steerings)

    @property
    def heading(self) -> float:
        """Direction in which the blade points: angle to the axis of the slab [rad], positive to the left."""
        steering = self.steerings[0]
        return math.atan2(steering["across"], steering["ahead"])

    @property
    def distance(self) -> float:
        """Distance of the blade to the left of the line [m]."""
        return float(self.steerings["aside"][0])

    @property
    def cut_distance(self) -> Array:
        """Distance of the cut to the left of the line at each point that the tip has passed [m], shape (n,)."""
        passed: Array = self.steerings["cut"][0][: self.steerings["cell"][0] + 1].copy()
        return passed

    def advance(self, speed: float, angle: float, ticks: int, turn_rate: float = 0.0) -> StructArray:
        """Command a speed [m/s], an inclination [rad] and a turn to the left [rad/s] for ``ticks`` milliseconds.

        Returns
        -------
        Records
            Readings (:data:`cutenv.cutting.dtypes.READING`), shape (ticks,); the force along the blade's direction is
            measured, positions are arc lengths of the line.

        Raises
        ------
        ValueError
            If a command is out of range, or ``ticks`` is less than 1.
        """
        in_range("speed", speed, -MAX_SPEED, MAX_SPEED, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
        in_range("turn_rate", turn_rate, -MAX_TURN_RATE, MAX_TURN_RATE, "rad/s", "Positive turns to the left.")
        check_angle(angle)
        if ticks < 1:
            raise ValueError(f"ticks = {ticks} is less than 1: give a whole number of milliseconds.")
        readings, self.lateral_force = np.zeros(ticks, READING), np.zeros(ticks)
        hold_steered(self.cuts, self.steerings, speed, angle, turn_rate, readings, self.lateral_force)
        return readings

    def energy(self) -> dict[str, Any]:
        """Return the energies since the start [J]: work, stored, fracture, friction, loss, ledger, and residual."""
        return account_of_steered(self.cuts, self.steerings)._asdict()
