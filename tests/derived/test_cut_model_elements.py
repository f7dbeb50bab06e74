"""Elements and assembly: patch test, rigid motions, order of convergence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from constitutive import constitutive_matrix
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementVector, Functional, LinearForm
from skfem.helpers import ddot, dot, sym_grad, trace
from skfem.models.elasticity import linear_elasticity

from cutenv.tissue import elasticity
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.tip_response import stiffness_matrix

Array = NDArray[np.float64]
WIDTH, LENGTH, THICKNESS = 0.08, 0.15, 0.02
KINDS = [
    ("quad4", "plane_stress"),
    ("quad4", "plane_strain"),
    ("quad8", "plane_stress"),
    ("quad8", "plane_strain"),
    ("hex20", "solid"),
]


def mesh_of(element: str, divisions: tuple[int, ...]) -> CutMesh:
    size = (WIDTH, LENGTH, THICKNESS)[: len(divisions)]
    return CutMesh(kind=ELEMENT_KINDS[element], divisions=divisions, size=size)


def small_mesh(element: str) -> CutMesh:
    return mesh_of(element, (4, 3, 2) if element == "hex20" else (4, 5))


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


def joined(mesh: CutMesh) -> csr_array:
    """Motion of every unknown when nodes at one place move together, found by their positions; no clamp."""
    places = np.round(mesh.nodes / 1e-9).astype(np.int64)
    _, same = np.unique(places, axis=0, return_inverse=True)
    columns = (mesh.dim * same.reshape(-1, 1) + np.arange(mesh.dim)).ravel()
    shape = (mesh.nodes.size, mesh.dim * (same.max() + 1))
    return csr_array((np.ones(columns.size), (np.arange(columns.size), columns)), shape=shape)


def outer(mesh: CutMesh) -> NDArray[np.bool_]:
    """Unknowns on the outline of the specimen."""
    low = np.array([-WIDTH / 2, 0.0, 0.0])[: mesh.dim]
    high = np.array([WIDTH / 2, LENGTH, THICKNESS])[: mesh.dim]
    on_outline = (np.isclose(mesh.nodes, low) | np.isclose(mesh.nodes, high)).any(axis=1)
    return np.repeat(on_outline, mesh.dim)


def solve_with_outline(mesh: CutMesh, stiffness: csr_array, known: Array, load: Array) -> Array:
    """Displacement of the whole specimen when its outline is moved as ``known`` says."""
    join = joined(mesh)
    fixed = join.T @ outer(mesh).astype(float) > 0
    first = np.array(join.tocsc().indices[join.tocsc().indptr[:-1]])
    u = np.where(fixed, known[first], 0.0)
    k = (join.T @ stiffness @ join).tocsc()
    rest = (join.T @ load - k @ u)[~fixed]
    u[~fixed] = spsolve(k[~fixed][:, ~fixed], rest)
    return join @ u


# ------------------------------------------------------------------------------------------------ patch test

GRADIENT = np.array([[0.3, -0.2, 0.5], [0.7, 0.4, -0.1], [0.2, 0.6, -0.8]])


def check_patch(mesh: CutMesh, stiffness: csr_array, matrix: Array) -> None:
    """A constant strain on the outline comes out everywhere, with the energy of that strain."""
    gradient = GRADIENT[: mesh.dim, : mesh.dim]
    exact = mesh.nodes @ gradient.T
    u = solve_with_outline(mesh, stiffness, exact.ravel(), np.zeros(mesh.nodes.size))
    assert np.abs(u - exact.ravel()).max() < 1e-10 * np.abs(exact).max()

    strain = (gradient + gradient.T) / 2
    shears = [(1, 2), (0, 2), (0, 1)] if mesh.dim == 3 else [(0, 1)]
    voigt = np.array([*np.diag(strain), *(2 * strain[entry] for entry in shears)])
    energy = voigt @ matrix @ voigt * np.prod(mesh.size)
    assert u @ stiffness @ u == pytest.approx(energy, rel=1e-10)


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
    join = joined(mesh)
    first = join.tocsc().indices[join.tocsc().indptr[:-1]]
    nodes = mesh.nodes.reshape(-1)[first].reshape(-1, mesh.dim)
    return nodes, (join.T @ stiffness @ join).toarray()


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


def wave(x: Array) -> list[Array]:
    """A smooth displacement [m] of the plane, and its gradient below."""
    return [np.sin(40 * x[0]) * np.cos(25 * x[1]), np.cos(30 * x[0] + 20 * x[1])]


def wave_gradient(x: Array) -> Array:
    phase = 30 * x[0] + 20 * x[1]
    return np.array(
        [
            [40 * np.cos(40 * x[0]) * np.cos(25 * x[1]), -25 * np.sin(40 * x[0]) * np.sin(25 * x[1])],
            [-30 * np.sin(phase), -20 * np.sin(phase)],
        ]
    )


def wave_body_force(x: Array, lam: float, mu: float) -> Array:
    """Minus (lambda + mu) times the gradient of the wave's divergence, minus mu times its Laplacian."""
    phase = 30 * x[0] + 20 * x[1]
    sc, cs = np.sin(40 * x[0]) * np.cos(25 * x[1]), np.cos(40 * x[0]) * np.sin(25 * x[1])
    cos = np.cos(phase)
    laplacian = np.array([-(40**2 + 25**2) * sc, -(30**2 + 20**2) * cos])
    grad_div = np.array([-(40**2) * sc - 20 * 30 * cos, -40 * 25 * cs - 20**2 * cos])
    return -(lam + mu) * grad_div - mu * laplacian


