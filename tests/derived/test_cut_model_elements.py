"""Elements and assembly: patch test, rigid motions, order of convergence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reproduction.constitutive import constitutive_matrix
from reproduction.elements import GRADIENT, KINDS, SIZE, convergence, joined, mesh_of, patch, small_mesh
from scipy.sparse import csr_array
from skfem import Basis, BilinearForm, ElementVector
from skfem.helpers import sym_grad
from skfem.models.elasticity import linear_elasticity

from cutenv.tissue import elasticity
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.tip_response import stiffness_matrix

Array = NDArray[np.float64]
WIDTH, LENGTH, THICKNESS = SIZE


def distorted(mesh: CutMesh) -> CutMesh:
    """The same mesh with its inner corners moved at random, those on the cut line along it."""
    corners = mesh.corners.copy()
    half = np.array([WIDTH / 2, LENGTH, THICKNESS])[: mesh.dim]
    low = np.array([-WIDTH / 2, 0.0, 0.0])[: mesh.dim]
    moves = 0.15 * np.random.default_rng(5).uniform(-1.0, 1.0, corners.shape)
    moves *= np.array(mesh.size) / np.array(mesh.divisions)
    moves[np.isclose(corners, low) | np.isclose(corners, half)] = 0.0
    on_line = corners[:, 0] == 0.0
    moves[on_line] = 0.0
    crooked = mesh_of(next(k for k, v in ELEMENT_KINDS.items() if v is mesh.kind), mesh.divisions)
    crooked.__dict__["corners"] = corners + moves
    return crooked


# ------------------------------------------------------------------------------------------------ patch test


def check_patch(mesh: CutMesh, stiffness: csr_array, matrix: Array) -> None:
    """A constant strain on the outline comes out everywhere, with the energy of that strain."""
    u, error = patch(mesh, stiffness)
    assert error < 1e-10
    gradient = GRADIENT[: mesh.dim, : mesh.dim]
    strain = (gradient + gradient.T) / 2
    shears = [(1, 2), (0, 2), (0, 1)] if mesh.dim == 3 else [(0, 1)]
    voigt = np.array([*np.diag(strain), *(2 * strain[entry] for entry in shears)])
    energy = voigt @ matrix @ voigt * np.prod(mesh.size)
    assert u.ravel() @ stiffness @ u.ravel() == pytest.approx(energy, rel=1e-10)


@pytest.mark.parametrize("shape", ["regular", "distorted"])
@pytest.mark.parametrize(("element", "formulation"), KINDS)
def test_patch_test(element: str, formulation: str, shape: str) -> None:
    mesh = small_mesh(element) if shape == "regular" else distorted(small_mesh(element))
    stiffness = stiffness_matrix(mesh, formulation, 0.3)
    check_patch(mesh, stiffness, constitutive_matrix(formulation, 0.3))


@pytest.mark.parametrize(("element", "formulation"), KINDS)
def test_patch_test_fails_when_one_element_is_softer(element: str, formulation: str) -> None:
    mesh = small_mesh(element)
    modulus = np.ones(len(mesh.elements))
    modulus[1] = 1.0 - 1e-6
    stiffness = stiffness_matrix(mesh, formulation, 0.3, modulus)
    with pytest.raises(AssertionError):
        check_patch(mesh, stiffness, constitutive_matrix(formulation, 0.3))


@pytest.mark.parametrize("formulation", ["plane_stress", "plane_strain"])
def test_patch_test_fails_with_the_printed_shear_entry(formulation: str) -> None:
    mesh = small_mesh("quad8")
    printed = constitutive_matrix(formulation, 0.3) * np.array([1.0, 1.0, 2.0])
    with pytest.raises(AssertionError):
        check_patch(mesh, stiffness_matrix(mesh, formulation, 0.3), printed)


@pytest.mark.parametrize("element", ["quad4", "quad8"])
def test_patch_test_fails_when_the_halves_are_not_joined(element: str) -> None:
    """The outline alone does not hold the faces: they would stay free of traction."""
    mesh = small_mesh(element)
    slit = mesh_of(element, mesh.divisions)
    apart = mesh.nodes.copy()
    apart[mesh.pairs[1:-1, 1], 0] += 1e-6
    slit.__dict__["nodes"] = apart
    stiffness = stiffness_matrix(mesh, "plane_stress", 0.3)
    with pytest.raises(AssertionError):
        check_patch(slit, stiffness, constitutive_matrix("plane_stress", 0.3))


# --------------------------------------------------------------------------------------------- rigid motions


def rigid_motions(nodes: Array) -> Array:
    """Translations and rotations, each as one column of unknowns."""
    n, dim = nodes.shape
    columns = [np.tile(np.eye(dim)[i], n) for i in range(dim)]
    for i in range(dim):
        for j in range(i):
            spin = np.zeros((dim, dim))
            spin[i, j], spin[j, i] = 1.0, -1.0
            columns.append((nodes @ spin.T).ravel() / np.abs(nodes).max())
    return np.column_stack(columns)


def check_free_of_all_but_rigid_motions(nodes: Array, stiffness: Array) -> None:
    rigid = rigid_motions(nodes)
    assert np.abs(stiffness @ rigid).max() < 1e-10 * np.abs(stiffness).max()
    energies = np.linalg.eigvalsh(stiffness)
    assert np.count_nonzero(energies < 1e-9 * energies.max()) == rigid.shape[1]
    assert energies.min() > -1e-12 * energies.max()


def joined_stiffness(mesh: CutMesh, stiffness: csr_array) -> tuple[Array, Array]:
    join, first = joined(mesh)
    return mesh.nodes[first], (join.T @ stiffness @ join).toarray()


@pytest.mark.parametrize(("element", "formulation"), KINDS)
def test_only_rigid_motions_cost_no_energy(element: str, formulation: str) -> None:
    mesh = mesh_of(element, (2, 2, 1)) if element == "hex20" else small_mesh(element)
    check_free_of_all_but_rigid_motions(*joined_stiffness(mesh, stiffness_matrix(mesh, formulation, 0.3)))


def test_only_rigid_motions_cost_no_energy_with_reduced_integration() -> None:
    """The hourglass of a single 8-node element of 2 x 2 points is none of its neighbours'."""
    mesh = CutMesh(kind=ELEMENT_KINDS["quad8"].reduced(), divisions=(4, 5), size=(WIDTH, LENGTH))
    check_free_of_all_but_rigid_motions(*joined_stiffness(mesh, stiffness_matrix(mesh, "plane_stress", 0.3)))


