"""A simulated plant whose blade is steered along a drawn line."""

from __future__ import annotations

import math
from typing import Any

from cutenv._base.arrays import Array, StructArray
from cutenv.cutting.dtypes import profile_records
from cutenv.cutting.steering import STEERED, SteeringParameters, place_of_blade, place_of_tip, steering_records
from cutenv.plant.simulator import SimulatedPlant
from cutenv.tissue.grid import SPACING
from cutenv.tissue.lines import CutLine, length_within
from cutenv.tissue.specimen import Specimen

MAX_TURN_RATE = 4.0
"""Largest rate of turn of the blade [rad/s]: a bend of 6 mm at full speed."""


class SteeredPlant(SimulatedPlant):
    """A simulated specimen, cut by a blade that is driven where it points and turned to the left and right.

    The specimen's profiles of modulus, toughness and depth lie along the line.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    line : CutLine
        Line to cut along, see :mod:`cutenv.tissue.lines`; the blade stands at its start and points along it.
    steering : SteeringParameters, optional
        Constants of the law in the plane.
    **keywords
        Those of :class:`~cutenv.plant.SimulatedPlant`; ``angle`` is the inclination of the blade.

    Raises
    ------
    ValueError
        If the tissue relaxes: no law of relaxing tissue in the plane is known.
    """

    motion = STEERED
    further = ("turn_rate", MAX_TURN_RATE, "rad/s", "Positive turns to the left.")

    def __init__(
        self, specimen: Specimen, line: CutLine, *, steering: SteeringParameters | None = None, **keywords: Any
    ) -> None:
        self.line, self._steering = line, steering
        super().__init__(specimen, **keywords)
        if (share := float(self.cuts["laws"]["relaxing_share"][0, 0])) != 0.0:
            raise ValueError(
                f"relaxing_share = {share:g}: a blade that is steered needs tissue that does not relax, 0."
            )

    def _begin(self) -> float:
        profiles = profile_records([self.specimen])
        self.cuts["motions"] = steering_records([self.specimen], [self.line], profiles, self._steering)
        self.cuts["profiles"] = profiles
        return length_within(self.line) - SPACING

    @property
    def steerings(self) -> StructArray:
        """The place in the plane, :data:`~cutenv.cutting.steering.STEERING`, shape (1,)."""
        steerings: StructArray = self.cuts["motions"][0]
        return steerings

    @property
    def lateral_force(self) -> Array:
        """True force of the tissue on the blade, to its right, during the last :meth:`advance`, shape (ticks,) [N]."""
        return self._across

    @property
    def blade(self) -> tuple[float, float]:
        """Place of the blade, along and across the slab [m]."""
        return place_of_blade(self.states, self.steerings)

    @property
    def tip(self) -> tuple[float, float]:
        """Place of the crack tip, along and across the slab [m]; hidden on a rig."""
        return place_of_tip(self.states, self.steerings)

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
            If a command is out of range, or ``ticks`` is no whole number from 1.
        """
        return self._advance(speed, angle, ticks, turn_rate)