def energy_error(element: str, n: int, form: Callable[[float, float], BilinearForm]) -> float:
    lam, mu = elasticity.lame_parameters("plane_stress", 0.3)
    mesh = mesh_of(element, (n, 2 * n))
    fine = Basis(mesh.skfem_mesh, ElementVector(mesh.kind.element()), intorder=8)
    stiffness = csr_array(form(lam, mu).assemble(mesh.basis))
    load = LinearForm(lambda v, w: dot(wave_body_force(w.x, lam, mu), v)).assemble(fine)
    exact = np.column_stack(wave(mesh.nodes.T)).ravel()
    u = solve_with_outline(mesh, stiffness, exact, load)

    def density(w: Any) -> Array:
        gradient = wave_gradient(w.x)
        error = sym_grad(w["u"]) - (gradient + np.swapaxes(gradient, 0, 1)) / 2
        return lam * trace(error) ** 2 + 2 * mu * ddot(error, error)

    return float(np.sqrt(Functional(density).assemble(fine, u=fine.interpolate(u))))


def check_order(element: str, expected: float, form: Callable[[float, float], BilinearForm]) -> None:
    coarse, fine = (energy_error(element, n, form) for n in (8, 16))
    assert np.log2(coarse / fine) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(("element", "order"), [("quad4", 1.0), ("quad8", 2.0)])
def test_order_of_convergence_in_the_energy_norm(element: str, order: float) -> None:
    check_order(element, order, linear_elasticity)


@pytest.mark.parametrize(("element", "order"), [("quad4", 1.0), ("quad8", 2.0)])
def test_order_of_convergence_is_lost_with_the_printed_shear_entry(element: str, order: float) -> None:
    """Doubling the shear entry alone adds mu times the engineering shear strain squared."""

    def printed(lam: float, mu: float) -> BilinearForm:
        right = linear_elasticity(lam, mu).form

        def weak_form(u: Any, v: Any, w: Any) -> Array:
            return right(u, v, w) + 4 * mu * sym_grad(u)[0, 1] * sym_grad(v)[0, 1]

        return BilinearForm(weak_form)

    with pytest.raises(AssertionError):
        check_order(element, order, printed)


def test_quad8_does_not_pass_for_a_linear_element() -> None:
    with pytest.raises(AssertionError):
        check_order("quad8", 1.0, linear_elasticity)
