"""The steered model: equal to the models of known lines, whatever the cut, by its one factorisation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cutenv.tissue import CutModel, PathModel, SteeredModel
from cutenv.tissue.elasticity import lame_parameters
from cutenv.tissue.element_matrices import element_stiffness, local_compliance, square_compliance
from cutenv.tissue.lines import CutLine, arc, half_ellipse, random_line, s_shape
from cutenv.tissue.split_mesh import SplitMesh, whole

UNEVEN = np.random.default_rng(0).uniform(0.5, 2.0, (8, 15))


def led_along(line: CutLine, model: SteeredModel, length: float) -> list[tuple[float, Any]]:
    """Lead a cut along a line; return the arc length and the stiffness with squares of 10 mm at each tip."""
    model.begin(angle=line.angle[0])
    ways, grid = np.arange(0.0, length, 1e-4), np.arange(len(line.x)) * 5e-4
    x, y, angle = (np.interp(ways, grid, values) for values in (line.x, line.y, line.angle))
    return [
        (ways[i], model.converted_stiffness(0.01)) for i in range(1, len(ways)) if model.cut_to((x[i], y[i]), angle[i])
    ]


@pytest.mark.parametrize("modulus", [None, UNEVEN.ravel()], ids=["uniform", "uneven"])
def test_a_straight_cut_is_that_of_the_straight_model(modulus: Any) -> None:
    ours, plain = SteeredModel((8, 15), relative_modulus=modulus), CutModel(relative_modulus=modulus)
    ours.begin()
    for k, a in enumerate(plain.tips):
        assert ours.cut_to((a, 0.0)) == 1
        assert 1.0 / ours.compliance[0, 0] == pytest.approx(plain.stiffness(a), rel=1e-10)
        moved = plain.displacement(a, 1.0, 1.0, 1.0)[plain.pairs[-1, 0]][::-1] * [1, -1]
        assert ours.displacement((1.0, 0.0))[-1, 8] == pytest.approx(moved, abs=1e-9) or k < 14
    assert ours.n_touched < 300


def test_four_parallel_cuts_are_those_of_the_straight_model() -> None:
    """The thesis's pattern: lines 2 cm apart in one piece, one after the other."""
    model, before = SteeredModel((8, 15)), []
    for y, length in ((0.03, 0.08), (0.01, 0.06), (-0.01, 0.1), (-0.03, 0.05)):
        model.begin((0.0, y))
        assert model.cut_to((length, y)) == round(length / 0.01)
        earlier = tuple((y - other, cut) for other, cut in before)
        plain = CutModel(offset=-y, earlier_cuts=earlier)
        assert 1.0 / model.compliance[0, 0] == pytest.approx(plain.stiffness(length), rel=1e-10)
        before.append((y, length))


@pytest.mark.parametrize("make", [half_ellipse, lambda: arc(-0.03)], ids=["half an excision", "arc"])
def test_a_cut_along_the_line_of_the_mesh_is_that_of_its_model(make: Callable[[], CutLine]) -> None:
    line = make()
    plain, ours = PathModel(line), SteeredModel((8, 15), line=line)
    ours.begin(angle=line.angle[0])
    for k, expected in enumerate(plain.stiffness):
        across, along = plain.mesh.nodes[plain.mesh.tip_pairs[k, 0, 0]]
        middle, end = (np.interp(x, line.x, line.angle) for x in (0.5 * (along + ours.tip[0]), along))
        ours.advance((along, -across), end, middle)
        assert ours.stiffness == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(
    "make", [half_ellipse, lambda: s_shape(0.03, 0.08), lambda: random_line(np.random.default_rng(2))]
)
def test_a_cut_between_the_edges_of_the_mesh_is_that_along_them(make: Callable[[], CutLine]) -> None:
    """On a mesh that does not know the line, after conversion to the same elements at the tip, within 3 %."""
    line = make()
    ways, known = zip(*led_along(line, SteeredModel(line=line), 0.09), strict=True)
    found = [(way, each) for way, each in led_along(line, SteeredModel(), 0.09) if way > 0.02]
    assert len(found) > 10
    for way, each in found:
        expected = np.array([[np.interp(way, ways, np.array(known)[:, i, j]) for j in (0, 1)] for i in (0, 1)])
        assert each == pytest.approx(expected, abs=0.03 * expected[0, 0])


