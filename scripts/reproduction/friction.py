"""Recovery of friction: its share of the measured resistance, from the return stroke."""

from __future__ import annotations

import itertools
from dataclasses import replace

from cutenv.measurement import estimate_fracture_resistance
from reproduction.measuring import there_and_back, watched
from reproduction.rows import Comparison, Row, near
from reproduction.virtual_cuts import ANGLES_DEG, SEVEN_SPEEDS, cm_s

SHARES = (0.0, 0.1, 0.2, 0.4)
LENGTHS = {"2 cm": (1.0, 4.0), "bulge": (1.0, 2.0, 4.0)}  # by tissue [inch]
POINTS = 3.0


def share_found(kind: str, inches: float, speed: float, angle_deg: float, share: float) -> float:
    """Return friction per depth of the return stroke over the corrected resistance of the same record [%]."""
    cut = there_and_back(kind, inches, speed, angle_deg, friction_share=share)
    found = estimate_fracture_resistance(cut.trace)
    return 100.0 * found.friction_per_depth / found.corrected


def friction_comes_back(quick: bool) -> Comparison:
    """Compare every share, speed and angle; for cuts of several lengths the one with the largest error."""
    speeds, shares = (SEVEN_SPEEDS[3::3], SHARES[::3]) if quick else (SEVEN_SPEEDS, SHARES)
    rows: list[Row] = []
    for kind, share, angle_deg, speed in watched(
        itertools.product(LENGTHS, shares, ANGLES_DEG, speeds), "friction in, friction out"
    ):
        lengths = LENGTHS[kind][:1] if quick else LENGTHS[kind]
        found = {inches: share_found(kind, inches, speed, angle_deg, share) for inches in lengths}
        worst = max(found, key=lambda inches: abs(found[inches] - 100.0 * share))
        what = f"{kind}, {cm_s(speed)}, {angle_deg:g} deg: share of friction, % (worst: {worst:g} inch)"
        row = near(what, 100.0 * share, found[worst], absolute=POINTS, form=".2f")
        rows.append(replace(row, reference=f"{100.0 * share:g}", tolerance=f"{POINTS:g} points"))
    off = max(abs(float(row.ours) - float(row.reference)) for row in rows)
    return Comparison(
        title="Friction in, friction out: shares of 0 to 40 %, 1 to 4 inches, all speeds, both angles",
        source="section 6.2, Figures 6.5-6.7",
        ours=f"within {off:.1f} points",
        tolerance=f"{POINTS:g} points",
        rows=tuple(rows),
    )
