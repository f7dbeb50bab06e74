"""The figures of the thesis, drawn anew from its tables and from virtual cuts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib import rc_context

from scripts.drawings.thesis import bead_motion, depth_from_film, experiments, fracture, models, speeds, xray_images
from scripts.drawings.thesis.style import STYLE

FIGURES: dict[str, Callable[[Path, bool], None]] = {
    "figure_3_2": experiments.desired_and_actual_speed,
    "figure_3_3": experiments.force_against_displacement,
    "figure_3_4": experiments.filtered_force,
    "figure_3_5": experiments.iteration_of_the_modulus,
    "figure_3_6": experiments.loading_segments_found,
    "figure_3_7_to_3_8": experiments.moduli_along_four_cuts,
    "figure_3_10_to_3_11": depth_from_film.depth_in_an_image,
    "figure_3_12_to_3_13": depth_from_film.moduli_with_depth,
    "figure_4_1": models.element_types,
    "figure_4_2": models.displacement_field,
    "figure_4_3_to_4_5": models.models_along_the_cut,
    "figure_4_6": models.incompressible_models,
    "figure_5_2_to_5_4": speeds.moduli_by_cut,
    "figure_5_5_to_5_9": speeds.moduli_by_speed,
    "figure_6_1_to_6_2": models.stages_of_fracture,
    "figure_6_3_to_6_4": fracture.resistance_by_length,
    "figure_6_5_to_6_7": fracture.forward_backward,
    "figure_7_2": xray_images.views,
    "figure_7_3": xray_images.grid_images,
    "figure_7_4": xray_images.radial_errors,
    "figure_7_5": xray_images.magnification,
    "figure_7_6_to_7_7": bead_motion.model_in_sections,
    "figure_7_8_to_7_9": bead_motion.bead_in_space,
    "figure_7_10_to_7_11": bead_motion.bead_against_model,
    "figure_7_12": bead_motion.numbers_of_beads,
    "figure_7_13": bead_motion.predicted_cuts,
    "figure_energy": fracture.energy_account,
}
"""Figures by name; each takes where to draw and whether to be quick."""

NOT_DRAWN = {  # Figures of chapters 2 to 7 that are not drawn anew, and why
    "2.1 to 2.4": "sketches of methods by others",
    "3.1, 3.9, 5.1, 7.1": "photographs of the apparatus; what the camera and the C-arms see is in 3.10, 3.11 and 7.2",
    "7.12": "lost: what is drawn is the layout that we fitted to Table 7.1",
}


def draw(name: str, folder: Path, quick: bool) -> Path:
    """Draw one figure into ``folder``, which is created if missing; return the path of the picture."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    with rc_context(STYLE):
        FIGURES[name](path, quick)
    return path


__all__ = ["FIGURES", "NOT_DRAWN", "draw"]
