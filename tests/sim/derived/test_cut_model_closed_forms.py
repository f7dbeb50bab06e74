"""Closed forms, constitutive matrices of Appendix A beside scikit-fem, and the energy of the elements."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack
from scipy.sparse.linalg import spsolve
from skfem import ElementVector, FacetBasis, LinearForm
from skfem.models.elasticity import linear_stress

from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.elasticity import elastic_form, lame_parameters
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.tip_response import stiffness_matrix
from scripts.validation.thesis.constitutive import constitutive_matrix
from scripts.validation.thesis.elements import KELVIN, model

Array = NDArray[np.float64]
LENGTH = 0.15
KINDS = {**ELEMENT_KINDS, **{f"{name} reduced": ELEMENT_KINDS[name].reduced() for name in ("quad8", "hex20")}}


def small_mesh(element: str) -> CutMesh:
    kind = KINDS[element]
    return CutMesh(kind=kind, divisions=(4, 5, 2)[: kind.dim], size=(0.08, LENGTH, 0.02)[: kind.dim])


def pull_on_the_end(mesh: CutMesh, constraints: csr_array, stiffness: csr_array, *, right_half_only: bool) -> Array:
    """Displacement under a unit traction along +y at the free end, at unit modulus; shape (n_nodes, dim)."""
    low = 0.0 if right_half_only else -np.inf
    end = mesh.skfem_mesh.facets_satisfying(lambda x: np.isclose(x[1], LENGTH) & (x[0] > low), boundaries_only=True)
    basis = FacetBasis(mesh.skfem_mesh, ElementVector(mesh.kind.element()), facets=end, intorder=4)
    load = np.zeros(mesh.n_unknowns)
    load[: mesh.nodes.size] = LinearForm(lambda v, w: v[1]).assemble(basis)
    k = (constraints.T @ stiffness @ constraints).tocsc()
    return np.asarray(constraints @ spsolve(k, constraints.T @ load))[: mesh.nodes.size].reshape(mesh.nodes.shape)


def check_bar(mesh: CutMesh, poisson: float) -> None:
    """Without lateral contraction the clamp does not disturb a column: u_y = traction y / modulus."""
    formulation = "solid" if mesh.dim == 3 else "plane_stress"
    u = pull_on_the_end(mesh, mesh.constraints(), stiffness_matrix(mesh, formulation, poisson), right_half_only=False)
    exact = np.zeros_like(u)
    exact[:, 1] = mesh.nodes[:, 1]
    assert np.abs(u - exact).max() < 1e-10 * LENGTH


@pytest.mark.parametrize("element", KINDS)
def test_a_column_without_contraction_stretches_as_a_bar(element: str) -> None:
    check_bar(small_mesh(element), poisson=0.0)
    with pytest.raises(AssertionError):
        check_bar(small_mesh(element), poisson=0.3)


def check_two_bars(mesh: CutMesh, constraints: csr_array) -> None:
    """Cut through and pulled on its right half alone, that half stretches as a bar and the other rests."""
    formulation = "solid" if mesh.dim == 3 else "plane_stress"
    u = pull_on_the_end(mesh, constraints, stiffness_matrix(mesh, formulation, 0.0), right_half_only=True)
    left, right = mesh.pairs.T
    exact = np.zeros_like(u)
    is_right = mesh.nodes[:, 0] > 0
    is_right[right] = True
    exact[is_right, 1] = mesh.nodes[is_right, 1]
    assert np.abs(u - exact).max() < 1e-10 * LENGTH
    assert u[right, 1] - u[left, 1] == pytest.approx(mesh.nodes[left, 1], abs=1e-10 * LENGTH)


@pytest.mark.parametrize("element", KINDS)
def test_the_faces_of_a_specimen_cut_through_slide_without_friction(element: str) -> None:
    mesh = small_mesh(element)
    check_two_bars(mesh, mesh.constraints(mesh.divisions[1]))
    with pytest.raises(AssertionError):
        check_two_bars(mesh, mesh.constraints())


def free_to_contract(mesh: CutMesh) -> csr_array:
    """The clamp holds the specimen along the line, and across it on the line alone: it stands on rollers."""
    rollers = np.flatnonzero((mesh.half_steps[:, 1] == 0) & (mesh.half_steps[:, 0] != 0)) * mesh.dim
    columns = csr_array((np.ones(rollers.size), (rollers, np.arange(rollers.size))), (mesh.n_unknowns, rollers.size))
    return csr_array(hstack([mesh.constraints(), columns]))


STRIPS = [
    *((element, f, nu) for element in ("quad4", "quad8", "quad8 reduced") for f in KELVIN for nu in (0.3, 0.499)),
    *(("quad8_mixed", "plane_strain", nu) for nu in (0.0, 0.3, 0.499, 0.5)),
]


@pytest.mark.parametrize(("element", "formulation", "poisson"), STRIPS)
def test_a_strip_is_stiffer_in_plane_strain_by_one_less_poisson_squared(
    element: str, formulation: str, poisson: float
) -> None:
    """A strip that is pulled has the modulus 1 in plane stress and 1/(1 - nu^2) in plane strain."""
    mesh = small_mesh(element)
    stiffness = stiffness_matrix(mesh, formulation, poisson)
    u = pull_on_the_end(mesh, free_to_contract(mesh), stiffness, right_half_only=False)
    compliance = 1.0 - poisson**2 if formulation == "plane_strain" else 1.0
    assert u[:, 1] == pytest.approx(compliance * mesh.nodes[:, 1], abs=1e-9 * LENGTH)


@pytest.mark.parametrize("formulation", ["plane_stress", "plane_strain"])
def test_refining_the_mesh_softens_it_by_kelvins_logarithm(formulation: str) -> None:
    """Half as large elements add ln 2 times Kelvin's coefficient to the compliance under a point load."""
    coarse, fine = (model(formulation=formulation, divisions=d) for d in ((16, 30), (32, 60)))
    for a in (0.05, 0.07, 0.1):
        assert 1 / fine.stiffness(a) - 1 / coarse.stiffness(a) == pytest.approx(KELVIN[formulation], rel=0.01)


