"""The figures of the thesis, drawn anew from its tables and from virtual cuts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib import rc_context

from thesis_figures import experiments, fracture, models, speeds
from thesis_figures.style import STYLE

FIGURES: dict[str, Callable[[Path, bool], None]] = {
    "figure_3_2": experiments.desired_and_actual_speed,
    "figure_3_3": experiments.force_against_displacement,
    "figure_3_4": experiments.filtered_force,
    "figure_3_5": experiments.iteration_of_the_modulus,
    "figure_3_6": experiments.loading_segments_found,
    "figure_3_7_to_3_8": experiments.moduli_along_four_cuts,
    "figure_4_1": models.element_types,
    "figure_4_2": models.displacement_field,
    "figure_4_3_to_4_5": models.models_along_the_cut,
    "figure_4_6": models.incompressible_models,
    "figure_5_2_to_5_4": speeds.moduli_by_cut,
    "figure_5_5_to_5_9": speeds.moduli_by_speed,
    "figure_6_1_to_6_2": models.stages_of_fracture,
    "figure_6_3_to_6_4": fracture.resistance_by_length,
    "figure_6_5_to_6_7": fracture.forward_backward,
    "figure_energy": fracture.energy_account,
}
"""Figures by name; each takes where to draw and whether to be quick."""


def draw(name: str, folder: Path, quick: bool) -> Path:
    """Draw one figure into ``folder``, which is created if missing; return the path of the picture."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    with rc_context(STYLE):
        FIGURES[name](path, quick)
    return path


__all__ = ["FIGURES", "draw"]
