"""Elements: patch test, rigid motions, convergence; nearly incompressible tissue; displacement at any point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from skfem import BilinearForm, ElementVector, FacetBasis, LinearForm
from skfem.helpers import sym_grad
from skfem.models.elasticity import linear_elasticity

from cutenv.sim.tissue import CutModel, elasticity
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh, ElementKind
from cutenv.sim.tissue.tip_response import stiffness_matrix
from scripts.validation.thesis.constitutive import constitutive_matrix
from scripts.validation.thesis.elements import GRADIENT, KINDS, SIZE, convergence, joined, mesh_of, patch, small_mesh

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


QUAD8, MIXED = ELEMENT_KINDS["quad8"], ELEMENT_KINDS["quad8_mixed"]
# Cook's membrane (R. D. Cook, 1974) under a unit shear force at its free end: deflection in the middle of that end at
# unit modulus. Plane stress, nu = 1/3: 23.97. Plane strain, lambda = 7500 and G = 0.375: 16.4326, by quadratic
# triangles and Richardson extrapolation. Both as P. Krysl's FinEtools and its forerunner state them.
LAME, SHEAR = 7500.0, 0.375
NEARLY_HALF = LAME / 2 / (LAME + SHEAR)
PLANE_STRESS = 23.97
PLANE_STRAIN = 16.4326 * SHEAR * 2 * (1 + NEARLY_HALF)  # per unit Young's modulus


def deflection(kind: ElementKind, divisions: int, formulation: str, poisson: float) -> float:
    """Deflection in the middle of the free end of Cook's panel: 48 long, 44 high where clamped, 16 at that end."""
    square, panel = (CutMesh(kind=kind, divisions=(divisions, divisions), size=(1.0, 1.0)) for _ in range(2))
    up, along = 0.5 - square.corners[:, 0], square.corners[:, 1]
    panel.__dict__["corners"] = np.column_stack([48 * along, 44 * along + up * (44 - 28 * along)])
    end = square.skfem_mesh.facets_satisfying(lambda x: np.isclose(x[1], 1.0), boundaries_only=True)
    basis = FacetBasis(panel.skfem_mesh, ElementVector(kind.element()), facets=end, intorder=4)
    load = np.zeros(panel.n_unknowns)
    load[: panel.nodes.size] = LinearForm(lambda v, w: v[1] / 16).assemble(basis)
    constraints = square.constraints()
    k = (constraints.T @ stiffness_matrix(panel, formulation, poisson) @ constraints).tocsc()
    middle = square.pairs[-1, 0]
    assert panel.nodes[middle] == pytest.approx([48.0, 52.0])
    return float((constraints @ spsolve(k, constraints.T @ load))[2 * middle + 1])


def check_cook(kind: ElementKind, formulation: str, poisson: float, reference: float) -> None:
    """Within 2 % on 8 x 8 elements, and within half of that error on 16 x 16."""
    coarse, fine = (abs(deflection(kind, n, formulation, poisson) / reference - 1) for n in (8, 16))
    assert coarse < 0.02
    assert fine < coarse / 2


@pytest.mark.parametrize("kind", [QUAD8, QUAD8.reduced()], ids=["full", "reduced"])
def test_cooks_membrane_in_plane_stress(kind: ElementKind) -> None:
    check_cook(kind, "plane_stress", 1 / 3, PLANE_STRESS)


def test_cooks_membrane_nearly_incompressible_with_the_mixed_element() -> None:
    check_cook(MIXED, "plane_strain", NEARLY_HALF, PLANE_STRAIN)


def check_kelvin(element: str, poisson: float) -> None:
    """Half as large elements add ln 2 times Kelvin's coefficient to the compliance under a point load, to 2 %."""
    kelvin = (1 + poisson) * (3 - 4 * poisson) / (4 * np.pi * (1 - poisson)) * np.log(2)
    coarse, fine = (CutModel(element, "plane_strain", poisson, divisions=d) for d in ((8, 15), (16, 30)))
    for a in (0.05, 0.07, 0.1):
        assert 1 / fine.stiffness(a) - 1 / coarse.stiffness(a) == pytest.approx(kelvin, rel=0.02)


@pytest.mark.parametrize("poisson", [0.3, 0.499, 0.5])
def test_the_mixed_element_softens_by_kelvins_logarithm_up_to_one_half(poisson: float) -> None:
    check_kelvin("quad8_mixed", poisson)


def compliance_beyond_quad8(poisson: float, divisions: tuple[int, int]) -> float:
    mixed, quad8 = (CutModel(name, "plane_strain", poisson, divisions=divisions) for name in ("quad8_mixed", "quad8"))
    return 1 / mixed.stiffness(0.07) - 1 / quad8.stiffness(0.07)


