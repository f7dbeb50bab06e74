"""Realistic conditions: results of single cuts when depth, zero or the way back are not as in a simulation."""

from __future__ import annotations

from measure_recovery import CONDITIONS, PROMISED, SPEEDS, cut_specimens, recovery

from reproduction.rows import Comparison, hits, holds

LENGTH = 0.11  # of the cuts [m]
QUANTITIES = ("R", "LEM", "friction's share of R")


def real_conditions(quick: bool) -> Comparison:
    """Compare R, LEM and friction with the truth under every condition: rows for the 95th percentiles of the errors."""
    cuts = cut_specimens(LENGTH, 8 if quick else 24, seed=1, speeds=SPEEDS[3:])
    rows = []
    for name, promised in PROMISED.items():
        found = recovery(cuts, CONDITIONS[name])
        errors = (found.resistance, found.modulus, found.friction)
        for quantity, (_, high), most in zip(QUANTITIES, errors, promised, strict=True):
            limit = f"{100 * most:.3g} %"
            what = f"{name.strip()}, {found.cuts} cuts: {quantity}, 95th percentile of the error"
            rows.append(holds(what, limit, f"{100 * high:.1f} %", high <= most, tolerance=limit))
    return Comparison(
        title="R, LEM and friction of cuts of 11 cm with an offset, a drift, depth errors, no rest, no return stroke",
        source="(3.1), (3.2), (6.1)-(6.4)",
        ours=f"{hits(rows)} within what is promised",
        tolerance="95th percentile",
        rows=tuple(rows),
    )
