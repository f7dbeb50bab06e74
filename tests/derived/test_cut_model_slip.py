"""Specimens whose halves differ: faces slip behind the tip, and only there, and neither open nor overlap."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.tip_response import stiffness_matrix, tip_responses

Array = NDArray[np.float64]
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


def left_tied(model: CutModel) -> tuple[Array, Array]:
    """Unit stiffness and fields of the model at its tips if cutting never untied a pair."""
    size = (model.width, model.length, model.thickness)[: model.dim]
    assert model.divisions is not None
    mesh = CutMesh(kind=ELEMENT_KINDS[model.element], divisions=model.divisions, size=size)
    stiffness = stiffness_matrix(mesh, model.formulation, model.poisson, model.relative_modulus)
    response = tip_responses(mesh, stiffness, slipping=False)
    thickness = model.thickness if model.dim == 3 else 1.0
    return response.stiffness / thickness, response.fields * thickness


def check_slips_behind_the_tip_only(model: CutModel, fields: Array) -> None:
    """Slip along the line behind each tip, nowhere else; no opening, no overlap, no motion off the line."""
    left, right = model.pairs.T
    y = model.nodes[left, 1]
    for tip, field in zip(model.tips, fields, strict=True):
        slip = field[right] - field[left]
        moved = np.abs(field).max()
        behind = (y > 1e-9) & (y < tip - 1e-9)
        assert (np.abs(slip[behind, 1]) > 1e-4 * moved).all()
        assert np.abs(slip[~behind, 1]).max() < EXACT * moved
        assert np.abs(np.delete(slip, 1, axis=1)).max() < EXACT * moved


@pytest.mark.parametrize("right", [0.5, 3.0])
@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_faces_slip_behind_the_tip_only(element: str, divisions: tuple[int, ...], right: float) -> None:
    model = model_of(element, divisions, halves(divisions, right))
    check_slips_behind_the_tip_only(model, model.unit_fields)


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_faces_that_are_left_tied_do_not_slip(element: str, divisions: tuple[int, ...]) -> None:
    model = model_of(element, divisions, halves(divisions, 3.0))
    with pytest.raises(AssertionError):
        check_slips_behind_the_tip_only(model, left_tied(model)[1])


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_faces_of_equal_halves_do_not_slip(element: str, divisions: tuple[int, ...]) -> None:
    model = model_of(element, divisions, None)
    with pytest.raises(AssertionError):
        check_slips_behind_the_tip_only(model, model.unit_fields)


def check_cutting_softens(model: CutModel, stiffness: Array) -> None:
    """Untying frees the specimen: where pairs slip it is softer than tied, by more than rounding."""
    tied, _ = left_tied(model)
    assert (stiffness[1:] < (1.0 - 1e-4) * tied[1:]).all()


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_cutting_softens_a_specimen_whose_halves_differ(element: str, divisions: tuple[int, ...]) -> None:
    model = model_of(element, divisions, halves(divisions, 3.0))
    check_cutting_softens(model, np.asarray(model.stiffness(model.tips)))


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_a_specimen_that_is_left_tied_does_not_soften(element: str, divisions: tuple[int, ...]) -> None:
    model = model_of(element, divisions, halves(divisions, 3.0))
    with pytest.raises(AssertionError):
        check_cutting_softens(model, left_tied(model)[0])


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_cutting_does_not_soften_equal_halves(element: str, divisions: tuple[int, ...]) -> None:
    model = model_of(element, divisions, None)
    with pytest.raises(AssertionError):
        check_cutting_softens(model, np.asarray(model.stiffness(model.tips)))


# ----------------------------------------------------------------- against a dense solution with multipliers


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


@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_faces_that_may_open_give_another_answer(element: str, divisions: tuple[int, ...]) -> None:
    model = model_of(element, divisions, scattered(divisions, seed=1))
    with pytest.raises(AssertionError):
        check_against_dense(model, faces_may_open=True)


# ------------------------------------------------------------------------------------------- between corners


def check_between_corners(model: CutModel, cut_length: float) -> None:
    """At any cut length: pairs from the tip on are tied, nothing opens, the clamp holds."""
    u = model.displacement(cut_length, 1.5, 40e3, 0.02)
    left, right = model.pairs.T
    slip = u[right] - u[left]
    moved = np.abs(u).max()
    ahead = model.nodes[left, 1] >= cut_length
    assert np.abs(slip[ahead, 1]).max() < EXACT * moved
    assert np.abs(np.delete(slip, 1, axis=1)).max() < EXACT * moved
    assert np.abs(u[model.nodes[:, 1] == 0.0]).max() == 0.0
    assert np.abs(slip[~ahead, 1]).max() > 1e-4 * moved


@pytest.mark.parametrize("cut_length", [0.03, 0.06, 0.08, 0.0926, 0.149])
@pytest.mark.parametrize(("element", "divisions"), SPECIMENS)
def test_pairs_ahead_of_the_tip_stay_tied_between_corners(
    element: str, divisions: tuple[int, ...], cut_length: float
) -> None:
    check_between_corners(model_of(element, divisions, halves(divisions, 3.0)), cut_length)


def test_equal_halves_do_not_slip_between_corners() -> None:
    with pytest.raises(AssertionError):
        check_between_corners(CutModel(), 0.08)
