"""Layered tissue on an emulated rig with a height axis: the law with vertical motion under the motors."""

from __future__ import annotations

import math

import numpy as np

from cutenv.cutting.descending_cut import follow_levels
from cutenv.cutting.descending_row import HIGHEST, LOWEST
from cutenv.cutting.dtypes import READING, TICK
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import Sensor, SensorParameters
from cutenv.plant import DescendingPlant
from cutenv.rig.emulator.emulated_tissue import CLAMP_TOLERANCE, EmulatedTissue, Laid, measured, within
from cutenv.rig.errors import RigError
from cutenv.tissue.specimen import Specimen

ARM = 0.1
"""Distance from the blade's lower end up to the sensor, of an imitated rig with a height axis [m]."""


class LayeredTissue(EmulatedTissue):
    """Specimen in layers, blade and force sensor, a millisecond at a time; see :class:`EmulatedTissue`.

    Attributes
    ----------
    height : float
        Height of the blade's lower end in the next millisecond [m], upwards.
    vertical_force : float
        Force of the tissue on the blade, upwards, in the last one [N], with what a fault adds.
    """

    def __init__(self, sensor: SensorParameters | None = None, law: LawParameters | None = None) -> None:
        super().__init__(sensor, law)
        self._felt = Sensor(self._sensor)
        self._plant: DescendingPlant | None = None
        self._force = self._extra = self._lift = self.height = self.vertical_force = 0.0
        self._slab = np.zeros(1)
        self._readings, self._vertical = np.zeros(1, READING), np.zeros(1)

    def check_height(self, height: float) -> None:
        """Raise RigError for a blade that is not at height 0, where a specimen is laid."""
        if abs(height) > CLAMP_TOLERANCE:
            raise RigError(
                f"the blade stands at a height of {1e3 * height:.1f} mm: lower it to 0 (within "
                f"{1e3 * CLAMP_TOLERANCE:g} mm) before a specimen is laid."
            )

    def mount(self, specimen: Specimen, laid: Laid, *, position: float, angle: float) -> None:
        """Clamp a fresh specimen; see :meth:`EmulatedTissue.mount`."""
        super().mount(specimen, laid, position=position, angle=angle)
        self._felt = Sensor(self._sensor, seed=laid.seed, episode=laid.episode)
        self._plant = DescendingPlant(specimen, layers=laid.layers, law=self._law, angle=measured(angle))
        self._slab = specimen.tissue.slab()
        self._plant.cuts.states["blade"] = self._plant.cuts.states["tip"] = within(position)

    def take_away(self) -> None:
        """Remove the specimen: the blade is in free air, without force."""
        super().take_away()
        self._plant = None

    def add_force(self, force: float) -> None:
        """Add ``force`` [N] to the tissue's along the cut; 0 removes it."""
        self._extra = force

    def add_lift(self, force: float) -> None:
        """Add a vertical ``force`` [N], upwards, to the tissue's; 0 removes it."""
        self._lift = force

    def advance(self, position: float, angle: float) -> float:
        """Move the blade to ``position`` [m], ``angle`` [rad] and :attr:`height` in a millisecond; return the reading.

        Outside the specimen, along it or above and below what the law describes, the blade is held at its border.
        """
        force = lift = 0.0
        if self._plant is not None:
            path = np.array([[within(position), min(max(self.height, LOWEST), HIGHEST), measured(angle)]])
            follow_levels(
                self._plant.cuts, self._plant.descents, self._slab, path, TICK, self._readings, self._vertical,
            )  # fmt: skip
            force, lift = float(self._readings["true_force"][0]), float(self._vertical[0])
        self._force, self.vertical_force = force + self._extra, lift + self._lift
        return self._felt.measure(self._force)

    @property
    def true_force(self) -> float:
        """Force of the tissue on the blade, back toward the clamp [N]."""
        return self._force

    @property
    def tip(self) -> float:
        """Position of the crack tip [m]."""
        return math.nan if self._plant is None else float(self._plant.cuts.states["tip"][0])
