"""The law where the blade also descends or is steered: its checks over one specimen, and broken on purpose."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from cutenv._engine.parallel import make_queue
from cutenv.sim.cutting.descent import DESCENDING
from cutenv.sim.cutting.simulate import Physics, hold_some
from cutenv.sim.cutting.steering import STEERED, SteeringParameters
from cutenv.sim.plant import DescendingPlant, SimulatedPlant, SteeredPlant
from cutenv.sim.tissue import Layers, Specimen
from cutenv.sim.tissue.layers import layered_depth
from cutenv.sim.tissue.lines import (
    LARGEST_CURVATURE,
    CutLine,
    arc,
    half_ellipse,
    length_within,
    random_line,
    s_shape,
    straight,
    through,
)
from cutenv.sim.tissue.path_model import PathModel, stiffness_on_line
from scripts.validation.physics import crack_truth, descent, steering
from scripts.validation.physics.adversarial_motions import FEED, TICKS, UPRIGHT
from scripts.validation.physics.promises import drawn

CHECKED = [(descent, part) for part in ("level-zero", "account", "limits", "friction", "pressing")] + [
    (steering, part) for part in steering.CHECKS if part not in ("model", "beside")
]


@pytest.mark.parametrize(("script", "part"), CHECKED, ids=lambda value: value if isinstance(value, str) else "")
def test_every_promise_is_kept(script: Any, part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The account of a steered blade along a line that bends to both sides, and one arc; the script has all of them."""
    if (script, part) == (steering, "account"):
        monkeypatch.setattr(steering, "LINES", {"random": steering.LINES["random"]})
    monkeypatch.setitem(steering.CHECKS, "arcs", partial(crack_truth.check_arcs, half_angles=(20.0,)))
    rows = list(script.CHECKS[part](drawn(1)))
    assert [str(row) for row in rows if row.holds is not True and row.promised] == []


def descending(specimen: Specimen, number: int, seed: int = 0) -> DescendingPlant:
    return DescendingPlant(specimen, seed=seed, layers=Layers(boundary=0.01) if number else Layers())


def steered(specimen: Specimen, number: int, seed: int = 0) -> SteeredPlant:
    lines = [straight(), half_ellipse(), arc(-0.05), random_line(np.random.default_rng(3))]
    return SteeredPlant(specimen, lines[number % 4], seed=seed)


@pytest.mark.parametrize("make", [descending, steered])
def test_with_nothing_added_the_driven_blade_is_the_simulated_plants(make: Callable[..., Any]) -> None:
    specimen = Specimen.drawn(3)
    ours, other = make(specimen, 0, seed=5), SimulatedPlant(specimen, seed=5)
    for speed, angle in ((0.01, 1.5), (0.02, 0.9), (-0.005, 1.2)):
        for _ in range(40):
            assert np.array_equal(ours.advance(speed, angle, 20), other.advance(speed, angle, 20))
    assert ours.energy()["work"] == other.energy()["work"]


@pytest.mark.parametrize(
    ("make", "motion", "force", "lowest", "highest"),
    [(descending, DESCENDING, "vertical_force", -0.003, 0.005), (steered, STEERED, "lateral_force", -1.0, 1.0)],
)
def test_a_batch_is_its_cuts_one_by_one(
    make: Callable[..., Any], motion: Any, force: str, lowest: float, highest: float
) -> None:
    plants = [make(Specimen.drawn(k), k + 1, seed=k) for k in range(40)]
    cuts = Physics(*map(np.concatenate, zip(*(plant.snapshot() for plant in plants), strict=True)))
    rng, felt = np.random.default_rng(0), np.zeros((40, 2))
    for _ in range(40):
        commands = rng.uniform((-0.002, 0.8, lowest), (0.02, 1.57, highest), (40, 3))
        hold_some(motion)(make_queue(40), 0, cuts, commands, 20, felt)
        for plant, (speed, angle, third), forces in zip(plants, commands, felt, strict=True):
            readings = plant.advance(speed, angle, 20, third)
            assert (readings["force"][-1], getattr(plant, force)[-1]) == tuple(forces)


@pytest.mark.parametrize(("make", "third", "beyond"), [(descending, "descent_speed", 0.6), (steered, "turn_rate", 9.0)])
def test_a_bad_command_is_named(make: Callable[..., Any], third: str, beyond: float) -> None:
    plant = make(Specimen.drawn(0), 0)
    for arguments, says in (
        ((0.6, 1.5, 20, 0.0), "speed"),
        ((0.01, 1.5, 20, beyond), third),
        ((0.01, 0.1, 20, 0.0), "angle"),
        ((0.01, 1.5, 0, 0.0), "ticks"),
    ):
        with pytest.raises(ValueError, match=says):
            plant.advance(*arguments)


ANYWHERE = {
    "held above": lambda k: -0.005 if k < 20 else 0.0,
    "held below": lambda k: 0.005 if k < 20 else 0.0,
    "ramp down": lambda k: 0.001,
    "ramp up": lambda k: -0.001,
    "waving": lambda k: 0.004 * np.sin(0.12 * k),
    "pressing in bursts": lambda k: 0.01 if k % 50 < 10 else 0.0,
}


