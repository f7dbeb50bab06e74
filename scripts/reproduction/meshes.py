"""Mesh counts: Tables 4.3 and 4.12."""

from __future__ import annotations

from cutenv.tissue import CutModel
from cutenv.tissue.tables import table
from reproduction.rows import Comparison, exactly, hits

MODELS = {
    "3-D, 20 nodes": ("hex20", "solid"),
    "2-D, 8 nodes": ("quad8", "plane_stress"),
    "2-D, 4 nodes": ("quad4", "plane_stress"),
}
DIVISIONS = [(8, 15), (10, 24), (16, 30), (32, 60), (40, 75)]
CORRECTED = {("nodes", 0): 438, ("elements", 1): 240}  # the errata of Table 4.12


def mesh_counts(quick: bool) -> Comparison:
    """Compare elements, nodes and equations, exactly."""
    rows = []
    sizes, levels = table("4.3"), table("4.12")
    for row, (name, kind) in enumerate(MODELS.items()):
        model = CutModel(*kind)
        for what in ("elements", "nodes", "equations"):
            rows.append(exactly(f"{name}: {what}", sizes[f"n_{what}"][row], getattr(model, f"n_{what}")))
    for row, divisions in enumerate(DIVISIONS):
        model = CutModel(divisions=divisions)
        for what in ("elements", "nodes"):
            printed = levels[f"n_{what}"][row]
            corrected = CORRECTED.get((what, row), printed)
            erratum = "" if corrected == printed else f" (printed {printed:g})"
            name = f"level {row + 1}, {divisions[0]} x {divisions[1]}: {what}{erratum}"
            rows.append(exactly(name, corrected, getattr(model, f"n_{what}")))
    return Comparison(
        title="Mesh counts",
        source="Tables 4.3, 4.12",
        ours=f"{hits(rows)} equal, two errata corrected",
        tolerance="exact",
        rows=tuple(rows),
        notes=(*sizes.errata, *levels.errata[:2]),
    )
