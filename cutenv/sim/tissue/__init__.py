"""Finite-element model of the slab, measured moduli and toughness, and specimens."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv._base.imports import import_when_used
from cutenv.sim.tissue.description import TissueDescription, load_description, measured_liver
from cutenv.sim.tissue.effective_modulus import local_effective_modulus, quasi_static_modulus
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.specimen import Specimen, draw_liver
from cutenv.sim.tissue.tables import measured_fracture_resistance

if TYPE_CHECKING:
    from cutenv.sim.tissue.cut_model import CutModel
    from cutenv.sim.tissue.path_model import PathModel
    from cutenv.sim.tissue.steered_model import SteeredModel

__all__ = [
    "CutModel",
    "Layers",
    "PathModel",
    "Specimen",
    "SteeredModel",
    "TissueDescription",
    "draw_liver",
    "load_description",
    "local_effective_modulus",
    "measured_fracture_resistance",
    "measured_liver",
    "quasi_static_modulus",
]

__getattr__ = import_when_used(
    __name__,
    {
        "CutModel": "cutenv.sim.tissue.cut_model",
        "PathModel": "cutenv.sim.tissue.path_model",
        "SteeredModel": "cutenv.sim.tissue.steered_model",
    },
)
