"""Zones and thickness along the cut, cuts beside others, and specimens whose halves differ."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.slab import zoned_model
from cutenv.sim.tissue.tip_response import stiffness_matrix, tip_responses

Array = NDArray[np.float64]
PLACES = np.linspace(0.005, 0.15, 24)
CENTIMETRES = np.arange(1, 13) * 0.01


def test_equal_zones_are_no_zones_to_the_last_bit() -> None:
    zones = zoned_model(CutModel(), [0.031, 0.1], [1.0, 1.0, 1.0])
    assert (zones.stiffness(PLACES) == CutModel().stiffness(PLACES)).all()
    assert (zones.unit_fields == CutModel().unit_fields).all()


def test_bricks_have_zones_too() -> None:
    bricks: dict[str, Any] = {"element": "hex20", "formulation": "solid", "divisions": (2, 6, 2)}
    zones = zoned_model(CutModel(**bricks), [0.075], [1.0, 3.0])
    assert zones.relative_modulus is not None
    assert (zones.relative_modulus.reshape(2, 6, 2)[0, :, 0] == [1, 1, 1, 3, 3, 3]).all()


def test_a_border_inside_a_row_weighs_its_parts() -> None:
    rows = zoned_model(CutModel(), [0.0325], [1.0, 3.0]).relative_modulus
    assert rows is not None
    assert rows.reshape(8, 15)[0, :5] == pytest.approx([1.0, 1.0, 1.0, 2.5, 3.0])


def test_moduli_in_pascals_are_a_stiffness_in_pascals() -> None:
    relative, pascals = (zoned_model(CutModel(), [0.05], np.array([1.0, 2.0]) * unit) for unit in (1.0, 20e3))
    assert pascals.stiffness(PLACES) == pytest.approx(20e3 * relative.stiffness(PLACES), rel=1e-9)


def check_thin_edge(ratio: ArrayLike) -> None:
    """K over E kappa B along a slice that is 1 mm thin at its clamp, from an independent calculation."""
    expected = [1.00, 0.92, 0.79, 0.64, 0.49, 0.37, 0.30, 0.30, 0.33, 0.36]
    assert np.asarray(ratio)[[*range(8), 9, 11]] == pytest.approx(expected, abs=0.025)


def depth_of_the_slice(y: Array) -> Array:
    depth = np.array([1.0, 1.6, 2.4, 3.7, 5.8, 8.9, 13.6, 18.4, 19.8, 20.0, 20.0, 20.0, 19.5]) * 1e-3
    return np.exp(np.interp(y, np.arange(13) * 0.01, np.log(depth)))


def test_a_slice_hangs_on_its_thin_edge() -> None:
    model = zoned_model(CutModel(), [], [1.0], depth=depth_of_the_slice)
    K = model.stiffness(CENTIMETRES) * model.thickness
    check_thin_edge(K / (CutModel().stiffness(CENTIMETRES) * depth_of_the_slice(CENTIMETRES)))
    model = zoned_model(CutModel(), [], [1.0], depth=lambda y: np.full_like(y, 0.01))
    assert model.stiffness(PLACES) == pytest.approx(CutModel().stiffness(PLACES), rel=1e-12)
    with pytest.raises(AssertionError):
        check_thin_edge(model.stiffness(CENTIMETRES) / CutModel().stiffness(CENTIMETRES))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (([0.05, 0.05], [1, 1, 1]), r"borders = \[0.05, 0.05\] m must increase"),
        (([0.2], [1, 1]), "must increase between 0 and the length, 0.15 m"),
        (([0.05], [1.0]), "1 borders make 2 zones; 1 moduli"),
        (([0.05], [1.0, -1.0]), "moduli = -1 is outside"),
    ],
)
def test_bad_zones_are_refused(arguments: tuple[Any, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        zoned_model(CutModel(), *arguments)


def test_zones_of_zones_are_refused() -> None:
    with pytest.raises(ValueError, match="has a relative_modulus already"):
        zoned_model(zoned_model(CutModel(), [0.05], [1.0, 2.0]), [], [1.0])


def test_bricks_take_no_thickness_along_the_cut() -> None:
    with pytest.raises(ValueError, match="depth goes with plane models"):
        zoned_model(CutModel(element="hex20", formulation="solid"), [], [1.0], depth=depth_of_the_slice)


SHIFTED = {
    "beside": {"shift": 1},
    "earlier cut": {"earlier": ((-1, 3),)},
    "both, three earlier": {"shift": -1, "earlier": ((1, 5), (2, 2))},
}


def shifted_mesh(element: str, **lines: Any) -> CutMesh:
    kind = ELEMENT_KINDS[element]
    return CutMesh(kind=kind, divisions=(6, 5, 2)[: kind.dim], size=(0.09, 0.15, 0.02)[: kind.dim], **lines)


@pytest.mark.parametrize("element", ["quad4", "quad8", "hex20"])
@pytest.mark.parametrize("lines", SHIFTED.values(), ids=SHIFTED)
def test_a_uniform_stretch_passes_every_line(lines: dict[str, Any], element: str) -> None:
    """Patch test: a uniform stretch along the cuts needs no force inside, and fits all constraints (nu = 0)."""
    mesh, tip = shifted_mesh(element, **lines), 2
    formulation = "solid" if mesh.dim == 3 else "plane_stress"
    stretch = np.zeros_like(mesh.nodes)
    stretch[:, 1] = mesh.nodes[:, 1]
    constraints = mesh.constraints(tip)
    force = constraints.T @ (stiffness_matrix(mesh, formulation, 0.0) @ stretch.ravel())
    free = constraints.T @ (constraints @ np.ones(constraints.shape[1]))  # unknowns by number of nodes they move
    coefficients = (constraints.T @ stretch.ravel()) / free
    assert constraints @ coefficients == pytest.approx(stretch.ravel(), abs=1e-12)
    at_the_end = np.asarray(constraints.T @ (mesh.nodes[:, 1] > 0.149).repeat(mesh.dim).astype(float)) > 0
    assert np.abs(force[~at_the_end]).max() < 1e-12
    assert force[at_the_end].sum() == pytest.approx(0.09 * (0.02 if mesh.dim == 3 else 1.0))


def test_the_faces_of_an_earlier_cut_slide_and_are_tied_where_it_ended() -> None:
    free = shifted_mesh("quad8").constraints(2).shape[1]
    cut, through = (shifted_mesh("quad8", earlier=((-1, n),)).constraints(2).shape[1] for n in (3, 5))
    assert (cut - free, through - free) == (5, 10), "pairs at half steps behind the end, the clamp's aside"


def test_cuts_on_either_side_are_mirror_images() -> None:
    left, right = (CutModel(offset=x, earlier_cuts=[(-x, 0.06)]) for x in (-0.02, 0.02))
    assert left.stiffness(PLACES) == pytest.approx(right.stiffness(PLACES), rel=1e-9)
    here, there = (
        m.displacement_at([[x, 0.05]], 0.07, tip_displacement=0.01) for m, x in ((left, -0.01), (right, 0.01))
    )
    assert here == pytest.approx(there * [-1.0, 1.0], rel=1e-9)


def test_an_earlier_cut_of_the_line_itself_is_what_cutting_does() -> None:
    """By the other route: the tip's own faces untied, at a tip whose line an earlier cut has opened beside."""
    model = CutModel(divisions=(4, 6), width=0.08, earlier_cuts=[(0.02, 0.15)])
    size = (model.width, model.length)
    mesh = CutMesh(kind=ELEMENT_KINDS["quad8"], divisions=(4, 6), size=size, earlier=((1, 6),))
    whole = tip_responses(mesh, stiffness_matrix(mesh, "plane_stress", 0.3), slipping=False)
    assert (np.asarray(model.stiffness(model.tips))[1:] < whole.stiffness[1:]).all(), "cutting softens what is lopsided"
    assert model.stiffness(0.1) < CutModel(divisions=(4, 6)).stiffness(0.1), "and so did the earlier cut"


