"""Strain energy of the elements: together they hold what the blade put in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cutenv.tissue import CutModel

FORCE, MODULUS, DEPTH, TIP = 5.0, 48.0e3, 0.01, 0.05

MODELS: dict[str, dict[str, Any]] = {
    "quad8": {},
    "quad4": {"element": "quad4"},
    "plane strain": {"formulation": "plane_strain"},
    "hex20": {"element": "hex20", "formulation": "solid"},
    "reduced": {"integration": "reduced"},
    "mixed": {"element": "quad8_mixed", "formulation": "plane_strain"},
    "mixed, stiffer right": {
        "element": "quad8_mixed",
        "formulation": "plane_strain",
        "relative_modulus": np.repeat([1.0, 3.0], 60),
    },
    "stiffer right": {"relative_modulus": np.repeat([1.0, 3.0], 60)},
}


def check_energy_closes(model: CutModel, poisson: float) -> None:
    """The elements' energies add up to half of force times displacement of the tip."""
    displacement = model.displacement(TIP, FORCE, MODULUS, DEPTH)
    twin = CutModel(**{name: getattr(model, name) for name in ("element", "formulation")}, poisson=poisson)
    reader = model if poisson == model.poisson else twin
    volume = model.width * model.length * DEPTH / model.n_elements
    held = volume * reader.strain_energy_density(displacement, MODULUS).sum()
    assert held == pytest.approx(0.5 * FORCE**2 / (model.stiffness(TIP) * MODULUS * DEPTH), rel=1e-10)


@pytest.mark.parametrize("name", MODELS)
def test_elements_hold_the_work_of_the_blade(name: str) -> None:
    check_energy_closes(CutModel(**MODELS[name]), 0.3)


def test_the_incompressible_element_holds_the_work_of_the_blade() -> None:
    check_energy_closes(CutModel("quad8_mixed", "plane_strain", 0.5), 0.5)


@pytest.mark.parametrize("name", ["quad8", "mixed"])
def test_another_poisson_ratio_than_the_field_s_is_noticed(name: str) -> None:
    with pytest.raises(AssertionError):
        check_energy_closes(CutModel(**MODELS[name]), 0.35)


def test_energy_is_mirror_symmetric() -> None:
    model = CutModel()
    density = model.strain_energy_density(model.displacement(TIP, FORCE, MODULUS, DEPTH), MODULUS).reshape(8, 15)
    np.testing.assert_allclose(density, density[::-1], rtol=1e-9)
    assert density.argmax() in (3 * 15 + 4, 3 * 15 + 5, 4 * 15 + 4, 4 * 15 + 5)  # at the tip


def test_a_displacement_of_another_mesh_is_refused() -> None:
    with pytest.raises(ValueError, match="give one of each node"):
        CutModel().strain_energy_density(np.zeros((10, 2)), MODULUS)
