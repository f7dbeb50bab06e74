"""A simulated plant whose blade also moves up and down."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range
from cutenv.cutting.descent import (
    DESCENDING,
    HIGHEST,
    LOWEST,
    DescentParameters,
    descent_records,
    layered_profiles,
    shared_record,
)
from cutenv.plant.simulator import MAX_SPEED, SimulatedPlant
from cutenv.tissue.layers import Layers
from cutenv.tissue.specimen import LENGTH, SPACING, Specimen


class DescendingPlant(SimulatedPlant):
    """A simulated specimen in layers, cut by a blade that is driven along the cut and up and down.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    layers : Layers, optional
        Its layers over the depth; default those of its tissue, where they were measured, or one tissue throughout.
    descent : DescentParameters, optional
        Constants of the vertical motion.
    level : float
        Level of the blade at the start [m], upwards, -0.025 to 0.025.
    **keywords
        Those of :class:`~cutenv.plant.SimulatedPlant`; ``depth`` is that of a blade at level 0.
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
        """The vertical motion, :data:`~cutenv.cutting.descent.DESCENT`, shape (1,)."""
        descents: StructArray = self.cuts["motions"][0]
        return descents

    @property
    def vertical_force(self) -> Array:
        """True force of the tissue on the blade, upwards, during the last :meth:`advance`, shape (ticks,) [N]."""
        return self._across

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
            If a command is out of range, or ``ticks`` is no whole number from 1.
        """
        return self._advance(speed, angle, ticks, descent_speed)
