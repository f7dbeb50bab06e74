"""Specimen that is laid on the bench of an imitated rig."""

from __future__ import annotations

from dataclasses import dataclass

from cutenv.tissue.description import TissueDescription
from cutenv.tissue.layers import Layers
from cutenv.tissue.lines import CutLine
from cutenv.tissue.specimen import Specimen


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
