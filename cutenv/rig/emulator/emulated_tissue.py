"""Tissue on an emulated rig: the laws of cutting under the blade that its motors move, and the force sensor."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._engine.jit import njit
from cutenv._engine.lanes import first_row
from cutenv.cutting.descending_cut import follow_levels
from cutenv.cutting.descending_row import HIGHEST, LOWEST
from cutenv.cutting.dtypes import DRIVE, LAW, PROFILE, READING, STATE, TICK, new_state
from cutenv.cutting.parameters import LawParameters, law_records, profile_records
from cutenv.cutting.row import ONE, begin, plain_views, put, take_tissue
from cutenv.cutting.sensor import SENSOR, Sensor, SensorParameters, measure, sensor_records
from cutenv.cutting.update import cut_row
from cutenv.plant import DescendingPlant
from cutenv.rig.config.laid import Laid
from cutenv.rig.errors import RigError
from cutenv.rig.tissue_in_plane import TissueInPlane, measured, within
from cutenv.tissue.specimen import Specimen

CLAMP_TOLERANCE = 0.002
"""Greatest distance of the blade from the clamp at which a specimen can be laid [m]."""
ARM = 0.1
"""Distance from the blade's lower end up to the sensor, of an imitated rig with an axis across the cut [m]."""

_TISSUE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("states", STATE, (1,)),
            ("profiles", PROFILE, (1,)),
            ("laws", LAW, (1,)),
            ("drives", DRIVE, (1,)),  # unused: the motor is emulated
            ("sensors", SENSOR, (1,)),
            ("rows", ONE, (1,)),  # memory of the calls
            ("free_air", "i8"),
            ("extra", "f8"),  # [N] added force
            ("true_force", "f8"),  # [N] on the blade
        ],
    )
)


@njit
def feel(tissues: StructArray, position: float, angle: float, dt: float) -> float:
    """Move the blade to ``position`` [m] and ``angle`` [rad] in ``dt`` [s]; return the sensor's reading [N]."""
    tissue = tissues[0]
    state, row = tissue.states[0], first_row(tissue.rows)
    force = tissue.extra
    if tissue.free_air:
        state.speed = (position - state.blade) / dt
        state.blade = position
        state.tick += 1
    else:
        plain = plain_views(tissue.rows, tissue.states, tissue.laws, tissue.drives)
        take_tissue(row, plain, tissue.profiles[0], 0, 0)
        begin(row, plain, 1)
        row.dx[0], row.next_angle[0] = position - row.blade[0], angle
        row.turns = 1 if angle != row.angle[0] else 0
        cut_row(row, tissue.profiles, dt)
        put(row, plain, 0, 0)
        force += row.force[0]
    tissue.true_force = force
    return measure(tissue.rows, tissue.sensors, force, state.tick - 1)


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
        self._readings, self._vertical = np.zeros(1, READING), np.zeros(1)
        self._records = self._air(Laid(), 0.0, math.pi / 2)
        self.take_away()

    def _air(self, laid: Laid, position: float, angle: float) -> StructArray:
        """Return records of a blade in free air, whose sensor has the noise of the specimen's key."""
        records = np.zeros(1, _TISSUE)
        records["states"] = new_state(1, measured(angle))
        records["states"]["blade"] = records["states"]["tip"] = within(position)
        records["sensors"] = sensor_records([self._sensor], [laid.seed], [laid.episode])
        records["extra"] = self._extra
        records["free_air"] = 1
        return records

    def take_away(self) -> None:
        """Remove the specimen: the blade is in free air, without force."""
        self._records["free_air"] = 1
        self.laid: Laid | None = None
        self._descending: DescendingPlant | None = None
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
        self.laid, self._records = laid, self._air(laid, position, angle)
        self._felt = Sensor(self._sensor, seed=laid.seed, episode=laid.episode)
        if laid.line is not None:
            self._plane = TissueInPlane(specimen, laid.line, law=self._law, angle=angle)
        elif "height" in self.places:
            self._descending = DescendingPlant(specimen, layers=laid.layers, law=self._law, angle=measured(angle))
            self._slab = specimen.tissue.slab()
            self._descending.cuts.states["blade"] = self._descending.cuts.states["tip"] = within(position)
        else:
            records = self._records
            records["profiles"] = profile_records([specimen])
            records["laws"] = law_records([specimen], self._law)
            records["free_air"] = 0

    def add_force(self, force: float) -> None:
        """Add ``force`` [N] to the tissue's along the cut; 0 removes it."""
        self._extra = self._records["extra"] = force

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
        self.forces = dict(self._added)
        if self._plane is not None:
            self._plane.advance(position, self.places["side"], angle)
            self._force = self._plane.force + self._extra
            self.forces["side"] += self._plane.side_force
        elif (plant := self._descending) is not None:
            level = min(max(self.places["height"], LOWEST), HIGHEST)
            path = np.array([[within(position), level, measured(angle)]])
            follow_levels(plant.cuts, plant.descents, self._slab, path, TICK, self._readings, self._vertical)
            self._force = float(self._readings["true_force"][0]) + self._extra
            self.forces["height"] += float(self._vertical[0])
        else:
            reading = feel(self._records, within(position), measured(angle), TICK)
            self._force = float(self._records[0].true_force)
            return reading
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
        if self._descending is not None:
            return float(self._descending.cuts.states["tip"][0])
        return float(self._records[0].states[0].tip)
