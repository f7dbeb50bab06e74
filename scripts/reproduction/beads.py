"""Displacement of beads beside the cut: Table 7.1."""

from __future__ import annotations

import numpy as np

from cutenv.tissue import CutModel
from cutenv.tissue.tables import table
from reproduction.elements import mesh_of
from reproduction.rows import Comparison, near

# A fit, found by hand: of the layout only the distance of about 1 cm between beads is known.
TIP = 0.04  # cut length [m]
TIP_DISPLACEMENT = 0.0092  # [m]
FROM_THE_LINE = (0.02, 0.03)  # of beads 1 to 4 and of beads 5 to 8 [m]
FROM_THE_CLAMP = (0.02, 0.03, 0.04, 0.05)  # [m]


def displacement_of_beads() -> np.ndarray:
    """Return the displacement of the eight beads in 8-node plane stress [m], shape (8,)."""
    model = CutModel()
    field = model.displacement(TIP, model.stiffness(TIP) * TIP_DISPLACEMENT, modulus=1.0, thickness=1.0)
    places = np.array([(x, y) for x in FROM_THE_LINE for y in FROM_THE_CLAMP])
    probe = mesh_of(model.element, (8, 15)).basis.probes(places.T)
    return np.hypot(*(probe @ field.ravel()).reshape(2, -1))


def beads(quick: bool) -> Comparison:
    """Compare Table 7.1: its finite-element column with ours; its own experiment is only shown."""
    data, ours = table("7.1"), displacement_of_beads()
    columns = (data["bead"], data["fem_displacement_cm"], data["experimental_displacement_cm"])
    fitted, measured = [], []
    for bead, fem, experiment, own in zip(*columns, 100 * ours, strict=True):
        fitted.append(near(f"bead {bead:g}, fit to the finite elements, cm", fem, own, absolute=0.02, form=".2f"))
        measured.append(near(f"bead {bead:g}, the table's own finite elements, cm", experiment, fem, form=".2f"))
    worst = np.abs(100 * ours - data["fem_displacement_cm"]).max()
    return Comparison(
        title="Beads beside the cut, finite elements (a fit: four free numbers for eight values)",
        source="Table 7.1",
        ours=f"within {10 * worst:.1f} mm",
        tolerance="0.2 mm",
        rows=(*fitted, *measured),
        notes=(
            f"Layout assumed: beads 1 to 4 lie {100 * FROM_THE_LINE[0]:g} cm beside the line, 5 to 8 "
            f"{100 * FROM_THE_LINE[1]:g} cm, both rows at {100 * FROM_THE_CLAMP[0]:g} to "
            f"{100 * FROM_THE_CLAMP[-1]:g} cm from the clamp; "
            f"the tip at {100 * TIP:g} cm moves by {1000 * TIP_DISPLACEMENT:g} mm.",
            *data.errata,
        ),
    )
