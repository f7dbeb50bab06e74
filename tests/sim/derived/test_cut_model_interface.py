"""What a user of CutModel relies on: values, shapes, units, immutability, copies, refusals."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cutenv.sim.tissue.cut_model import CutModel

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def quad8() -> CutModel:
    return CutModel()


@pytest.fixture(scope="module")
def uneven() -> CutModel:
    return CutModel(relative_modulus=np.exp(0.5 * np.random.default_rng(0).standard_normal(120)))


# ------------------------------------------------------------------------------------------------- stiffness


@pytest.mark.parametrize(("cut_length", "kappa"), [(0.02, 0.942), (0.05, 0.668), (0.07, 0.569)])
def test_checked_values_of_the_unit_stiffness(quad8: CutModel, cut_length: float, kappa: float) -> None:
    assert quad8.stiffness(cut_length) == pytest.approx(kappa, abs=0.0005)


def test_a_number_gives_a_number_and_an_array_its_shape(quad8: CutModel) -> None:
    assert type(quad8.stiffness(0.05)) is float
    assert type(quad8.stiffness(np.float64(0.05))) is float
    lengths = np.linspace(0.0, 0.15, 12).reshape(3, 4)
    kappas = quad8.stiffness(lengths)
    assert isinstance(kappas, np.ndarray)
    assert kappas.shape == (3, 4)
    assert kappas[1, 2] == quad8.stiffness(lengths[1, 2])


def test_below_the_first_corner_the_first_value_is_held(quad8: CutModel) -> None:
    assert quad8.stiffness(0.0) == quad8.stiffness(0.004) == quad8.stiffness(quad8.tips[0])


def test_interpolation_adds_no_extremes(quad8: CutModel, uneven: CutModel) -> None:
    for model in (quad8, uneven):
        a = np.linspace(model.tips[0], model.tips[-1], 1401)
        kappa = np.asarray(model.stiffness(a)).reshape(-1)
        corners = np.asarray(model.stiffness(model.tips))
        for i in range(len(corners) - 1):
            inside = kappa[100 * i : 100 * (i + 1) + 1]
            assert inside.max() <= max(corners[i : i + 2]) + 1e-12
            assert inside.min() >= min(corners[i : i + 2]) - 1e-12
            assert (np.diff(inside) * np.sign(corners[i + 1] - corners[i]) >= -1e-12).all()


def test_thickness_matters_to_the_solid_model_alone(quad8: CutModel) -> None:
    assert CutModel(thickness=0.02).stiffness(0.05) == quad8.stiffness(0.05)
    thin, thick = (CutModel("hex20", "solid", thickness=b, divisions=(4, 4, 2)) for b in (0.01, 0.03))
    assert thin.stiffness(0.05) != pytest.approx(thick.stiffness(0.05), rel=1e-3)


# ---------------------------------------------------------------------------------------------- displacement


def tip_displacement(model: CutModel, u: Array, cut_length: float) -> float:
    """On the straight line between the corners to either side, of the mean of the nodes there."""
    y = model.nodes[model.pairs[:, 0], 1]
    levels = [0.0, *model.tips]
    on_levels = [u[model.pairs[np.isclose(y, level)], 1].mean() for level in levels]
    return float(np.interp(max(cut_length, model.tips[0]), levels, on_levels))


@pytest.mark.parametrize("cut_length", [0.0, 0.004, 0.01, 0.0137, 0.05, 0.0551, 0.149, 0.15])
def test_the_tip_moves_by_force_over_stiffness(quad8: CutModel, uneven: CutModel, cut_length: float) -> None:
    solid = CutModel("hex20", "solid", divisions=(2, 3, 2))
    for model in (quad8, uneven, solid):
        u = model.displacement(cut_length, force=3.0, modulus=42e3, thickness=0.018)
        expected = 3.0 / (model.stiffness(cut_length) * 42e3 * 0.018)
        assert tip_displacement(model, u, cut_length) == pytest.approx(expected, rel=1e-9)


def test_displacement_is_linear_in_the_force_and_starts_at_the_clamp(quad8: CutModel) -> None:
    u = quad8.displacement(0.0733, 2.0, 40e3, 0.02)
    assert u.shape == (quad8.n_nodes, 2)
    assert quad8.displacement(0.0733, -4.0, 40e3, 0.02) == pytest.approx(-2.0 * u)
    assert quad8.displacement(0.0733, 2.0, 80e3, 0.01) == pytest.approx(u)
    assert (u[quad8.nodes[:, 1] == 0.0] == 0.0).all()
    assert np.unravel_index(np.argmax(u), u.shape)[1] == 1  # the largest motion is along the line


def test_displacement_does_not_jump_where_the_tip_passes_a_corner(quad8: CutModel, uneven: CutModel) -> None:
    for model in (quad8, uneven):
        before, after = (model.displacement(a, 2.0, 40e3, 0.02) for a in (0.05 - 1e-9, 0.05 + 1e-9))
        assert before == pytest.approx(after, abs=1e-6 * np.abs(before).max())


def test_on_a_corner_the_field_is_the_unit_field(quad8: CutModel) -> None:
    u = quad8.displacement(float(quad8.tips[6]), 2.0, 40e3, 0.02)
    assert u == pytest.approx(2.0 / (40e3 * 0.02) * quad8.unit_fields[6], rel=1e-9)


# ------------------------------------------------------------------------------------------- convert_modulus


def check_same_response(modulus: float, model: CutModel, other_modulus: float, other: CutModel) -> None:
    """The two models answer one force with one displacement of the tip."""
    moves = [
        tip_displacement(m, m.displacement(0.06, 1.0, e, 0.02), 0.06)
        for m, e in ((model, modulus), (other, other_modulus))
    ]
    assert moves[0] == pytest.approx(moves[1], rel=1e-9)


def test_a_converted_modulus_gives_the_same_response(quad8: CutModel) -> None:
    fine = CutModel(divisions=(16, 30), formulation="plane_strain")
    check_same_response(40e3, quad8, quad8.convert_modulus(40e3, to=fine, cut_length=0.06), fine)
    with pytest.raises(AssertionError):
        check_same_response(40e3, quad8, fine.convert_modulus(40e3, to=quad8, cut_length=0.06), fine)


def test_conversion_there_and_back_returns_the_modulus(quad8: CutModel, uneven: CutModel) -> None:
    a = np.linspace(0.0, 0.15, 7)
    moduli = np.linspace(10e3, 50e3, 7)
    there = quad8.convert_modulus(moduli, to=uneven, cut_length=a)
    assert there != pytest.approx(moduli, rel=1e-3)
    assert uneven.convert_modulus(there, to=quad8, cut_length=a) == pytest.approx(moduli, rel=1e-12)
    assert quad8.convert_modulus(moduli, to=quad8, cut_length=a) == pytest.approx(moduli, rel=1e-12)


# ------------------------------------------------------------------------------------------------------ mesh

MODELS = [("quad4", "plane_stress", (4, 5)), ("quad8", "plane_stress", (4, 5)), ("hex20", "solid", (4, 3, 2))]


@pytest.mark.parametrize(("element", "formulation", "divisions"), MODELS)
def test_element_centres_are_indexed_across_along_and_through(
    element: str, formulation: str, divisions: tuple[int, ...]
) -> None:
    model = CutModel(element, formulation, divisions=divisions)
    centres = model.element_centres.reshape(*divisions, model.dim)
    for axis in range(model.dim):
        line = np.moveaxis(centres[..., axis], axis, 0).reshape(divisions[axis], -1)
        assert (np.diff(line[:, 0]) > 0).all()
        assert np.ptp(line, axis=1) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("element", "formulation", "divisions"), MODELS)
def test_every_node_of_the_line_has_one_partner_in_the_same_place(
    element: str, formulation: str, divisions: tuple[int, ...]
) -> None:
    model = CutModel(element, formulation, divisions=divisions)
    left, right = model.pairs.T
    assert (model.nodes[left] == model.nodes[right]).all()
    on_line = np.flatnonzero(model.nodes[:, 0] == 0.0)
    assert sorted([*left, *right]) == sorted(on_line)
    assert len(np.unique(model.nodes, axis=0)) == model.n_nodes - len(left)
    centres = model.element_centres[:, 0]
    for nodes, side in ((left, centres < 0), (right, centres > 0)):
        corners = np.intersect1d(nodes, model.elements)
        assert set(corners) <= set(model.elements[side].ravel())


# -------------------------------------------------------------------------------------- immutability, copies


def test_a_model_does_not_change(quad8: CutModel, uneven: CutModel) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        quad8.poisson = 0.4  # type: ignore[misc]
    assert uneven.relative_modulus is not None
    arrays = ("nodes", "elements", "pairs", "tips", "element_centres", "unit_fields", "relative_modulus")
    for name in arrays:
        with pytest.raises(ValueError, match="read-only"):
            getattr(uneven, name)[0] = 0


def test_a_model_keeps_its_own_modulus() -> None:
    mine = np.ones(120)
    model = CutModel(relative_modulus=mine)
    mine[:] = 7.0
    assert (np.asarray(model.relative_modulus) == 1.0).all()
    assert model.stiffness(0.05) == CutModel().stiffness(0.05)


def test_copies_are_equal_and_answer_equally(quad8: CutModel, uneven: CutModel) -> None:
    for model in (quad8, uneven):
        for twin in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model), copy.copy(model)):
            assert twin == model
            assert hash(twin) == hash(model)
            assert repr(twin) == repr(model)
            assert (twin.unit_fields == model.unit_fields).all()
    assert quad8 != uneven
    assert quad8 != CutModel(poisson=0.31)
    assert quad8 != CutModel(integration="reduced")
    assert quad8 != "CutModel()"


# ------------------------------------------------------------------------------------------------- bad input

BAD_ARGUMENTS: list[tuple[dict[str, Any], str]] = [
    ({"element": "quad9"}, r"element must be one of .*'quad9'.*Did you mean 'quad8'"),
    ({"formulation": "plane-stress"}, r"Did you mean 'plane_stress'"),
    ({"element": "hex20"}, r'Ask for formulation="solid"'),
    ({"formulation": "solid"}, r'Ask for element="hex20"'),
    ({"poisson": 0.5}, r"poisson = 0.5 is outside 0 to 0.499. Take 0.499"),
    ({"element": "quad8_mixed"}, r'Ask for formulation="plane_strain"'),
    ({"element": "quad8_mixed", "formulation": "plane_strain", "poisson": 0.51}, r"poisson = 0.51 is outside 0 to 0.5"),
    ({"element": "quad4", "integration": "reduced"}, r'goes with "quad8" and "hex20"'),
    ({"integration": "reduce"}, r"Did you mean 'reduced'"),
    ({"poisson": float("nan")}, r"poisson = nan is outside"),
    ({"width": 8}, r"width = 8 m is outside 0.001 to 5 m. Lengths are in metres"),
    ({"length": 15.0}, r"length = 15 m is outside .* Lengths are in metres"),
    ({"thickness": 1.0}, r"thickness = 1 m is outside .* Lengths are in metres"),
    ({"length": -0.15}, r"length = -0.15 m is outside"),
    ({"divisions": (7, 15)}, r"divisions\[0\] = 7 must be even .* Take 8\."),
    ({"divisions": (0, 15)}, r"divisions\[0\] = 0 must be even and at least 2"),
    ({"divisions": (8, 1)}, r"at least 2 elements along the cut"),
    ({"divisions": (8, 15, 4)}, r"divisions of quad8 must be 2 whole numbers, got \(8, 15, 4\)"),
    ({"divisions": (8.0, 15.5)}, r"must be 2 whole numbers"),
    ({"element": "hex20", "formulation": "solid", "divisions": (8, 15)}, r"must be 3 whole numbers"),
    ({"element": "hex20", "formulation": "solid", "divisions": (8, 15, 0)}, r"1 through the thickness"),
    ({"relative_modulus": np.ones(119)}, r"shape \(119,\), but the mesh has 120 elements"),
    ({"relative_modulus": np.ones((8, 15))}, r"ravel an array that is shaped as divisions"),
    ({"relative_modulus": np.zeros(120)}, r"relative_modulus = 0 is outside"),
    ({"relative_modulus": np.full(120, np.nan)}, r"relative_modulus = nan is outside"),
]


@pytest.mark.parametrize(("arguments", "message"), BAD_ARGUMENTS)
def test_bad_arguments_are_refused_with_the_cure(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CutModel(**arguments)
