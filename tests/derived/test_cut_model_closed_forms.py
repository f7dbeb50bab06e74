"""Closed forms: bars that stretch, faces that slide, strips free to contract, and Kelvin's point load."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from reproduction.elements import KELVIN, model
from scipy.sparse import csr_array, hstack
from scipy.sparse.linalg import spsolve
from skfem import ElementVector, FacetBasis, LinearForm

from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.tip_response import stiffness_matrix

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


@pytest.mark.parametrize("element", KINDS)
def test_a_column_that_contracts_does_not(element: str) -> None:
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


@pytest.mark.parametrize("element", KINDS)
def test_the_faces_of_a_tied_specimen_do_not_slide(element: str) -> None:
    mesh = small_mesh(element)
    with pytest.raises(AssertionError):
        check_two_bars(mesh, mesh.constraints())


def free_to_contract(mesh: CutMesh) -> csr_array:
    """The clamp holds the specimen along the line, and across it on the line alone: it stands on rollers."""
    rollers = np.flatnonzero((mesh.half_steps[:, 1] == 0) & (mesh.half_steps[:, 0] != 0)) * mesh.dim
    columns = csr_array((np.ones(rollers.size), (rollers, np.arange(rollers.size))), (mesh.n_unknowns, rollers.size))
    return csr_array(hstack([mesh.constraints(), columns]))


def check_strip(element: str, formulation: str, poisson: float, constraints_of: Callable[[CutMesh], csr_array]) -> None:
    """A strip that is pulled has the modulus 1 in plane stress and 1/(1 - nu^2) in plane strain."""
    mesh = small_mesh(element)
    stiffness = stiffness_matrix(mesh, formulation, poisson)
    u = pull_on_the_end(mesh, constraints_of(mesh), stiffness, right_half_only=False)
    compliance = 1.0 - poisson**2 if formulation == "plane_strain" else 1.0
    assert u[:, 1] == pytest.approx(compliance * mesh.nodes[:, 1], abs=1e-9 * LENGTH)


STRIPS = [
    *((element, f, nu) for element in ("quad4", "quad8", "quad8 reduced") for f in KELVIN for nu in (0.3, 0.499)),
    *(("quad8_mixed", "plane_strain", nu) for nu in (0.0, 0.3, 0.499, 0.5)),
]


@pytest.mark.parametrize(("element", "formulation", "poisson"), STRIPS)
def test_a_strip_is_stiffer_in_plane_strain_by_one_less_poisson_squared(
    element: str, formulation: str, poisson: float
) -> None:
    check_strip(element, formulation, poisson, free_to_contract)


@pytest.mark.parametrize("element", ["quad8", "quad8_mixed"])
def test_a_clamped_strip_is_stiffer_than_that(element: str) -> None:
    with pytest.raises(AssertionError):
        check_strip(element, "plane_strain", 0.3, CutMesh.constraints)


def check_kelvin(formulation: str, softening_per_halving: float) -> None:
    """Half as large elements add ln 2 times Kelvin's coefficient to the compliance under a point load."""
    coarse, fine = (model(formulation=formulation, divisions=d) for d in ((16, 30), (32, 60)))
    for a in (0.05, 0.07, 0.1):
        assert 1 / fine.stiffness(a) - 1 / coarse.stiffness(a) == pytest.approx(softening_per_halving, rel=0.01)


@pytest.mark.parametrize("formulation", ["plane_stress", "plane_strain"])
def test_refining_the_mesh_softens_it_by_kelvins_logarithm(formulation: str) -> None:
    check_kelvin(formulation, KELVIN[formulation])


def test_kelvins_coefficients_tell_the_formulations_apart() -> None:
    with pytest.raises(AssertionError):
        check_kelvin("plane_stress", KELVIN["plane_strain"])
