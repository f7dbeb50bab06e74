"""Measurement by cameras and X-rays of a cut.

Depth of cut from video, beads tracked in two X-ray views, and their displacements against the model (extra ``vision``).

The specimen's frame is that of :class:`cutenv.sim.tissue.cut_model.CutModel`: x across the cut line, y along it from
the clamp, z up from the plate [m].

May import: task, records, sim.
"""

from cutenv.vision.bead_tracks import BeadTracks
from cutenv.vision.field_comparison import (
    FieldComparison,
    FilmedMeasurement,
    MeanModulus,
    ZoneModuli,
    compare_displacements,
    compare_field,
    estimate_zone_moduli,
    even_borders,
    measure_filmed_cut,
    zones_as_measured,
)

__all__ = [
    "BeadTracks",
    "FieldComparison",
    "FilmedMeasurement",
    "MeanModulus",
    "ZoneModuli",
    "compare_displacements",
    "compare_field",
    "estimate_zone_moduli",
    "even_borders",
    "measure_filmed_cut",
    "zones_as_measured",
]
