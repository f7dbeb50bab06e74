"""The derived constant of the law: eta90, from the spacing of the segments of Table 4.1."""

from __future__ import annotations

import json
import math

import numpy as np

from cutenv._base import resources
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.tables import table
from scripts.derivations import eta90 as derive_eta90
from scripts.validation.thesis.rows import Found, check, holds, near

EXPECTED = (0.25, 0.40)  # range of an independent estimate


@check(
    "eta90",
    "eta90, excess of the force that starts a crack run",
    "spacing of Table 4.1",
    "5 % of the unit; 0.25 to 0.40",
    notes=("Biased upward: the table lists only significant segments. Derived by scripts/derivations/eta90.py.",),
)
def eta90(quick: bool) -> Found:
    """Compare the stored value, with its interval, and its unit length in the cut of Table 4.1."""
    kept = json.loads(resources.path("derived/eta90.json").read_text())
    value, (low, high) = kept["value"], kept["interval_95"]
    data = table("4.1")
    places = data["distance_cm"] / 100.0
    spacing = float(np.diff(places).mean())
    tissue = measured_liver()
    ratio = tissue.local_effective_modulus(derive_eta90.SPEED, math.pi / 2) / tissue.intercept_90
    modulus = float(data["lem_quad8_plane_stress_Pa"].mean()) / ratio
    length = derive_eta90.unit_length(value, modulus, float(places[0]), float(places[-1]))
    rows = [
        near("mean unit length in the cut of Table 4.1, mm", 1e3 * spacing, 1e3 * length, relative=0.05, form=".2f"),
        holds(
            "eta90 in the range that is expected",
            f"{EXPECTED[0]:g} to {EXPECTED[1]:g}",
            f"{value:g}",
            EXPECTED[0] <= value <= EXPECTED[1],
            tolerance="range",
        ),
        holds(
            "its 95 % interval, of the 8 spacings and their moduli",
            "contains it",
            f"{low:g} to {high:g}",
            low <= value <= high,
            tolerance="range",
        ),
    ]
    return rows, f"{value:g} ({low:g} to {high:g}); unit {1e3 * length:.1f} mm for {1e3 * spacing:.1f}"
