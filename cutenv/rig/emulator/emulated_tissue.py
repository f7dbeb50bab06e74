"""Tissue on the emulated rig: the cutting law under the motor's blade, measured by the simulator's force sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._engine.jit import njit
from cutenv._engine.lanes import first_row
from cutenv.cutting.dtypes import TICK, new_state
from cutenv.cutting.lanes import lane_views
from cutenv.cutting.motion import STRAIGHT, Moving
from cutenv.cutting.parameters import LawParameters, law_records, profile_records
from cutenv.cutting.row import begin, plain_views, put, take_tissue
from cutenv.cutting.sensor import SensorParameters, measure, sensor_records
from cutenv.cutting.update import cut_row
from cutenv.plant.simulator import ANGLE_RANGE
from cutenv.rig.errors import RigError
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.layers import Layers
from cutenv.tissue.lines import CutLine
from cutenv.tissue.specimen import LENGTH, SPACING, Specimen

CLAMP_TOLERANCE = 0.002
"""Greatest distance of the blade from the clamp at which a specimen can be laid [m]."""

_TISSUE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *STRAIGHT.cut.descr,  # its drive is unused: the motor is emulated
            ("free_air", "i8"),
            ("extra", "f8"),  # [N] added force
            ("true_force", "f8"),  # [N] on the blade
        ],
    )
)

_cut_row, _SCALARS = cut_row(STRAIGHT), STRAIGHT.scalars


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
        views = lane_views(tissue.lanes, tissue.motions, 1, _SCALARS)
        _cut_row(row, Moving(first_row(tissue.lanes), views, tissue.motions, tissue.motions), tissue.profiles, dt)
        put(row, plain, 0, 0)
        force += row.force[0]
    tissue.true_force = force
    return measure(tissue.rows, tissue.sensors, force, state.tick - 1)


@dataclass(frozen=True, kw_only=True)
class Laid:
    """Specimen on the bench, by its key or as an object."""

    seed: int = 0
    episode: int = 0
    specimen_class: str = "liver"
    tissue: TissueDescription | None = None
    specimen: Specimen | None = None
    """Specimen that is given instead of drawn; seed and episode then only select the sensor's noise."""
    layers: Layers | None = None
    """Layers over its depth, for a rig with a height axis; default one tissue throughout."""
    line: CutLine | None = None
    """Line along which its profiles lie, for a rig with an axis to the side; default the axis of the slab."""

    def drawn(self) -> Specimen:
        """Return the specimen; raises ValueError if seed, episode or class is invalid."""
        if self.specimen is not None:
            return self.specimen
        return Specimen.drawn(self.seed, self.episode, specimen_class=self.specimen_class, tissue=self.tissue)


class EmulatedTissue:
    """Specimen, blade and force sensor, a millisecond at a time.

    Parameters
    ----------
    sensor : SensorParameters, optional
        Force sensor; as in the simulator by default.
    law : LawParameters, optional
        Cutting law; as in the simulator by default.
    """

    def __init__(self, sensor: SensorParameters | None = None, law: LawParameters | None = None) -> None:
        self._sensor, self._law = sensor or SensorParameters(), law
        self._records = np.zeros(1, _TISSUE)
        self.laid: Laid | None = None
        self._records["states"] = new_state(1, math.pi / 2)
        self._records["sensors"] = sensor_records([self._sensor], [0], [0])
        self._records["free_air"] = 1

    def mount(self, specimen: Specimen, laid: Laid, *, position: float, angle: float) -> None:
        """Clamp a fresh specimen with its crack at the blade, which must be at the clamp.

        Parameters
        ----------
        specimen : Specimen
            Specimen to be cut.
        laid : Laid
            Key of the specimen; seed and episode select the sensor's noise, as in the simulator.
        position, angle : float
            Position [m] and angle [rad] of the blade.

        Raises
        ------
        RigError
            If the blade is not at the clamp.
        """
        if abs(position) > CLAMP_TOLERANCE:
            raise RigError(
                f"the blade stands at {1e3 * position:.1f} mm: drive it to the clamp (within "
                f"{1e3 * CLAMP_TOLERANCE:g} mm) "
                "before a specimen is laid."
            )
        records = np.zeros(1, _TISSUE)
        records["states"] = new_state(1, measured(angle))
        records["states"]["blade"] = records["states"]["tip"] = within(position)
        records["profiles"] = profile_records([specimen])
        records["laws"] = law_records([specimen], self._law)
        records["sensors"] = sensor_records([self._sensor], [laid.seed], [laid.episode])
        records["extra"] = self._records["extra"]
        self._records = records
        self.laid = laid

    def take_away(self) -> None:
        """Remove the specimen: the blade is in free air, without force."""
        self._records["free_air"] = 1
        self.laid = None

    def add_force(self, force: float) -> None:
        """Add ``force`` [N] to the tissue's; 0 removes it."""
        self._records["extra"] = force

    def add_across(self, axis: str, force: float) -> None:
        """Raise ValueError: without an axis across the cut there is no force along it."""
        raise ValueError(f"this rig has no {axis} axis. Start the emulator with --{axis}.")

    def advance(self, position: float, angle: float) -> float:
        """Move to ``position`` [m] and ``angle`` [rad] in one millisecond; return the sensor's reading [N]."""
        return feel(self._records, within(position), measured(angle), TICK)

    @property
    def true_force(self) -> float:
        """Force of the tissue on the blade, back toward the clamp [N]."""
        return float(self._records[0].true_force)

    @property
    def tip(self) -> float:
        """Position of the crack tip [m]."""
        return float(self._records[0].states[0].tip)


def within(position: float) -> float:
    """Limit a position [m] to the part of the carriage's travel in which there is tissue."""
    return min(max(position, 0.0), LENGTH - SPACING)


def measured(angle: float) -> float:
    """Limit an angle [rad] to the range for which the law was measured."""
    return min(max(angle, ANGLE_RANGE[0]), ANGLE_RANGE[1])
