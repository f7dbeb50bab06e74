"""The law where the blade also moves up and down: scripts/check_descent.py over one specimen, and broken on purpose."""

from __future__ import annotations

import check_descent
import fit_layers
import numpy as np
import pytest
from adversarial_motions import FEED, TICKS, UPRIGHT
from check_physics import drawn

from cutenv._engine.work_queue import make_queue
from cutenv.cutting.descent import DESCENDING
from cutenv.cutting.simulate import Physics, hold_some
from cutenv.plant import DescendingPlant, SimulatedPlant
from cutenv.tissue import Layers, Specimen
from cutenv.tissue.layers import layered_depth


@pytest.mark.parametrize("part", ["level-zero", "account", "limits"])
def test_every_promise_is_kept(part: str) -> None:
    rows = list(check_descent.CHECKS[part](drawn(1)))
    assert [str(row) for row in rows if row.holds is not True and row.promised] == []


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
    soft, tough = (check_descent.led(specimen, 2.0 * FEED, levels, UPRIGHT, each) for each in (None, layers))
    assert tough.plant.energy()["fracture"] > 1.1 * soft.plant.energy()["fracture"]


def test_a_drawn_edge_cuts_deeper_than_a_pressed_one() -> None:
    """Slice and push: at the same pressing, which alone does not cut, a blade that is drawn back sinks in."""
    specimen = Specimen.drawn(0, specimen_class="uniform")
    lead = np.concatenate((FEED, FEED[-1] - 5e-6 * np.arange(2000)))  # until it is in the open cut
    press = np.concatenate((np.zeros(len(lead)), np.linspace(0.0, -1e-3, 500), np.full(2000, -1e-3)))
    rest = np.full(2500, lead[-1])
    drawn_back = lead[-1] - np.minimum(np.maximum(np.arange(2500) - 500, 0) * 5e-6, 0.008)
    opened = [
        check_descent.led(specimen, np.concatenate((lead, way)), press, UPRIGHT).plant.descents[0]["opened"]
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


def test_at_level_zero_the_driven_blade_is_the_simulated_plants() -> None:
    specimen = Specimen.drawn(3)
    ours, other = DescendingPlant(specimen, seed=5), SimulatedPlant(specimen, seed=5)
    for speed, angle in ((0.01, 1.5), (0.02, 0.9), (-0.005, 1.2)):
        for _ in range(40):
            assert np.array_equal(ours.advance(speed, angle, 20), other.advance(speed, angle, 20))
    assert ours.energy()["work"] == other.energy()["work"]


STIFF_LAYERS = [Layers(boundary=0.012, deep_modulus=5.0), Layers(capsule_thickness=1e-3, capsule_modulus=10.0)]


@pytest.mark.parametrize("layers", STIFF_LAYERS)
def test_stiffness_goes_on_without_a_step_through_layers(layers: Layers) -> None:
    depths = np.linspace(5e-4, 0.02, 100_001)
    stiffness = np.array([layered_depth(layers, depth, depth + 0.003) for depth in depths])
    assert np.abs(np.diff(stiffness)).max() < 1e-5
    assert stiffness.min() > depths[0] + 0.003


def test_the_reach_is_found_again_in_slabs_that_it_made() -> None:
    effective = np.add.outer(np.linspace(0.002, 0.004, 3), fit_layers.LAYERS[2:])
    made = [(layers, fit_layers.ratio_by(layers, effective, 0.0031)) for layers in STIFF_LAYERS]
    assert fit_layers.fitted_reach(effective, made) == pytest.approx(0.0031, rel=1e-4)


def test_no_slab_is_fitted_and_held_out() -> None:
    assert set(fit_layers.FITTED).isdisjoint(fit_layers.HELD_OUT)
    assert set(check_descent.SLAB_LAYERS) <= set(fit_layers.HELD_OUT)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((0.6, 1.5, 20, 0.0), "speed"),
        ((0.01, 1.5, 20, 0.6), "descent_speed"),
        ((0.01, 0.1, 20, 0.0), "angle"),
        ((0.01, 1.5, 0, 0.0), "ticks"),
    ],
)
def test_a_bad_command_is_named(arguments: tuple[float, float, int, float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        DescendingPlant(Specimen.drawn(0)).advance(*arguments)


def test_a_batch_is_its_cuts_one_by_one() -> None:
    plants = [DescendingPlant(Specimen.drawn(k), seed=k, layers=Layers(boundary=0.01)) for k in range(40)]
    cuts = Physics(*map(np.concatenate, zip(*(plant.snapshot() for plant in plants), strict=True)))
    rng, felt = np.random.default_rng(0), np.zeros((40, 2))
    for _ in range(40):
        commands = rng.uniform((-0.002, 0.8, -0.003), (0.02, 1.57, 0.005), (40, 3))
        hold_some(DESCENDING)(make_queue(40), 0, cuts, commands, 20, felt)
        for plant, (speed, angle, down), forces in zip(plants, commands, felt, strict=True):
            readings = plant.advance(speed, angle, 20, down)
            assert (readings["force"][-1], plant.vertical_force[-1]) == tuple(forces)
