"""Tissue properties from recorded cuts, independent of the simulator."""

from cutenv.records.measurement.calibration import calibrate, measure_cuts, tissue_of
from cutenv.records.measurement.constant_speed import SpeedTracking, speed_tracking
from cutenv.records.measurement.depth import DepthProfile
from cutenv.records.measurement.fracture import FractureEstimate, estimate_fracture_resistance
from cutenv.records.measurement.initiation import InitiationEstimate, estimate_initiation, initiation_excess
from cutenv.records.measurement.measured_cut import MeasuredCut, measure_cut
from cutenv.records.measurement.modulus import ModulusEstimate, estimate_local_effective_moduli, iterate_modulus
from cutenv.records.measurement.prediction import LeftOutCut, leave_one_out
from cutenv.records.measurement.segments import Segment, filtered, loading_segments
from cutenv.records.measurement.signal_quality import QualityIssue, quality_issues
from cutenv.records.measurement.speed_dependence import SpeedDependence, fit_speed_dependence
from cutenv.records.measurement.strokes import ReturnStroke, fit_return_stroke
from cutenv.records.measurement.unit_resistance import UnitResistances, estimate_unit_resistances
from cutenv.records.measurement.wear import WearEstimate, blade_wear, fit_wear
from cutenv.records.measurement.zero import SensorZero, zeroed

__all__ = [
    "DepthProfile",
    "FractureEstimate",
    "InitiationEstimate",
    "LeftOutCut",
    "MeasuredCut",
    "ModulusEstimate",
    "QualityIssue",
    "ReturnStroke",
    "Segment",
    "SensorZero",
    "SpeedDependence",
    "SpeedTracking",
    "UnitResistances",
    "WearEstimate",
    "blade_wear",
    "calibrate",
    "estimate_fracture_resistance",
    "estimate_initiation",
    "estimate_local_effective_moduli",
    "estimate_unit_resistances",
    "filtered",
    "fit_return_stroke",
    "fit_speed_dependence",
    "fit_wear",
    "initiation_excess",
    "iterate_modulus",
    "leave_one_out",
    "loading_segments",
    "measure_cut",
    "measure_cuts",
    "quality_issues",
    "speed_tracking",
    "tissue_of",
    "zeroed",
]
