"""Wear of the blade: a fracture resistance that rises with the length that the blade has cut, an assumption."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import check_parameters, parameter
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.specimen import Specimen


@dataclass(frozen=True, kw_only=True)
class BladeWear:
    """Linear rise of R with the length cut: R (1 + ``blade_wear`` (``blade_used`` + y)) at y along the cut.

    The thesis used one kind of blade, No. 10 of stainless steel, and tells nothing of its wear or of when it was
    changed.  A blunter edge takes more force to start and to carry on a crack; here both rise alike.
    """

    blade_wear: float = parameter(
        0.0, unit="1/m", low=0.0, high=10.0, provenance="assumed",
        source="off; rise of R for each metre that the blade has cut: nothing measured it", sensitivity=(0.0, 1.0),
    )  # fmt: skip
    blade_used: float = parameter(
        0.0, unit="m", low=0.0, high=100.0, provenance="choice",
        source="a new blade; length that it has cut before",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)

    def factors(self) -> Array:
        """Return the fracture resistance over that of a new blade, along the cut, shape (301,) [1]."""
        return np.asarray(1.0 + self.blade_wear * (self.blade_used + SPACING * np.arange(N_POINTS)))

    def of(self, specimen: Specimen) -> Specimen:
        """Return the specimen as this blade meets it; itself without wear."""
        if self.blade_wear == 0.0:
            return specimen
        return dataclasses.replace(specimen, fracture_resistance=specimen.fracture_resistance * self.factors())
