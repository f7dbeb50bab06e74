"""Displacement at any point: the shape functions of the model's elements, checked at nodes and by linear fields."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cutenv.tissue import CutModel

Array = NDArray[np.float64]
LOAD = {"force": 2.0, "modulus": 40e3, "thickness": 0.02}
MODELS: dict[str, dict[str, Any]] = {
    "quad4": {"element": "quad4"},
    "quad8": {},
    "quad8, beside an earlier cut": {"offset": -0.01, "earlier_cuts": [(0.02, 0.05)]},
    "hex20": {"element": "hex20", "formulation": "solid", "divisions": (4, 6, 2)},
}


def check_at_nodes(model: CutModel, places: Array) -> None:
    """The displacement of every node of one face, and none of those that may slip against another."""
    alone = np.ones(model.n_nodes, bool)
    faces = np.unique(np.round(model.nodes, 9), axis=0, return_inverse=True)[1]
    alone[np.bincount(faces)[faces] > 1] = False
    tip = float(model.tips[len(model.tips) // 2])
    at_nodes = model.displacement(tip, **LOAD)
    found = model.displacement_at(places[alone], tip, **LOAD)
    assert found == pytest.approx(at_nodes[alone], abs=1e-12 * np.abs(at_nodes).max())


@pytest.mark.parametrize("arguments", MODELS.values(), ids=MODELS)
def test_at_a_node_it_is_the_node_s(arguments: dict[str, Any]) -> None:
    model = CutModel(**arguments)
    check_at_nodes(model, model.nodes)


def test_a_micrometre_beside_a_node_it_is_not() -> None:
    model = CutModel()
    with pytest.raises(AssertionError):
        check_at_nodes(model, model.nodes * (1.0 - 1e-4))


@pytest.mark.parametrize("arguments", MODELS.values(), ids=MODELS)
def test_a_linear_field_is_linear_at_every_point(arguments: dict[str, Any]) -> None:
    model = CutModel(**arguments)
    low, high = model.nodes.min(axis=0), model.nodes.max(axis=0)
    points = np.random.default_rng(1).uniform(low, high, size=(50, model.dim))
    gradient = np.arange(1.0, 1.0 + model.dim**2).reshape(model.dim, model.dim)
    assert model._mesh.interpolated(model.nodes @ gradient, points) == pytest.approx(points @ gradient, abs=1e-12)


def test_the_right_face_of_a_cut_answers_for_the_line() -> None:
    halves = np.repeat([1.0, 3.0], 60)
    model = CutModel(relative_modulus=halves)
    left, right = model.pairs[8]
    at_nodes = model.displacement(0.1, **LOAD)
    assert abs(at_nodes[left, 1] - at_nodes[right, 1]) > 1e-5
    assert model.displacement_at(model.nodes[[left]], 0.1, **LOAD)[0] == pytest.approx(at_nodes[right], rel=1e-12)


def check_against_a_finer_mesh(coarse: Array, tip: float) -> None:
    """Two centimetres and more from the tip a force moves points by what it moves them on a mesh four times as fine."""
    fine = CutModel(divisions=(32, 60)).displacement_at(FAR, tip, **LOAD)
    assert coarse == pytest.approx(fine, abs=0.03 * np.abs(fine).max())


FAR = [[0.02, 0.05], [0.03, 0.07], [-0.025, 0.1], [0.0, 0.13]]


@pytest.mark.parametrize("tip", [0.004, 0.06, 0.0625, 0.065, 0.0675])
def test_between_corners_a_force_moves_far_points_as_on_a_finer_mesh(tip: float) -> None:
    check_against_a_finer_mesh(CutModel().displacement_at(FAR, tip, **LOAD), tip)


def test_a_field_scaled_to_the_motion_of_the_tip_moves_them_too_far() -> None:
    model, tip = CutModel(), 0.065
    nodes = model._mesh.interpolated(model.displacement(tip, **LOAD), np.array(FAR))
    with pytest.raises(AssertionError):
        check_against_a_finer_mesh(nodes, tip)


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