@pytest.mark.parametrize("motion", ANYWHERE)
def test_no_force_leaps_up_for_one_update(motion: str) -> None:
    """A run lets the tissue pass the edge by millimetres in one update; that is not drawn over the blade's motion."""
    plant = DescendingPlant(Specimen.drawn(0), layers=Layers(boundary=0.014, deep_toughness=3.0))
    forces, upwards, runs = [], [], 0
    for k in range(150):
        readings = plant.advance(0.01, UPRIGHT, 20, ANYWHERE[motion](k))
        forces.append(readings["true_force"])
        upwards.append(plant.vertical_force)
        runs += int((readings["jump"] > 0.0).sum())
    force, upward = np.concatenate(forces), np.concatenate(upwards)
    assert runs >= 5
    assert np.minimum(force[1:-1] - force[:-2], force[1:-1] - force[2:]).max() < 0.03
    assert np.minimum(np.abs(upward[1:-1] - upward[:-2]), np.abs(upward[1:-1] - upward[2:])).max() < 0.05


def test_tissue_that_a_blade_at_level_zero_carries_along_lifts_it() -> None:
    plant = DescendingPlant(Specimen.drawn(0, specimen_class="uniform"))
    readings = plant.advance(0.01, UPRIGHT, 300)
    assert readings["elastic_force"][-1] > 0.1
    stiffness = readings["elastic_force"][-1] / (readings["position"][-1] - readings["tip"][-1])
    lifted = 0.5 * readings["elastic_force"][-1] ** 2 / stiffness / plant.depth[0]  # if K were proportional to depth
    assert 0.3 * lifted < plant.vertical_force[-1] < 1.5 * lifted


@pytest.mark.parametrize(
    "layers", [Layers(boundary=0.006, deep_toughness=3.0), Layers(capsule_toughness=5.0, capsule_thickness=1e-3)]
)
def test_a_tougher_layer_costs_more(layers: Layers) -> None:
    specimen = Specimen.drawn(0, specimen_class="uniform")
    levels = np.full(TICKS, -0.002)
    soft, tough = (descent.led(specimen, 2.0 * FEED, levels, UPRIGHT, each) for each in (None, layers))
    assert tough.plant.energy()["fracture"] > 1.1 * soft.plant.energy()["fracture"]


def test_a_drawn_edge_cuts_deeper_than_a_pressed_one() -> None:
    """Slice and push: at the same pressing, which alone does not cut, a blade that is drawn back sinks in."""
    specimen = Specimen.drawn(0, specimen_class="uniform")
    lead = np.concatenate((FEED, FEED[-1] - 5e-6 * np.arange(2000)))  # until it is in the open cut
    press = np.concatenate((np.zeros(len(lead)), np.linspace(0.0, -1e-3, 500), np.full(2000, -1e-3)))
    rest = np.full(2500, lead[-1])
    drawn_back = lead[-1] - np.minimum(np.maximum(np.arange(2500) - 500, 0) * 5e-6, 0.008)
    opened = [
        descent.led(specimen, np.concatenate((lead, way)), press, UPRIGHT).plant.descents[0]["opened"]
        for way in (rest, drawn_back)
    ]
    assert opened[0] == 0.0
    assert opened[1] > 1e-6


def test_a_raised_blade_cuts_less_deep_and_the_floor_shows_it() -> None:
    plant = DescendingPlant(Specimen.drawn(0, specimen_class="uniform"))
    for k in range(200):
        plant.advance(0.02, UPRIGHT, 20, -0.004 if 60 <= k < 110 else 0.0)
    cut = plant.floor[: int(plant.states[0]["tip"] / 5e-4)]
    assert plant.level == pytest.approx(0.004, abs=2e-4)
    assert cut[5] == pytest.approx(cut[-5] + plant.level, abs=2e-4)


STIFF_LAYERS = [Layers(boundary=0.012, deep_modulus=5.0), Layers(capsule_thickness=1e-3, capsule_modulus=10.0)]


@pytest.mark.parametrize("layers", STIFF_LAYERS)
def test_stiffness_goes_on_without_a_step_through_layers(layers: Layers) -> None:
    depths = np.linspace(5e-4, 0.02, 100_001)
    stiffness = np.array([layered_depth(layers, depth, depth + 0.003) for depth in depths])
    assert np.abs(np.diff(stiffness)).max() < 1e-5
    assert stiffness.min() > depths[0] + 0.003


def test_every_promise_of_the_model_is_kept() -> None:
    rows = list(steering.check_model([], finest=2))
    assert [str(row) for row in rows if row.holds is not True and row.promised] == []


def test_the_crack_lags_inside_a_bend_and_outside_when_it_turns_late() -> None:
    turns, specimen = np.full(len(FEED), FEED[0] / 0.04), Specimen.drawn(0)
    cuts = {
        limit: steering.led(specimen, arc(0.04), turns, FEED, UPRIGHT, SteeringParameters(crack_curvature=limit))
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


def test_places_on_a_bent_line_are_those_of_the_blades_motion() -> None:
    plant = SteeredPlant(Specimen.drawn(1), half_ellipse())
    places = steering.follow_line(plant, 0.01, 0.06)
    line, s = plant.line, float(plant.states["blade"][0])
    grid = np.arange(len(line.x)) * 5e-4
    angle = np.interp(s, grid, line.angle)
    told = np.array([
        np.interp(s, grid, line.x) - plant.distance * math.sin(angle),
        np.interp(s, grid, line.y) + plant.distance * math.cos(angle),
    ])  # fmt: skip
    assert places[-1] == pytest.approx(told, abs=5e-5)


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
