"""From a recorded cut to the properties of its tissue; knows records and tissue, never the simulator."""

from cutenv.measurement.depth import DepthProfile
from cutenv.measurement.flaws import Flaw, flaws
from cutenv.measurement.fracture import FractureEstimate, estimate_fracture_resistance
from cutenv.measurement.modulus import ModulusEstimate, estimate_local_effective_moduli, iterate_modulus
from cutenv.measurement.return_stroke import ReturnStroke, fit_return_stroke
from cutenv.measurement.segments import Segment, loading_segments

__all__ = [
    "DepthProfile",
    "Flaw",
    "FractureEstimate",
    "ModulusEstimate",
    "ReturnStroke",
    "Segment",
    "estimate_fracture_resistance",
    "estimate_local_effective_moduli",
    "fit_return_stroke",
    "flaws",
    "iterate_modulus",
    "loading_segments",
]
