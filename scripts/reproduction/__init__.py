"""The thesis's numbers beside ours: a module for each group of tables."""

from __future__ import annotations

from collections.abc import Callable

from reproduction import (
    beads,
    conditions,
    cutting,
    derived,
    drawn_tables,
    elements,
    errata,
    friction,
    measuring,
    meshes,
    models,
    moduli,
    worked_check,
)
from reproduction.rows import Comparison, Row

COMPARISONS: dict[str, Callable[[bool], Comparison]] = {
    "mesh-counts": meshes.mesh_counts,
    "elements": elements.closed_forms,
    "unit-stiffness": models.unit_stiffness,
    "plane-strain": models.plane_strain,
    "poisson": models.poisson,
    "bricks": models.bricks,
    "four-nodes": models.four_nodes,
    "incompressible": models.incompressible,
    "element-size": models.element_size,
    "beads": beads.beads,
    "averages": moduli.averages,
    "equations": moduli.equations,
    "fits": moduli.fits,
    "law-of-speed": moduli.law_of_speed,
    "constants": moduli.constants,
    "livers-by-cut": drawn_tables.cuts_by_cuts,
    "livers-5-5": drawn_tables.average_tables("5.5"),
    "livers-5-6": drawn_tables.average_tables("5.6"),
    "livers-equations": drawn_tables.equations,
    "livers-6-1": drawn_tables.resistance,
    "eta90": derived.eta90,
    "modulus": measuring.modulus_comes_back,
    "resistance": measuring.resistance_comes_back,
    "resistance-open": measuring.resistance_of_open_records,
    "resistance-livers": measuring.resistance_of_livers,
    "friction": friction.friction_comes_back,
    "conditions": conditions.real_conditions,
    "apparent": measuring.apparent_reads_low,
    "units": cutting.units_fall_with_speed,
    "depth": cutting.force_follows_depth,
    "forward-backward": cutting.forward_backward,
    "energy": cutting.energy_identity,
    "law-units": worked_check.units_and_share,
    "law-force": worked_check.peak_and_slope,
    "law-energy": worked_check.lag_and_energy,
    "errata": errata.errata,
}
"""Comparisons by short name; each takes whether to be quick."""

__all__ = ["COMPARISONS", "Comparison", "Row"]
