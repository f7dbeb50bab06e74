"""Tissue on an emulated rig with axes across the cut: the laws of vertical motion and in the plane under the motors."""

from __future__ import annotations

import math
from collections.abc import Iterable

from cutenv.cutting.descent import HIGHEST, LOWEST
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import Sensor, SensorParameters
from cutenv.plant import DescendingPlant
from cutenv.rig.emulator.emulated_tissue import CLAMP_TOLERANCE, EmulatedTissue, Laid, measured, within
from cutenv.rig.errors import RigError
from cutenv.rig.tissue_in_plane import TissueInPlane
from cutenv.tissue.specimen import Specimen

ARM = 0.1
"""Distance from the blade's lower end up to the sensor, of an imitated rig with an axis across the cut [m]."""


class TissueAcross(EmulatedTissue):
    """Specimen, blade and force sensor, a millisecond at a time; see :class:`EmulatedTissue`.

    A specimen that is laid along a line feels the blade in the plane, another one in height.

    Attributes
    ----------
    places : dict
        Height of the blade's lower end, and place to the left, in the next millisecond [m], by axis.
    forces : dict
        Force of the tissue on the blade, upwards, and to the right, in the last one [N], with what a fault adds.
    """

    def __init__(
        self, axes: Iterable[str], sensor: SensorParameters | None = None, law: LawParameters | None = None
    ) -> None:
        super().__init__(sensor, law)
        self._felt = Sensor(self._sensor)
        self._descending: DescendingPlant | None = None
        self._plane: TissueInPlane | None = None
        self._force = self._extra = 0.0
        self.places, self.forces = dict.fromkeys(axes, 0.0), dict.fromkeys(axes, 0.0)
        self._added = dict(self.forces)

    def check_places(self, places: dict[str, float]) -> None:
        """Raise RigError for a blade that is not at height 0 and in the middle, where a specimen is laid."""
        for name, place in places.items():
            if abs(place) > CLAMP_TOLERANCE:
                raise RigError(
                    f"the {name} axis stands at {1e3 * place:.1f} mm: move it to 0 (within {1e3 * CLAMP_TOLERANCE:g} "
                    "mm) before a specimen is laid."
                )

    def mount(self, specimen: Specimen, laid: Laid, *, position: float, angle: float) -> None:
        """Clamp a fresh specimen; see :meth:`EmulatedTissue.mount`."""
        super().mount(specimen, laid, position=position, angle=angle)
        self._felt = Sensor(self._sensor, seed=laid.seed, episode=laid.episode)
        self._descending = self._plane = None
        if laid.line is not None:
            self._plane = TissueInPlane(specimen, laid.line, law=self._law, angle=angle)
            return
        self._descending = DescendingPlant(specimen, layers=laid.layers, law=self._law, angle=measured(angle))
        self._descending.states["blade"] = self._descending.states["tip"] = within(position)

    def take_away(self) -> None:
        """Remove the specimen: the blade is in free air, without force."""
        super().take_away()
        self._descending = self._plane = None

    def add_force(self, force: float) -> None:
        """Add ``force`` [N] to the tissue's along the cut; 0 removes it."""
        self._extra = force

    def add_across(self, axis: str, force: float) -> None:
        """Add a ``force`` [N], upwards, or to the right, to the tissue's; 0 removes it."""
        if axis not in self._added:
            return super().add_across(axis, force)
        self._added[axis] = force
        return None

    def advance(self, position: float, angle: float) -> float:
        """Move the blade to ``position`` [m], ``angle`` [rad] and :attr:`places`; return the reading along the cut [N].

        Outside the specimen, and of what a law describes, the blade is held at its border.
        """
        found = dict.fromkeys(self.forces, 0.0)
        force = 0.0
        if self._plane is not None:
            self._plane.advance(position, self.places["side"], angle)
            force, found["side"] = self._plane.force, self._plane.side_force
        elif self._descending is not None:
            level = min(max(self.places.get("height", 0.0), LOWEST), HIGHEST)
            readings = self._descending.lead(within(position), measured(angle), level)
            force = float(readings["true_force"][0])
            if "height" in found:
                found["height"] = float(self._descending.vertical_force[0])
        self._force = force + self._extra
        self.forces = {axis: value + self._added[axis] for axis, value in found.items()}
        return self._felt.measure(self._force)

    @property
    def true_force(self) -> float:
        """Force of the tissue on the blade, back toward the clamp [N]."""
        return self._force

    @property
    def tip(self) -> float:
        """Position of the crack tip, along its line if it has one [m]."""
        if self._plane is not None:
            return self._plane.tip
        return math.nan if self._descending is None else float(self._descending.states["tip"][0])