@pytest.mark.parametrize("formulation", ["plane_stress", "plane_strain", "solid"])
def test_matrices_give_the_stress_of_the_weak_form(formulation: str) -> None:
    stress_of = linear_stress(*lame_parameters(formulation, 0.37))
    matrix = constitutive_matrix(formulation, 0.37)
    dim = 3 if formulation == "solid" else 2
    shears = [(1, 2), (0, 2), (0, 1)] if dim == 3 else [(0, 1)]
    entries = [*((i, i) for i in range(dim)), *shears]
    for column, (i, j) in enumerate(entries):
        strain = np.zeros((dim, dim, 1, 1))
        strain[i, j] = strain[j, i] = 1.0 if i == j else 0.5  # unit engineering strain
        stress = stress_of(strain)[:, :, 0, 0]
        assert matrix[:, column] == pytest.approx([stress[entry] for entry in entries], rel=1e-12, abs=1e-14)


def test_plane_stress_leaves_the_faces_free_and_plane_strain_keeps_them_in_place() -> None:
    nu = 0.3
    solid = constitutive_matrix("solid", nu)
    in_plane = [0, 1, 5]
    assert constitutive_matrix("plane_strain", nu) == pytest.approx(solid[np.ix_(in_plane, in_plane)])
    compliance = np.linalg.inv(solid)[np.ix_(in_plane, in_plane)]
    assert constitutive_matrix("plane_stress", nu) == pytest.approx(np.linalg.inv(compliance))


@pytest.mark.parametrize("nu", [-0.1, 0.5, float("nan")])
def test_poisson_out_of_range_is_refused_with_its_range(nu: float) -> None:
    with pytest.raises(ValueError, match=r"poisson = .* is outside 0 to 0\.499\. Take 0\.499"):
        lame_parameters("plane_strain", nu)


def check_brick_stiffness(poisson: float, modulus: NDArray[np.float64]) -> None:
    """The fast assembly of bricks has the entries of the weak form, here at Poisson's ratio 0.3."""
    mesh = CutMesh(kind=ELEMENT_KINDS["hex20"], divisions=(2, 2, 1), size=(0.08, 0.15, 0.01))
    weak_form = elastic_form("solid", 0.3, np.arange(1.0, 5.0)).assemble(mesh.basis)
    assert abs(stiffness_matrix(mesh, "solid", poisson, modulus) - weak_form).max() < 1e-14 * abs(weak_form).max()


def test_bricks_are_assembled_as_the_weak_form_has_them() -> None:
    check_brick_stiffness(0.3, np.arange(1.0, 5.0))
    for poisson, modulus in ((0.31, np.arange(1.0, 5.0)), (0.3, np.ones(4))):
        with pytest.raises(AssertionError):
            check_brick_stiffness(poisson, modulus)


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


def test_energy_is_mirror_symmetric() -> None:
    model = CutModel()
    density = model.strain_energy_density(model.displacement(TIP, FORCE, MODULUS, DEPTH), MODULUS).reshape(8, 15)
    np.testing.assert_allclose(density, density[::-1], rtol=1e-9)
    assert density.argmax() in (3 * 15 + 4, 3 * 15 + 5, 4 * 15 + 4, 4 * 15 + 5)  # at the tip


def test_a_displacement_of_another_mesh_is_refused() -> None:
    with pytest.raises(ValueError, match="give one of each node"):
        CutModel().strain_energy_density(np.zeros((10, 2)), MODULUS)


@pytest.mark.parametrize("name", ["quad8", "mixed"])
def test_another_poisson_ratio_than_the_field_s_is_noticed(name: str) -> None:
    with pytest.raises(AssertionError):
        check_energy_closes(CutModel(**MODELS[name]), 0.35)
