"""What symmetry, reciprocity and similarity demand of the unit stiffness."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementQuad1, ElementQuadS2, ElementVector, MeshQuad, condense
from skfem.models.elasticity import linear_elasticity, plane_stress

from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.tip_response import TipResponse, stiffness_matrix, tip_responses

Array = NDArray[np.float64]
SPECIMENS = [("quad4", (8, 15)), ("quad8", (8, 15)), ("hex20", (4, 6, 2)), ("quad8_mixed", (8, 15))]


def mesh_of(element: str, divisions: tuple[int, ...]) -> CutMesh:
    size = (0.08, 0.15, 0.01)[: len(divisions)]
    return CutMesh(kind=ELEMENT_KINDS[element], divisions=divisions, size=size)


def stiffness_of(mesh: CutMesh, relative_modulus: Array | None = None, poisson: float = 0.3) -> csr_array:
    formulation = "solid" if mesh.dim == 3 else "plane_stress"
    return stiffness_matrix(mesh, formulation, poisson, relative_modulus)


def uneven_modulus(divisions: tuple[int, ...], seed: int) -> Array:
    return np.exp(0.7 * np.random.default_rng(seed).standard_normal(int(np.prod(divisions))))


def mirrored_modulus(modulus: Array, divisions: tuple[int, ...]) -> Array:
    return modulus.reshape(divisions)[::-1].ravel()


def mirror_symmetric_modulus(divisions: tuple[int, ...], seed: int) -> Array:
    modulus = uneven_modulus(divisions, seed)
    return np.sqrt(modulus * mirrored_modulus(modulus, divisions))


# ------------------------------------------------------- untying does not change a mirror-symmetric specimen


def check_untying_changes_nothing(mesh: CutMesh, stiffness: csr_array) -> None:
    tied = tip_responses(mesh, stiffness, slipping=False)
    untied = tip_responses(mesh, stiffness, slipping=True)
    assert untied.stiffness == pytest.approx(tied.stiffness, rel=1e-9)
    assert untied.fields == pytest.approx(tied.fields, abs=1e-9 * np.abs(tied.fields).max())


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_untying_does_not_change_a_mirror_symmetric_specimen(element: str, divisions: tuple[int, ...]) -> None:
    mesh = mesh_of(element, divisions)
    check_untying_changes_nothing(mesh, stiffness_of(mesh))
    check_untying_changes_nothing(mesh, stiffness_of(mesh, mirror_symmetric_modulus(divisions, seed=1)))
    with pytest.raises(AssertionError):
        check_untying_changes_nothing(mesh, stiffness_of(mesh, uneven_modulus(divisions, seed=1)))


@cache
def uncut_plate_stiffness(element: str, poisson: float) -> tuple[Array, Array]:
    """Inverse point compliance along the centre line of a plate that was never cut, at unit modulus.

    A plain mesh without doubled nodes. Returns the places [m] of the corners and the mid-side nodes on the
    line, from the clamp, and the stiffness at each.
    """
    mesh = MeshQuad.init_tensor(np.linspace(-0.04, 0.04, 9), np.linspace(0.0, 0.15, 16))
    kind = ElementQuad1() if element == "quad4" else ElementQuadS2()
    basis = Basis(mesh, ElementVector(kind), intorder=5)
    stiffness = linear_elasticity(*plane_stress(1.0, poisson)).assemble(basis)
    x, y = basis.doflocs
    clamp = np.flatnonzero(np.isclose(y, 0.0))
    at_line = np.flatnonzero(np.isclose(x, 0.0, atol=1e-9) & ~np.isclose(y, 0.0))
    along = at_line[at_line % 2 == 1]  # unknowns alternate: x, y
    order = along[np.argsort(y[along])]
    loads = np.zeros((basis.N, order.size))
    loads[order, np.arange(order.size)] = 1.0
    kept = np.setdiff1d(np.arange(basis.N), clamp)
    moved = spsolve(condense(stiffness, D=clamp, expand=False).tocsc(), loads[kept])
    return y[order], 1.0 / moved[np.searchsorted(kept, order), np.arange(order.size)]


def check_against_the_uncut_plate(model: CutModel, poisson: float) -> None:
    places, stiffness = uncut_plate_stiffness(model.element, poisson)
    at_corners = np.isclose(np.rint(places / 0.01) * 0.01, places)
    assert model.tips == pytest.approx(places[at_corners])
    assert model.stiffness(model.tips) == pytest.approx(stiffness[at_corners], rel=1e-9)


@pytest.mark.parametrize("element", ["quad4", "quad8"])
def test_unit_stiffness_is_the_inverse_point_compliance_of_the_uncut_plate(element: str) -> None:
    check_against_the_uncut_plate(CutModel(element), poisson=0.3)
    with pytest.raises(AssertionError):
        check_against_the_uncut_plate(CutModel(element), poisson=0.31)


def test_unit_stiffness_falls_as_the_load_leaves_the_clamp() -> None:
    model = CutModel()
    places, stiffness = model.tips, np.asarray(model.stiffness(model.tips))
    inner = places < 0.08
    assert (np.diff(stiffness) < 0).all()
    assert (np.diff(stiffness[inner], 2) > 0).all()


# ------------------------------------------------------------------------------------ reciprocity and energy


def tip_to_tip(mesh: CutMesh, response: TipResponse) -> Array:
    """Displacement at tip j by a unit force at tip i (of the whole blade, mean over its nodes)."""
    return response.fields[:, mesh.tip_pairs[..., 0], 1].mean(axis=2)


def check_reciprocity(compliance: Array) -> None:
    assert compliance == pytest.approx(compliance.T, rel=1e-9)


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS[:2])
def test_a_force_here_moves_there_what_a_force_there_moves_here(element: str, divisions: tuple[int, ...]) -> None:
    mesh = mesh_of(element, divisions)
    stiffness = stiffness_of(mesh, uneven_modulus(divisions, seed=2))
    check_reciprocity(tip_to_tip(mesh, tip_responses(mesh, stiffness, slipping=False)))
    with pytest.raises(AssertionError):
        check_reciprocity(tip_to_tip(mesh, tip_responses(mesh, stiffness, slipping=True)))


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS[:3])
def test_the_work_of_the_blade_is_stored_in_the_specimen(element: str, divisions: tuple[int, ...]) -> None:
    """Clapeyron: a unit force does the work 1 / kappa on its way, twice the energy stored."""
    mesh = mesh_of(element, divisions)
    stiffness = stiffness_of(mesh, uneven_modulus(divisions, seed=3))
    response = tip_responses(mesh, stiffness, slipping=True)
    for tip, field in enumerate(response.fields):
        u = field.ravel()
        assert u @ stiffness @ u == pytest.approx(1.0 / response.stiffness[tip], rel=1e-9)


# ------------------------------------------------------------------------------------- mirror and similarity


def model_of(element: str, divisions: tuple[int, ...], modulus: Array | None, scale: float = 1.0) -> CutModel:
    formulation = "solid" if element == "hex20" else "plane_stress"
    size = {"width": 0.08 * scale, "length": 0.15 * scale, "thickness": 0.01 * scale}
    return CutModel(element, formulation, divisions=divisions, relative_modulus=modulus, **size)


def check_mirror(model: CutModel, mirrored: CutModel) -> None:
    a = np.linspace(0.0, 0.15, 23)
    assert mirrored.stiffness(a) == pytest.approx(model.stiffness(a), rel=1e-9)
    u = model.displacement(0.072, 2.0, 40e3, 0.02)
    v = mirrored.displacement(0.072, 2.0, 40e3, 0.02)
    flipped = np.ones(model.dim)
    flipped[0] = -1.0
    for node, place in enumerate(model.nodes):  # a place on the line has two nodes: compare their sums
        here = np.isclose(model.nodes, place).all(axis=1)
        there = np.isclose(mirrored.nodes, place * flipped).all(axis=1)
        assert u[here].sum(axis=0) * flipped == pytest.approx(v[there].sum(axis=0), abs=1e-11), node


@pytest.mark.parametrize(("element", "divisions"), [("quad4", (8, 15)), ("quad8", (4, 7)), ("hex20", (4, 3, 2))])
def test_a_mirrored_specimen_answers_as_its_mirror_image(element: str, divisions: tuple[int, ...]) -> None:
    modulus = uneven_modulus(divisions, seed=4)
    check_mirror(
        model_of(element, divisions, modulus), model_of(element, divisions, mirrored_modulus(modulus, divisions))
    )
    turned = modulus.reshape(divisions)[:, ::-1].ravel()
    with pytest.raises(AssertionError):
        check_mirror(model_of(element, divisions, modulus), model_of(element, divisions, turned))


@pytest.mark.parametrize("scale", [0.1, 7.0])
@pytest.mark.parametrize(("element", "divisions"), [("quad4", (8, 15)), ("quad8", (4, 7)), ("hex20", (4, 3, 2))])
def test_unit_stiffness_is_a_pure_number(element: str, divisions: tuple[int, ...], scale: float) -> None:
    """All lengths times a factor, the thickness too: kappa stays, displacements fall as 1 / thickness."""
    modulus = uneven_modulus(divisions, seed=5)
    model, larger = model_of(element, divisions, modulus), model_of(element, divisions, modulus, scale)
    a = np.linspace(0.0, 0.15, 23)
    assert larger.stiffness(a * scale) == pytest.approx(model.stiffness(a), rel=1e-9)
    u = model.displacement(0.072, 2.0, 40e3, 0.02)
    v = larger.displacement(0.072 * scale, 2.0, 40e3, 0.02 * scale)
    assert v * scale == pytest.approx(u, abs=1e-9 * np.abs(u).max())
