"""The steered model: equal to those of known lines, whatever the cut; and the plant that solves it as it is cut."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cutenv.sim.plant import FreehandPlant, SteeredPlant
from cutenv.sim.tissue import CutModel, Specimen, SteeredModel
from cutenv.sim.tissue.elasticity import element_stiffness, lame_parameters
from cutenv.sim.tissue.lines import arc, bent, half_ellipse, straight
from scripts.validation.physics.crack_truth import led_along

UNEVEN = np.random.default_rng(0).uniform(0.5, 2.0, (8, 15))


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


UPRIGHT = math.radians(90.0)
BESIDE = straight()._replace(y=np.full(301, 0.02))


def led_by_hand(plant: SteeredPlant, steps: int = 300) -> SteeredPlant:
    for k in range(steps):
        plant.advance(0.012, UPRIGHT, 20, 0.25 * math.sin(k / 40))
    return plant


def test_on_the_line_of_its_mesh_the_force_is_that_of_the_table() -> None:
    specimen = Specimen.drawn(3, specimen_class="uniform")
    free, table = FreehandPlant(specimen), SteeredPlant(specimen, straight())
    works = []
    for plant in (free, table):
        for _ in range(300):
            plant.advance(0.012, UPRIGHT, 20)
        works.append(plant.energy()["work"])
    assert works[0] == pytest.approx(works[1], rel=5e-3)
    ahead = slice(40, 250)  # from 20 mm on: nearer, the clamp holds an element of 10 mm at the tip
    assert free.steerings["along"][0][ahead] == pytest.approx(table.steerings["along"][0][ahead], rel=2e-3)


def test_energy_is_an_identity_wherever_the_blade_is_led() -> None:
    for seed in range(3):
        rng, plant = np.random.default_rng(seed), FreehandPlant(Specimen.drawn(seed))
        for _ in range(120):
            plant.advance(rng.uniform(-0.005, 0.025), rng.uniform(0.8, 1.57), 25, rng.uniform(-1.5, 1.5))
        energy = plant.energy()
        assert abs(energy["residual"]) <= 1e-12 * max(energy["work"], 1e-3)
        assert min(energy[name] for name in ("loss", "fracture", "friction", "stored")) >= -1e-15
        assert len(plant.cut) > 3


def test_the_model_is_cut_where_the_tip_went() -> None:
    plant = FreehandPlant(Specimen.drawn(0))
    tips = [plant.tip]
    for k in range(250):
        plant.advance(0.012, UPRIGHT, 20, 0.4 * math.sin(k / 30))
        tips.append(plant.tip)
    fine = np.linspace(0.0, len(tips) - 1.0, 20 * len(tips))  # it runs straight on between
    passed = np.column_stack([np.interp(fine, np.arange(len(tips)), axis) for axis in np.transpose(tips)])
    gaps = [np.hypot(*(passed - node).T).min() for node in plant.cut]
    assert max(gaps) < 3e-4
    assert math.dist(plant.cut[-1], plant.tip) < 0.01


def test_a_second_thread_cuts_the_same_within_a_percent() -> None:
    alone, beside = (led_by_hand(FreehandPlant(Specimen.drawn(3), background=way)) for way in (False, True))
    assert isinstance(beside, FreehandPlant)
    beside.settle()
    assert beside.energy()["work"] == pytest.approx(alone.energy()["work"], rel=0.02)
    assert math.dist(beside.tip, alone.tip) < 3e-3
    assert len(beside.cut) >= 12


@pytest.mark.real_time
def test_a_command_does_not_wait_for_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    grown = SteeredModel.cut_to
    slow = 0.4

    def late(self: SteeredModel, point: object, angle: float | None = None) -> int:
        time.sleep(slow)
        return grown(self, point, angle)  # type: ignore[arg-type]

    plant = FreehandPlant(Specimen.drawn(3), background=True)
    monkeypatch.setattr(SteeredModel, "cut_to", late)
    start = time.perf_counter()
    for _ in range(20):
        plant.advance(0.02, UPRIGHT, 10)
    assert plant.cut_distance.size > 2
    assert time.perf_counter() - start < slow
    monkeypatch.undo()
    plant.settle()


def test_a_second_cut_feels_the_first() -> None:
    specimen = Specimen.drawn(1, specimen_class="uniform")
    first = led_by_hand(FreehandPlant(specimen, straight()), 200)
    assert isinstance(first, FreehandPlant)
    again = FreehandPlant(specimen, BESIDE, model=first.model)
    fresh = FreehandPlant(specimen, BESIDE)
    assert again.blade == fresh.blade == (0.0, 0.02)
    assert first.cut[0] == pytest.approx([0.0, 0.0])  # the first plant keeps its own
    for plant in (again, fresh):
        for _ in range(150):
            plant.advance(0.012, UPRIGHT, 20)
    softer = again.steerings["along"][0][60] / fresh.steerings["along"][0][60]
    assert 0.9 < softer < 0.999


def test_a_crack_that_meets_a_cut_ends_and_says_so() -> None:
    specimen = Specimen.drawn(1)
    first = FreehandPlant(specimen)
    for _ in range(300):
        first.advance(0.015, UPRIGHT, 20)
    second = FreehandPlant(specimen, BESIDE, model=first.model)
    for k in range(300):
        second.advance(0.015, UPRIGHT, 20, -0.6 if k < 60 else 0.0)
        if second.end:
            break
    assert second.end is not None
    assert "cannot go on from" in second.end
    assert abs(second.energy()["residual"]) <= 1e-12 * second.energy()["work"]


def test_beside_a_drawn_line_places_are_told_along_it() -> None:
    plant = FreehandPlant(Specimen.drawn(0), half_ellipse())
    plant.advance(0.01, UPRIGHT, 2000, -0.2)  # to the right of the line, which bends to the right itself
    assert float(plant.states["blade"][0]) == pytest.approx(0.019, abs=2e-3)
    x, y = plant.blade
    gap = np.hypot(plant.line.x - x, plant.line.y - y).min()
    assert abs(plant.distance) == pytest.approx(gap, abs=1e-4)
    assert gap > 3e-4


def test_a_line_is_given_as_such() -> None:
    with pytest.raises(ValueError, match=r"line.y at its start = 0.2 m is outside -0.03 to 0.03 m"):
        FreehandPlant(Specimen.drawn(0), bent(np.zeros(301))._replace(y=np.full(301, 0.2)))
