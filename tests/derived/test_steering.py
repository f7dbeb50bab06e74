"""The law in the plane: scripts/check_steering.py over one specimen, the drawn lines, and the model along them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import check_steering
import numpy as np
import pytest
from adversarial_motions import FEED, UPRIGHT
from check_physics import drawn

from cutenv._engine.work_queue import make_queue
from cutenv.cutting.simulate import Physics, hold_some
from cutenv.cutting.steering import STEERED, SteeringParameters
from cutenv.plant import SimulatedPlant, SteeredPlant
from cutenv.tissue import Specimen, SteeredModel
from cutenv.tissue.lines import (
    LARGEST_CURVATURE,
    CutLine,
    arc,
    bent,
    half_ellipse,
    length_within,
    random_line,
    s_shape,
    straight,
    through,
)
from cutenv.tissue.path_model import PathModel, stiffness_on_line


@pytest.mark.parametrize(
    "part", ["straight", "account", "bends", "steered", "table", "second solver", "turned", "fracture", "arcs"]
)
def test_every_promise_is_kept(part: str) -> None:
    rows = list(check_steering.CHECKS[part](drawn(1)))
    assert [str(row) for row in rows if row.holds is not True and row.promised] == []


def test_stiffness_that_is_not_converted_breaks_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SteeredModel, "converted_stiffness", lambda model, element: model.stiffness)
    broken = [row.holds for row in check_steering.CHECKS["steered"]([])]
    assert broken[4:7] == [False, False, False]


def test_every_promise_of_the_model_is_kept() -> None:
    rows = list(check_steering.check_model([], finest=2))
    assert [str(row) for row in rows if row.holds is not True and row.promised] == []


def test_the_crack_lags_inside_a_bend_and_outside_when_it_turns_late() -> None:
    turns, specimen = np.full(len(FEED), FEED[0] / 0.04), Specimen.drawn(0)
    cuts = {
        limit: check_steering.led(specimen, arc(0.04), turns, FEED, UPRIGHT, SteeringParameters(crack_curvature=limit))
        for limit in (1.0, 100.0)
    }
    late, soon = (cut.plant.steerings[0]["tip_aside"] for cut in cuts.values())
    assert late < soon - 1e-3  # 1 m: hardly any bend, so that it goes on straight, to the right of the arc


def test_a_blade_beside_the_tip_is_pushed_back_toward_it() -> None:
    plant = SteeredPlant(Specimen.drawn(0, specimen_class="uniform"), straight())
    plant.advance(0.01, UPRIGHT, 300)
    for _ in range(15):
        plant.advance(0.0, UPRIGHT, 20, 4.0)
    plant.advance(0.004, UPRIGHT, 400)
    assert plant.heading == pytest.approx(1.2, abs=0.01)
    assert plant.distance > 5e-4
    x, y = np.subtract(plant.blade, plant.tip)
    to_the_right = x * math.sin(plant.heading) - y * math.cos(plant.heading)
    assert plant.lateral_force[-1] * to_the_right < 0.0
    assert plant.energy()["stored"] > 0.0


def test_the_driven_blade_on_a_straight_line_is_the_simulated_plants() -> None:
    specimen = Specimen.drawn(3)
    ours, other = SteeredPlant(specimen, straight(), seed=5), SimulatedPlant(specimen, seed=5)
    for speed, angle in ((0.01, 1.5), (0.02, 0.9), (-0.005, 1.2)):
        for _ in range(40):
            assert np.array_equal(ours.advance(speed, angle, 20), other.advance(speed, angle, 20))
    assert ours.energy()["work"] == other.energy()["work"]


def test_places_on_a_bent_line_are_those_of_the_blades_motion() -> None:
    plant = SteeredPlant(Specimen.drawn(1), half_ellipse())
    places = check_steering.follow_line(plant, 0.01, 0.06)
    line, s = plant.line, float(plant.states["blade"][0])
    grid = np.arange(len(line.x)) * 5e-4
    angle = np.interp(s, grid, line.angle)
    told = np.array([
        np.interp(s, grid, line.x) - plant.distance * math.sin(angle),
        np.interp(s, grid, line.y) + plant.distance * math.cos(angle),
    ])  # fmt: skip
    assert places[-1] == pytest.approx(told, abs=5e-5)


def test_a_batch_is_its_cuts_one_by_one() -> None:
    lines = [half_ellipse(), arc(-0.05), straight(), random_line(np.random.default_rng(3))]
    plants = [SteeredPlant(Specimen.drawn(k), lines[k % 4], seed=k) for k in range(40)]
    cuts = Physics(*map(np.concatenate, zip(*(plant.snapshot() for plant in plants), strict=True)))
    rng, felt = np.random.default_rng(0), np.zeros((40, 2))
    for _ in range(40):
        commands = rng.uniform((-0.002, 0.8, -1.0), (0.02, 1.57, 1.0), (40, 3))
        hold_some(STEERED)(make_queue(40), 0, cuts, commands, 20, felt)
        for plant, (speed, angle, turn), forces in zip(plants, commands, felt, strict=True):
            readings = plant.advance(speed, angle, 20, turn)
            assert (readings["force"][-1], plant.lateral_force[-1]) == tuple(forces)


LINES: dict[str, Callable[[], CutLine]] = {
    "straight": straight,
    "arc": lambda: arc(-0.03),
    "S": lambda: s_shape(0.03, 0.08),
    "half an excision": lambda: half_ellipse(0.1, -0.02),
    "random": lambda: random_line(np.random.default_rng(1)),
    "through points": lambda: through([(0, 0), (0.03, 0.004), (0.06, 0.002), (0.1, -0.006)]),
}


@pytest.mark.parametrize("name", LINES)
def test_a_line_is_its_own_direction_and_curvature(name: str) -> None:
    line = LINES[name]()
    ways = np.hypot(np.diff(line.x), np.diff(line.y))
    assert ways == pytest.approx(np.full(300, 5e-4), rel=1e-3)
    middle = 0.5 * (line.angle[1:] + line.angle[:-1])
    assert np.arctan2(np.diff(line.y), np.diff(line.x)) == pytest.approx(middle, abs=2e-3)
    assert np.diff(line.angle) == pytest.approx(2.5e-4 * (line.curvature[1:] + line.curvature[:-1]), abs=1.3e-2)
    assert abs(line.curvature).max() <= LARGEST_CURVATURE
    assert 0.03 <= length_within(line) <= 0.15


def test_a_drawn_line_depends_on_the_seed_alone() -> None:
    first, again, other = (random_line(np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert np.array_equal(first.y, again.y)
    assert not np.array_equal(first.y, other.y)
    assert length_within(first) >= 0.1


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ([(0, 0), (0.05, 0.0), (0.04, 0.01)], r"turns back at \(0.04, 0.01\)"),
        ([(0, 0), (0.05, 0.05), (0.1, 0.05)], "leaves the slab at .* Stay within 30 mm"),
        ([(0, 0), (0.005, 0.0), (0.01, 0.004), (0.015, 0.004)], "bends too far"),
        ([(0, 0.1), (1, 1), (2, 2)], "starts at .* middle"),
        ([(0, 0), (0.1, float("nan")), (0.12, 0)], "finite"),
        ([(0, 0), (0.1, 0.0)], "three or more"),
    ],
)
def test_a_bad_line_is_refused_with_the_place(points: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        through(points)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: arc(0.01), "radius"),
        (lambda: s_shape(0.025, 0.1), "turns too far"),
        (lambda: half_ellipse(0.08, 0.04), "height"),
        (lambda: bent(np.zeros(3)), "curvature of shape"),
        (lambda: PathModel(straight(), formulation="solid"), "solid"),
        (lambda: PathModel(straight(), divisions=(7, 15)), "divisions"),
        (lambda: PathModel(straight()).displacement(99, [1.0, 0.0]), "tip"),
    ],
)
def test_a_bad_argument_is_named(make: Callable[[], Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((0.6, 1.5, 20, 0.0), "speed"),
        ((0.01, 1.5, 20, 9.0), "turn_rate"),
        ((0.01, 0.1, 20, 0.0), "angle"),
        ((0.01, 1.5, 0, 0.0), "ticks"),
    ],
)
def test_a_bad_command_is_named(arguments: tuple[float, float, int, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        SteeredPlant(Specimen.drawn(0), straight()).advance(*arguments)


def test_a_straight_line_has_the_specimens_own_stiffness() -> None:
    specimen = Specimen.drawn(2)
    found = stiffness_on_line(specimen, straight())
    assert np.array_equal(found.along, specimen.stiffness())
    assert not found.coupled.any()


def test_displacement_is_the_stiffness_inverted_at_the_tip() -> None:
    model = PathModel(half_ellipse())
    k = 4
    force = np.array([0.7, -0.2])
    moved = model.displacement(k, force)[model.mesh.tip_pairs[k, 0, 0]]
    x, y = moved[1], -moved[0]  # the mesh has its second axis along the slab, and -x to the left
    angle = np.interp(model.tips[k], np.arange(301) * 5e-4, model.line.angle)
    own = np.array([x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)])
    assert own == pytest.approx(np.linalg.solve(model.stiffness[k], force), rel=1e-3)
