"""A simulated plant whose blade also moves up and down."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range
from cutenv.cutting.descending_cut import account_of_descending, hold_descending
from cutenv.cutting.descending_row import HIGHEST, LOWEST
from cutenv.cutting.descent import DescentParameters, descent_records, layered_profiles
from cutenv.cutting.drive import Drive, Rig
from cutenv.cutting.dtypes import READING, new_state
from cutenv.cutting.parameters import LawParameters, law_records
from cutenv.cutting.sensor import SensorParameters, sensor_records
from cutenv.cutting.simulate import Physics
from cutenv.plant.simulator import ANGLE_RANGE, MAX_SPEED, check_angle
from cutenv.tissue.layers import Layers
from cutenv.tissue.specimen import LENGTH, SPACING, Specimen


class DescendingPlant:
    """A simulated specimen in layers, cut by a blade that is driven along the cut and up and down.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    layers : Layers, optional
        Its layers over the depth; default those of its tissue, where they were measured, or one tissue throughout.
    drive : Rig, optional
        Drive along the cut.
    sensor : SensorParameters, optional
        Noise, resolution and delay of the force sensor.
    law : LawParameters, optional
        Constants of the cutting law.
    descent : DescentParameters, optional
        Constants of the vertical motion.
    seed, episode : int
        Random key of the sensor's noise.
    angle : float
        Angle at the start [rad].
    depth : array of shape (301,), optional
        Depth of cut at level 0 as a lab has measured it beforehand [m]; default the true one.
    level : float
        Level of the blade at the start [m], upwards, -0.025 to 0.025.

    Attributes
    ----------
    cuts : Physics
        The hidden state, each part of shape (1,).
    descents : Records
        The vertical motion, :data:`~cutenv.cutting.descent.DESCENT`, shape (1,).
    vertical_force : array, shape (ticks,)
        True force of the tissue on the blade, upwards, during the last :meth:`advance` [N].
    """

    def __init__(
        self,
        specimen: Specimen,
        *,
        layers: Layers | None = None,
        drive: Drive | None = None,
        sensor: SensorParameters | None = None,
        law: LawParameters | None = None,
        descent: DescentParameters | None = None,
        seed: int = 0,
        episode: int = 0,
        angle: float = ANGLE_RANGE[1],
        depth: Array | None = None,
        level: float = 0.0,
    ) -> None:
        check_angle(angle)
        in_range("level", level, LOWEST, HIGHEST, "m", "5 mm below level 0 is -0.005.")
        self.specimen = specimen
        self.depth = specimen.depth if depth is None else depth
        self._slab = specimen.tissue.slab()
        self.descents = descent_records([specimen], layers or specimen.tissue.layers, descent)
        self.descents["level"] = self.descents["settled"] = self.descents["engaged"] = level
        self.descents["floor"][:, 0] = level
        self.cuts = Physics(
            new_state(1, angle),
            layered_profiles(self.descents, self._slab),
            law_records([specimen], law),
            (drive or Rig()).records(travel=LENGTH - SPACING),
            sensor_records([sensor or SensorParameters()], [seed], [episode]),
        )
        self.vertical_force: Array = np.zeros(0)

    @property
    def level(self) -> float:
        """Level of the blade's lower end [m], upwards; 0 cuts as deep as the specimen's profile says."""
        return float(self.descents["level"][0])

    @property
    def floor(self) -> Array:
        """Depth of the cut below the surface at each point [m], shape (301,); 0 where nothing is cut."""
        cut: Array = np.minimum(self.descents["surface"][0] - self.descents["floor"][0], self.specimen.thickness)
        return cut

    def advance(self, speed: float, angle: float, ticks: int, descent_speed: float = 0.0) -> StructArray:
        """Command speeds along the cut and downwards [m/s] and an angle [rad] for ``ticks`` milliseconds.

        Returns
        -------
        Records
            Readings (:data:`cutenv.cutting.dtypes.READING`), shape (ticks,); the force along the cut is measured.

        Raises
        ------
        ValueError
            If a command is out of range, or ``ticks`` is less than 1.
        """
        in_range("speed", speed, -MAX_SPEED, MAX_SPEED, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
        in_range(
            "descent_speed",
            descent_speed,
            -MAX_SPEED,
            MAX_SPEED,
            "m/s",
            "Speeds are in m/s: 5 mm/s is 0.005.",
        )
        check_angle(angle)
        if ticks < 1:
            raise ValueError(f"ticks = {ticks} is less than 1: give a whole number of milliseconds.")
        readings, self.vertical_force = np.zeros(ticks, READING), np.zeros(ticks)
        hold_descending(
            self.cuts, self.descents, self._slab, speed, angle, descent_speed, readings, self.vertical_force
        )
        return readings

    def energy(self) -> dict[str, float]:
        """Return the energies since the start [J]: work, stored, fracture, friction, loss, ledger, and residual."""
        return account_of_descending(self.cuts, self.descents)._asdict()