def test_a_model_with_earlier_cuts_is_copied_and_told_apart() -> None:
    model = CutModel(offset=0.01, earlier_cuts=[(0.02, 0.05)])
    assert pickle.loads(pickle.dumps(model)) == model != CutModel(offset=0.01)
    assert "offset=0.01" in repr(model)
    assert "offset" not in repr(CutModel())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"offset": 0.013}, r"offset = 0\.013 m is no multiple of the elements' 0\.01 m"),
        ({"offset": 0.04}, "leaves no tissue on one side"),
        ({"earlier_cuts": [(0.0, 0.05)]}, "lies on another cut"),
        ({"earlier_cuts": [(0.02, 0.05), (0.02, 0.03)]}, "lies on another cut"),
        ({"earlier_cuts": [(0.05, 0.05)]}, "or outside the specimen"),
        ({"earlier_cuts": [(0.02, 0.0)]}, "length = 0 m of an earlier cut"),
        ({"offset": np.nan}, "offset = nan"),
    ],
)
def test_lines_off_the_mesh_are_refused(arguments: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        CutModel(**arguments)


SPECIMENS = [("quad4", (4, 6)), ("quad8", (4, 6)), ("hex20", (2, 4, 2))]
EXACT = 1e-12


def formulation_of(element: str) -> str:
    return "solid" if element == "hex20" else "plane_stress"


def halves(divisions: tuple[int, ...], right: float) -> Array:
    """Modulus 1 on the left of the cut line, ``right`` on the right."""
    modulus = np.ones(divisions)
    modulus[divisions[0] // 2 :] = right
    return modulus.ravel()


def scattered(divisions: tuple[int, ...], seed: int) -> Array:
    return np.exp(0.8 * np.random.default_rng(seed).standard_normal(int(np.prod(divisions))))


def model_of(element: str, divisions: tuple[int, ...], modulus: Array | None) -> CutModel:
    return CutModel(element, formulation_of(element), divisions=divisions, relative_modulus=modulus)


def dense_solution(model: CutModel, tip: float, *, faces_may_open: bool = False) -> tuple[float, Array]:
    """One tip by itself: every constraint an equation with a Lagrange multiplier, written out pair by pair.

    Returns the unit stiffness and the displacement per unit force over modulus and thickness.
    """
    mesh = CutMesh(
        kind=ELEMENT_KINDS[model.element],
        divisions=model.divisions or (),
        size=(model.width, model.length, model.thickness)[: model.dim],
    )
    stiffness = stiffness_matrix(mesh, model.formulation, model.poisson, model.relative_modulus).toarray()
    dim, n = model.dim, model.n_equations
    equations: list[dict[int, float]] = []
    blade: list[int] = []
    for node, place in enumerate(model.nodes):
        if place[1] == 0.0:
            equations += [{dim * node + component: 1.0} for component in range(dim)]
    for left, right in model.pairs:
        y = model.nodes[left, 1]
        if y == 0.0:
            continue
        for component in range(dim):
            slides = component == 1 and y < tip - 1e-9
            opens = component == 0 and y < tip - 1e-9 and faces_may_open
            if not slides and not opens:
                equations.append({dim * left + component: 1.0, dim * right + component: -1.0})
        if abs(y - tip) < 1e-9:
            blade.append(dim * left + 1)
    equations += [{blade[0]: 1.0, other: -1.0} for other in blade[1:]]  # all tip nodes move equally
    system = np.zeros((n + len(equations), n + len(equations)))
    system[:n, :n] = stiffness
    for row, equation in enumerate(equations, start=n):
        for unknown, factor in equation.items():
            system[row, unknown] = system[unknown, row] = factor
    load = np.zeros(len(system))
    load[blade[0]] = 1.0
    u = np.linalg.solve(system, load)[:n]
    thickness = model.thickness if dim == 3 else 1.0
    return 1.0 / (u[blade[0]] * thickness), u.reshape(-1, dim) * thickness


def check_against_dense(model: CutModel, *, faces_may_open: bool = False) -> None:
    for tip, field in zip(model.tips, model.unit_fields, strict=True):
        kappa, dense = dense_solution(model, tip, faces_may_open=faces_may_open)
        assert model.stiffness(tip) == pytest.approx(kappa, rel=1e-9)
        assert field == pytest.approx(dense, abs=1e-9 * np.abs(dense).max())


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_one_factorisation_agrees_with_a_dense_solution_for_each_tip(element: str, divisions: tuple[int, ...]) -> None:
    check_against_dense(model_of(element, divisions, scattered(divisions, seed=1)))
    check_against_dense(model_of(element, divisions, None))
    model = model_of(element, divisions, scattered(divisions, seed=1))
    with pytest.raises(AssertionError):
        check_against_dense(model, faces_may_open=True)


@pytest.mark.parametrize("cut_length", [0.03, 0.06, 0.08, 0.0926, 0.149])
@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_pairs_ahead_of_the_tip_stay_tied_between_corners(
    element: str, divisions: tuple[int, ...], cut_length: float
) -> None:
    """At any cut length: pairs from the tip on are tied, nothing opens, the clamp holds."""
    model = model_of(element, divisions, halves(divisions, 3.0))
    u = model.displacement(cut_length, 1.5, 40e3, 0.02)
    left, right = model.pairs.T
    slip = u[right] - u[left]
    moved = np.abs(u).max()
    ahead = model.nodes[left, 1] >= cut_length
    assert np.abs(slip[ahead, 1]).max() < EXACT * moved
    assert np.abs(np.delete(slip, 1, axis=1)).max() < EXACT * moved
    assert np.abs(u[model.nodes[:, 1] == 0.0]).max() == 0.0
    assert np.abs(slip[~ahead, 1]).max() > 1e-4 * moved
