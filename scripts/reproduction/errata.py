"""Contradictions within the thesis. The errata are stored with its tables, and nothing is claimed about them."""

from __future__ import annotations

import numpy as np

from cutenv.tissue import CutModel, tables
from cutenv.tissue.effective_modulus import linear_fit, power_fit
from cutenv.tissue.tables import table
from reproduction.models import MEAN_OVER, model
from reproduction.rows import Comparison, near

NEAREST_POISSON = 0.43  # with this ratio, plane strain over plane stress is as in Table 5.7


def strain_over_stress(poisson: float, integration: str) -> float:
    """Return the mean LEM in plane strain over that in plane stress, 8 nodes."""
    strain = CutModel("quad8", "plane_strain", poisson, integration=integration)
    return float(np.mean(model(poisson=poisson).convert_modulus(1.0, strain, MEAN_OVER)))


def errata(quick: bool) -> Comparison:
    """List every erratum, with the numbers of those that no other comparison shows."""
    other, inclined = table("5.7"), "lem_plane_stress_45_deg_Pa"
    depth_cm = table("5.5")[inclined] / table("5.6")[inclined]
    rows = [
        near("(5.3) coefficient, kPa", 24.21, power_fit().modulus_at_reference / 1e3, form=".2f"),
        near("(5.10) intercept, kPa", 49.59, linear_fit("5.7", angle_deg=45).intercept / 1e3, form=".3f"),
    ]
    for speed, depth in zip(table("5.5")["speed_cm_s"], depth_cm, strict=True):
        if np.isfinite(depth):
            what = f"depth of cut by Tables 5.5 and 5.6, 45 deg, {speed:.2f} cm/s, beside its mean, cm"
            rows.append(near(what, float(np.nanmean(depth_cm)), depth, form=".2f"))
    for angle_deg in (90, 45):
        columns = (f"lem_{formulation}_{angle_deg}_deg_Pa" for formulation in ("plane_strain", "plane_stress"))
        printed = float(np.divide(*(other[column] for column in columns)).mean())
        for nu, integration in ((0.499, "full"), (0.499, "reduced"), (NEAREST_POISSON, "full")):
            what = f"Table 5.7, {angle_deg} deg: plane strain over plane stress, nu = {nu:g}, {integration} integration"
            rows.append(near(what, printed, strain_over_stress(nu, integration), form=".3f"))
    known = tables.errata()
    return Comparison(
        title="Errata of the thesis: contradictions that claim nothing",
        source="where each note says",
        ours=f"{len(known)} errata",
        tolerance="not a target",
        rows=tuple(rows),
        notes=tuple(f"Table {number}. {text}" for number, text in known),
    )
