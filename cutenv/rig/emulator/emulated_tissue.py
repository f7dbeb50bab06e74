"""Tissue on an emulated rig: the laws of cutting under the blade that its motors move, and the force sensor."""

from __future__ import annotations

import math
from collections.abc import Iterable

from cutenv.cutting.descent import HIGHEST, LOWEST
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import Sensor, SensorParameters
from cutenv.plant import DescendingPlant, SimulatedPlant
from cutenv.rig.config.laid import Laid
from cutenv.rig.errors import RigError
from cutenv.rig.tissue_in_plane import TissueInPlane, measured, within
from cutenv.tissue.specimen import Specimen

CLAMP_TOLERANCE = 0.002
"""Greatest distance of the blade from the clamp at which a specimen can be laid [m]."""
ARM = 0.1
"""Distance from the blade's lower end up to the sensor, of an imitated rig with an axis across the cut [m]."""


class EmulatedTissue:
    """Specimen, blade and force sensor, a millisecond at a time.

    A specimen along a line feels the blade in the plane, another one in height, where the rig has the axis.

    Parameters
    ----------
    sensor : SensorParameters, optional
        Force sensor; as in the simulator by default.
    law : LawParameters, optional
        Cutting law; as in the simulator by default.
    axes : iterable of str
        Axes across the cut, "height" and "side".

    Attributes
    ----------
    places : dict
        Height of the blade's lower end, and place to the left, in the next millisecond [m], by axis.
    forces : dict
        Force of the tissue on the blade, upwards, and to the right, in the last one [N], with what a fault adds.
    """

    def __init__(
        self, sensor: SensorParameters | None = None, law: LawParameters | None = None, axes: Iterable[str] = ()
    ) -> None:
        self._sensor, self._law = sensor or SensorParameters(), law
        self.places = dict.fromkeys(axes, 0.0)
        self.forces, self._added = dict(self.places), dict(self.places)
        self._extra = self._force = 0.0
        self._felt = Sensor(self._sensor)
        self.take_away()

    def take_away(self) -> None:
        """Remove the specimen: the blade is in free air, without force."""
        self.laid: Laid | None = None
        self._plant: SimulatedPlant | None = None
        self._plane: TissueInPlane | None = None

    def mount(self, specimen: Specimen, laid: Laid, *, position: float, angle: float) -> None:
        """Clamp a fresh specimen with its crack at the blade, which must be at the clamp, at height 0, in the middle.

        Parameters
        ----------
        specimen : Specimen
            Specimen to be cut.
        laid : Laid
            Key of the specimen; seed and episode select the sensor's noise, as in the simulator.
        position, angle : float
            Position [m] and angle [rad] of the blade; :attr:`places` are those of the other axes.

        Raises
        ------
        RigError
            If the blade is somewhere else.
        """
        for name, place in self.places.items():
            if abs(place) > CLAMP_TOLERANCE:
                raise RigError(
                    f"the {name} axis stands at {1e3 * place:.1f} mm: move it to 0 (within {1e3 * CLAMP_TOLERANCE:g} "
                    "mm) before a specimen is laid."
                )
        if abs(position) > CLAMP_TOLERANCE:
            raise RigError(
                f"the blade stands at {1e3 * position:.1f} mm: drive it to the clamp (within "
                f"{1e3 * CLAMP_TOLERANCE:g} mm) "
                "before a specimen is laid."
            )
        self.take_away()
        self.laid = laid
        self._felt = Sensor(self._sensor, seed=laid.seed, episode=laid.episode)
        if laid.line is not None:
            self._plane = TissueInPlane(specimen, laid.line, law=self._law, angle=angle)
        elif "height" in self.places:
            self._plant = DescendingPlant(specimen, layers=laid.layers, law=self._law, angle=measured(angle))
        else:
            self._plant = SimulatedPlant(specimen, law=self._law, angle=measured(angle))
        if self._plant is not None:
            self._plant.states["blade"] = self._plant.states["tip"] = within(position)

    def add_force(self, force: float) -> None:
        """Add ``force`` [N] to the tissue's along the cut; 0 removes it."""
        self._extra = force

    def add_across(self, axis: str, force: float) -> None:
        """Add a ``force`` [N], upwards, or to the right, to the tissue's; 0 removes it.

        Raises
        ------
        ValueError
            If the rig has no such axis: there is no force along it.
        """
        if axis not in self._added:
            raise ValueError(f"this rig has no {axis} axis. Start the emulator with --{axis}.")
        self._added[axis] = force

    def advance(self, position: float, angle: float) -> float:
        """Move the blade to ``position`` [m], ``angle`` [rad] and :attr:`places`; return the reading along the cut [N].

        It takes a millisecond. Outside the specimen, and of what a law describes, the blade is held at its border.
        """
        self.forces, self._force = dict(self._added), self._extra
        if self._plane is not None:
            self._plane.advance(position, self.places["side"], angle)
            self._force += self._plane.force
            self.forces["side"] += self._plane.side_force
        elif (plant := self._plant) is not None:
            level = min(max(self.places.get("height", 0.0), LOWEST), HIGHEST)
            self._force += float(plant.lead(within(position), measured(angle), level)["true_force"][0])
            if isinstance(plant, DescendingPlant):
                self.forces["height"] += float(plant.vertical_force[0])
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
        return math.nan if self._plant is None else float(self._plant.states["tip"][0])