@pytest.mark.parametrize(("element", "formulation"), KINDS)
def test_one_point_integration_lets_hourglasses_go_free(element: str, formulation: str) -> None:
    mesh = mesh_of(element, (2, 2, 1)) if element == "hex20" else small_mesh(element)
    centre = (np.full((mesh.dim, 1), 0.5), np.ones(1))
    basis = Basis(mesh.skfem_mesh, ElementVector(mesh.kind.element()), quadrature=centre)
    modulus = np.ones(len(mesh.elements))
    reduced = csr_array(elasticity.elastic_form(formulation, 0.3, modulus).assemble(basis))
    with pytest.raises(AssertionError):
        check_free_of_all_but_rigid_motions(*joined_stiffness(mesh, reduced))


def test_halves_that_are_not_joined_move_freely_of_each_other() -> None:
    mesh = small_mesh("quad8")
    with pytest.raises(AssertionError):
        check_free_of_all_but_rigid_motions(mesh.nodes, stiffness_matrix(mesh, "plane_stress", 0.3).toarray())


# -------------------------------------------------------------------------------------- order of convergence


def check_order(element: str, expected: float, form: BilinearForm) -> None:
    assert convergence(element, lambda mesh: csr_array(form.assemble(mesh.basis))) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(("element", "order"), [("quad4", 1.0), ("quad8", 2.0)])
def test_order_of_convergence_is_lost_with_the_printed_shear_entry(element: str, order: float) -> None:
    """Doubling the shear entry alone adds mu times the engineering shear strain squared; without, it is as expected."""
    lam, mu = elasticity.lame_parameters("plane_stress", 0.3)
    right = linear_elasticity(lam, mu)

    def printed(u: Any, v: Any, w: Any) -> Array:
        return right.form(u, v, w) + 4 * mu * sym_grad(u)[0, 1] * sym_grad(v)[0, 1]

    check_order(element, order, right)
    with pytest.raises(AssertionError):
        check_order(element, order, BilinearForm(printed))
