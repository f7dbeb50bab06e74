"""Simulated plants whose blade moves up and down, or is steered along a line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range
from cutenv.sim.cutting.descent import (
    DESCENDING,
    HIGHEST,
    LOWEST,
    DescentParameters,
    descent_records,
    layered_profiles,
    shared_record,
)
from cutenv.sim.cutting.dtypes import profile_records
from cutenv.sim.cutting.steering import STEERED, SteeringParameters, place_of_blade, place_of_tip, steering_records
from cutenv.sim.plant.simulator import MAX_SPEED, SimulatedPlant
from cutenv.sim.tissue.grid import LENGTH, SPACING
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.lines import CutLine, length_within
from cutenv.sim.tissue.specimen import Specimen


class DescendingPlant(SimulatedPlant):
    """Simulated specimen in layers, cut by a blade that also moves up and down.

    ``layers`` are over the depth; by default those of its tissue, where they were measured, or one tissue throughout.
    ``level`` is the blade's at the start [m], upwards, -0.025 to 0.025.  The keywords are those of
    :class:`~cutenv.sim.plant.SimulatedPlant`; ``depth`` is that of a blade at level 0.
    """

    motion = DESCENDING
    further = ("descent_speed", MAX_SPEED, "m/s", "Speeds are in m/s: 5 mm/s is 0.005.")

    def __init__(
        self,
        specimen: Specimen,
        *,
        layers: Layers | None = None,
        descent: DescentParameters | None = None,
        level: float = 0.0,
        **keywords: Any,
    ) -> None:
        in_range("level", level, LOWEST, HIGHEST, "m", "5 mm below level 0 is -0.005.")
        self._started = layers or specimen.tissue.layers, descent, level
        super().__init__(specimen, **keywords)

    def _begin(self) -> float:
        layers, descent, level = self._started
        descents, shared = descent_records([self.specimen], layers, descent), shared_record(self.specimen.tissue)
        descents["level"] = descents["settled"] = descents["engaged"] = level
        descents["floor"][:, 0] = level
        self.cuts["profiles"] = layered_profiles(descents, shared["slab"][0])
        self.cuts["motions"], self.shared = descents, shared
        return LENGTH - SPACING

    @property
    def descents(self) -> StructArray:
        """The vertical motion, :data:`~cutenv.sim.cutting.descent.DESCENT`, shape (1,)."""
        descents: StructArray = self.cuts["motions"][0]
        return descents

    @property
    def vertical_force(self) -> Array:
        """True upward force of the last :meth:`advance`, shape (ticks,) [N]."""
        return self._across

    @property
    def level(self) -> float:
        """Level of the blade's lower end [m], upwards from the profile's depth."""
        return float(self.descents["level"][0])

    @property
    def floor(self) -> Array:
        """Depth of cut at each point [m], shape (301,); 0: uncut."""
        cut: Array = np.minimum(self.descents["surface"][0] - self.descents["floor"][0], self.specimen.thickness)
        return cut

    def advance(self, speed: float, angle: float, ticks: int, descent_speed: float = 0.0) -> StructArray:
        """Command speeds forward and down [m/s] and an angle [rad].

        The readings (:data:`cutenv.sim.cutting.dtypes.READING`), (ticks,), have the measured force along the cut.
        ValueError if a command is out of range, or ``ticks`` is no whole number from 1.
        """
        return self._advance(speed, angle, ticks, descent_speed)


MAX_TURN_RATE = 4.0  # largest rate of turn of the blade [rad/s]: a bend of 6 mm at full speed


class SteeredPlant(SimulatedPlant):
    """A simulated specimen, cut by a blade that is driven where it points and turned.

    The specimen's profiles of modulus, toughness and depth lie along ``line`` (:mod:`cutenv.sim.tissue.lines`), at
    whose start the blade stands and along which it points.  The keywords are those of
    :class:`~cutenv.sim.plant.SimulatedPlant`; ``angle`` is the inclination of the blade.  ValueError if the tissue
    relaxes: no law of relaxing tissue in the plane is known.
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
        """The place in the plane, :data:`~cutenv.sim.cutting.steering.STEERING`, shape (1,)."""
        steerings: StructArray = self.cuts["motions"][0]
        return steerings

    @property
    def lateral_force(self) -> Array:
        """True rightward force of the last :meth:`advance`, shape (ticks,) [N]."""
        return self._across

    @property
    def blade(self) -> tuple[float, float]:
        """Place of the blade, along and across the slab [m]."""
        return place_of_blade(self.states, self.steerings)

    @property
    def tip(self) -> tuple[float, float]:
        """Crack tip along and across the slab [m]; hidden on rigs."""
        return place_of_tip(self.states, self.steerings)

    @property
    def heading(self) -> float:
        """Blade's heading from the slab's axis [rad], positive to the left."""
        steering = self.steerings[0]
        return math.atan2(steering["across"], steering["ahead"])

    @property
    def distance(self) -> float:
        """Distance of the blade left of the line [m]."""
        return float(self.steerings["aside"][0])

    @property
    def cut_distance(self) -> Array:
        """Distance of the cut left of the line [m], shape (n,)."""
        passed: Array = self.steerings["cut"][0][: self.steerings["cell"][0] + 1].copy()
        return passed

    def advance(self, speed: float, angle: float, ticks: int, turn_rate: float = 0.0) -> StructArray:
        """Command speed [m/s], inclination [rad] and left turn [rad/s].

        The readings (:data:`cutenv.sim.cutting.dtypes.READING`), (ticks,), have the measured force along the blade's
        direction; positions are arc lengths of the line.  ValueError if a command is out of range, or ``ticks`` is no
        whole number from 1.
        """
        return self._advance(speed, angle, ticks, turn_rate)