def test_conversion_brings_two_meshes_together() -> None:
    line, models = arc(0.04), []
    for model in (SteeredModel(line=line), SteeredModel()):
        led_along(line, model, 0.036)
        models.append(model)
    raw = abs(models[0].stiffness - models[1].stiffness).max()
    converted = abs(models[0].converted_stiffness(0.005) - models[1].converted_stiffness(0.005)).max()
    assert converted < 0.02 < 2.0 * raw < 0.2
    assert converted < 0.4 * raw
    straight = SteeredModel()
    straight.begin()
    straight.cut_to((0.05, 0.0))
    assert straight.converted_stiffness(0.005) == pytest.approx(straight.stiffness, abs=1e-3)


def test_a_cut_to_the_left_mirrors_one_to_the_right() -> None:
    cuts = []
    for sign in (1.0, -1.0):
        model = SteeredModel()
        model.begin()
        for point in ((0.03, 0.004), (0.05, 0.015), (0.055, 0.03)):
            model.cut_to((point[0], sign * point[1]))
        cuts.append(model.stiffness)
    assert cuts[0] * [[1, -1], [-1, 1]] == pytest.approx(cuts[1], abs=1e-9)


def test_any_way_of_a_hand_is_cut() -> None:
    rng = np.random.default_rng(7)
    for _ in range(6):
        model, angle, place = SteeredModel(), 0.0, np.zeros(2)
        model.begin()
        for _ in range(150):
            angle = np.clip(angle + rng.normal(0.0, 0.25), -1.2, 1.2) - 0.3 * np.sign(place[1]) * (abs(place[1]) > 0.02)
            ahead = place + 1e-3 * np.array([math.cos(angle), math.sin(angle)])
            if ahead[0] > 0.14:
                break
            place = ahead
            model.cut_to(place)
        assert math.dist(model.tip, place) < 0.01
        found = model.stiffness
        assert found == pytest.approx(found.T, abs=1e-9)
        assert np.linalg.eigvalsh(found).min() > 0.0
        assert abs(model.mesh.at((0, 0))[1]) == pytest.approx(0.04)


def test_a_copy_goes_its_own_way() -> None:
    model = SteeredModel((8, 15))
    model.begin()
    model.cut_to((0.04, 0.0))
    before, other = model.stiffness, model.copy()
    other.cut_to((0.06, 0.01))
    other.go_straight_on()
    assert len(other.path) > len(model.path)
    assert np.array_equal(model.stiffness, before)
    model.cut_to((0.06, 0.01))
    model.go_straight_on()
    assert model.stiffness == pytest.approx(other.stiffness, abs=1e-12)


def test_energy_of_a_pull_at_the_far_end_grows_with_the_cut() -> None:
    model = SteeredModel((8, 15), faces="open")
    forces = np.zeros_like(model.mesh.positions)
    forces[-1, 0], forces[-1, -1] = (0.0, -1.0), (0.0, 1.0)  # apart
    energies = [model.pushed(forces)]
    model.begin((0.15, 0.0), math.pi)
    for x in (0.13, 0.11, 0.09):
        model.cut_to((x, 0.0))
        energies.append(model.pushed(forces))
    assert np.diff(energies).min() > 0.0
    assert model.pushed(pressure=1.0) > 0.0


def test_the_mesh_for_other_programs_has_the_same_stiffness() -> None:
    """Assembled whole, with the faces' sliding as constraints, and solved at once."""
    model = SteeredModel((8, 15))
    model.begin()
    for point in ((0.03, 0.004), (0.05, 0.015), (0.055, 0.025)):
        model.cut_to(point)
    mesh = model.doubled_mesh()
    assert len(mesh.triangles) > 1
    n = 2 * len(mesh.nodes)
    whole_stiffness = np.zeros((n, n))
    for elements in (mesh.quadrilaterals, mesh.triangles):
        unknowns = (2 * elements[..., np.newaxis] + np.arange(2)).reshape(len(elements), -1)
        for rows, block in zip(
            unknowns, element_stiffness(mesh.nodes[elements], *lame_parameters("plane_stress", 0.3)), strict=True
        ):
            whole_stiffness[np.ix_(rows, rows)] += block
    ties = np.zeros((len(mesh.pairs) + 2 * len(mesh.clamped), n))
    for row, ((left, right), (x, y)) in zip(ties, zip(mesh.pairs, mesh.directions, strict=True), strict=False):
        row[[2 * left, 2 * left + 1, 2 * right, 2 * right + 1]] = (-y, x, y, -x)
    for k, unknown in enumerate([2 * node + axis for node in mesh.clamped for axis in (0, 1)]):
        ties[len(mesh.pairs) + k, unknown] = 1.0
    free = np.linalg.svd(ties)[2][np.linalg.matrix_rank(ties) :].T
    moved = free @ np.linalg.solve(free.T @ whole_stiffness @ free, free[2 * mesh.tip : 2 * mesh.tip + 2].T)
    assert moved[2 * mesh.tip : 2 * mesh.tip + 2] == pytest.approx(model.compliance, rel=1e-9)