def test_the_point_load_meets_a_larger_compliance_on_every_mesh_alike() -> None:
    coarse, fine = (compliance_beyond_quad8(0.3, divisions) for divisions in ((8, 15), (16, 30)))
    assert coarse > 0.2
    assert fine == pytest.approx(coarse, rel=0.01)


def test_displacements_alone_do_not_soften_so_at_0_499() -> None:
    check_kelvin("quad8", 0.3)
    with pytest.raises(AssertionError):
        check_kelvin("quad8", 0.499)


LOAD = {"force": 2.0, "modulus": 40e3, "thickness": 0.02}
MODELS: dict[str, dict[str, Any]] = {
    "quad4": {"element": "quad4"},
    "quad8": {},
    "quad8, beside an earlier cut": {"offset": -0.01, "earlier_cuts": [(0.02, 0.05)]},
    "hex20": {"element": "hex20", "formulation": "solid", "divisions": (4, 6, 2)},
}


@pytest.mark.parametrize("arguments", MODELS.values(), ids=MODELS)
def test_at_a_node_it_is_the_node_s(arguments: dict[str, Any]) -> None:
    """The displacement of every node of one face, and none of those that may slip against another."""
    model = CutModel(**arguments)
    alone = np.ones(model.n_nodes, bool)
    faces = np.unique(np.round(model.nodes, 9), axis=0, return_inverse=True)[1]
    alone[np.bincount(faces)[faces] > 1] = False
    tip = float(model.tips[len(model.tips) // 2])
    at_nodes = model.displacement(tip, **LOAD)
    found = model.displacement_at(model.nodes[alone], tip, **LOAD)
    assert found == pytest.approx(at_nodes[alone], abs=1e-12 * np.abs(at_nodes).max())


def test_the_right_face_of_a_cut_answers_for_the_line() -> None:
    halves = np.repeat([1.0, 3.0], 60)
    model = CutModel(relative_modulus=halves)
    left, right = model.pairs[8]
    at_nodes = model.displacement(0.1, **LOAD)
    assert abs(at_nodes[left, 1] - at_nodes[right, 1]) > 1e-5
    assert model.displacement_at(model.nodes[[left]], 0.1, **LOAD)[0] == pytest.approx(at_nodes[right], rel=1e-12)


FAR = [[0.02, 0.05], [0.03, 0.07], [-0.025, 0.1], [0.0, 0.13]]


@pytest.mark.parametrize("tip", [0.004, 0.06, 0.0625, 0.065, 0.0675])
def test_between_corners_a_force_moves_far_points_as_on_a_finer_mesh(tip: float) -> None:
    """Two centimetres and more from the tip a force moves points by what it moves them on a mesh four times as fine."""
    coarse = CutModel().displacement_at(FAR, tip, **LOAD)
    fine = CutModel(divisions=(32, 60)).displacement_at(FAR, tip, **LOAD)
    assert coarse == pytest.approx(fine, abs=0.03 * np.abs(fine).max())


def test_a_displacement_of_the_tip_is_a_force_on_it() -> None:
    model = CutModel()
    bead = [[0.013, 0.047]]
    moved = 2.0 / (model.stiffness(0.06) * 40e3 * 0.02)
    by_force = model.displacement_at(bead, 0.06, **LOAD)
    assert model.displacement_at(bead, 0.06, tip_displacement=moved) == pytest.approx(by_force, rel=1e-12)


@pytest.mark.parametrize(
    ("points", "told"),
    [
        ([[0.05, 0.02]], r"x of points = 0\.05 m is outside"),
        ([[0.0, -0.01]], r"y of points = -0\.01 m is outside"),
        ([0.01, 0.02], r"shape \(2,\); give 2 coordinates"),
        ([[np.nan, 0.02]], "x of points"),
    ],
)
def test_a_point_outside_is_refused(points: Any, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        CutModel().displacement_at(points, 0.05, tip_displacement=0.01)


@pytest.mark.parametrize("load", [{}, {"force": 1.0}, {"tip_displacement": 0.01, "modulus": 1e4}])
def test_half_a_load_or_two_are_refused(load: dict[str, float]) -> None:
    with pytest.raises(TypeError, match=r"tip_displacement, or force, modulus and thickness"):
        CutModel().displacement_at([[0.0, 0.0]], 0.05, **load)


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


def test_halves_that_are_not_joined_move_freely_of_each_other() -> None:
    mesh = small_mesh("quad8")
    with pytest.raises(AssertionError):
        check_free_of_all_but_rigid_motions(mesh.nodes, stiffness_matrix(mesh, "plane_stress", 0.3).toarray())