def begun(**arguments: Any) -> SteeredModel:
    model = SteeredModel((8, 15), **arguments)
    model.begin()
    return model


def crossing() -> None:
    model = begun()
    model.cut_to((0.06, 0.0))
    model.begin((0.0, 0.02))
    model.cut_to((0.03, 0.02))
    model.cut_to((0.05, -0.02))


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda: SteeredModel((7, 15)), r"divisions\[0\] = 7"),
        (lambda: SteeredModel(faces="shut"), "faces"),
        (lambda: SteeredModel(formulation="solid"), "formulation"),
        (lambda: SteeredModel(width=0.1, line=half_ellipse()), "line goes with"),
        (lambda: SteeredModel(relative_modulus=np.ones(3)), "relative_modulus has shape"),
        (lambda: SteeredModel().stiffness, "no cut yet"),
        (lambda: SteeredModel().go_straight_on(), "no cut yet"),
        (lambda: begun().stiffness, "not left the clamp"),
        (lambda: begun().begin(), "there is one already"),
        (lambda: SteeredModel().begin((0.2, 0.0)), "outside the slab"),
        (lambda: begun().cut_to((float("nan"), 0.0)), "two finite numbers"),
        (lambda: begun().advance((0.08, 0.0)), "advance by about an element"),
        (lambda: begun().cut_to((0.05, 0.06)), "cannot go on"),
        (lambda: begun().converted_stiffness(0.0), "element"),
        (crossing, "cannot go on from"),
    ],
)
def test_what_cannot_be_cut_is_refused(act: Callable[[], Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        act()


def test_local_compliance_depends_on_the_elements_and_on_no_border() -> None:
    lam, mu = lame_parameters("plane_stress", 0.3)
    grid = SplitMesh(np.stack(np.meshgrid(np.arange(13) * 0.01, np.arange(13) * 0.01, indexing="ij"), axis=-1))

    def of(rings: int) -> Any:
        cells = [whole((i, j)).places for i in range(6 - rings, 6 + rings) for j in range(6 - rings, 6 + rings)]
        return local_compliance(cells, grid.positions.__getitem__, (12, 12), lam, mu)

    assert of(2) == pytest.approx(of(4), abs=2e-3)
    assert of(2) == pytest.approx(square_compliance(0.01, lam, mu) * np.eye(2), abs=1e-12)
    slope = (lam + 3.0 * mu) / (4.0 * math.pi * mu * (lam + 2.0 * mu))  # of Kelvin's logarithm
    finer = square_compliance(0.005, lam, mu) - square_compliance(0.01, lam, mu)
    assert finer == pytest.approx(slope * math.log(2.0), rel=1e-9)


def test_triangles_and_quadrilaterals_stretch_alike() -> None:
    """A patch of a split cell: constant strain stores the energy of its area, and rigid motions none."""
    mesh = SplitMesh(np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0), indexing="ij"), axis=-1))
    mesh.split_cell((0, 0), (2, 2))
    mesh.move((2, 2), np.array([1.2, 0.9]))
    lam, mu = lame_parameters("plane_strain", 0.3)
    strain = np.array([[0.3, 0.1], [0.1, -0.2]])
    spin = np.array([[0.0, -1.0], [1.0, 0.0]])
    stored = turned = area = 0.0
    for cell in ((0, 0), (0, 1), (1, 0), (1, 1)):
        for part in mesh.parts(cell):
            at = np.array([mesh.at(place) for place in part.places])
            stiffness = element_stiffness(at[np.newaxis], lam, mu)[0]
            u, r = (at @ strain.T).ravel(), (at @ spin.T).ravel()
            stored, turned = stored + 0.5 * u @ stiffness @ u, turned + abs(stiffness @ r).max()
    area = 4.0
    assert stored == pytest.approx(area * (0.5 * lam * np.trace(strain) ** 2 + mu * (strain**2).sum()), rel=1e-12)
    assert turned < 1e-12
