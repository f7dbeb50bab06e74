"""A cut along a line on a rig beside the simulator: the same line, the same estimates, compared alike."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cutenv.envs import RigPathCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.policy.path_scripts import SteerByForce
from cutenv.scoring import PATH_METRICS
from cutenv.sim_to_real.compared_cut import ComparedCut
from cutenv.sim_to_real.curves import place_rmse, position_rmse
from cutenv.sim_to_real.estimated_path_cut import EstimatedPathCutEnv
from cutenv.sim_to_real.measures import MEASURES, PATH_MEASURES, measures_of
from cutenv.sim_to_real.paired_experiment import cut_once, simulator_like

SEED, EPISODE = 5, 1


@pytest.fixture(scope="module")
def rig() -> Iterator[RigPathCutEnv]:
    env = RigPathCutEnv(rig="fake", line="s", target_length=0.06)
    yield env
    env.close()


@pytest.fixture(scope="module")
def cuts(rig: RigPathCutEnv) -> tuple[ComparedCut, list[ComparedCut]]:
    """One cut on the rig, and two draws of noise in the simulator."""
    simulator = simulator_like(rig, target_length=0.06)
    assert isinstance(simulator, EstimatedPathCutEnv)
    drawn = [cut_once(simulator, SteerByForce(), seed=SEED, episode=EPISODE, noise=noise) for noise in range(2)]
    return cut_once(rig, SteerByForce(), seed=SEED, episode=EPISODE), drawn


def test_both_sides_cut_along_the_same_line_and_are_near(cuts: tuple[ComparedCut, list[ComparedCut]]) -> None:
    on_rig, drawn = cuts
    for cut in drawn:
        for name in ("line_m", "target_length_m"):
            assert cut.trace.metadata[name] == on_rig.trace.metadata[name]
        assert {"blade_x", "blade_y", "lateral_force"} <= set(cut.trace.known)
        assert position_rmse(on_rig.trace, cut.trace) == pytest.approx(0.0, abs=5e-3)
        assert place_rmse(on_rig.trace, cut.trace) == pytest.approx(0.0, abs=5e-3)
        assert cut.value == pytest.approx(on_rig.value, abs=0.3)
        near = pytest.approx(on_rig.card.metrics["mean_line_distance"].value, abs=0.5e-3)
        assert cut.card.metrics["mean_line_distance"].value == near
    assert on_rig.trace.lateral_force is not None
    assert np.abs(on_rig.trace.lateral_force).max() > 0.1


def test_draws_of_noise_differ_in_the_forces_alone(cuts: tuple[ComparedCut, list[ComparedCut]]) -> None:
    first, second = (cut.trace for cut in cuts[1])
    assert first.lateral_force is not None
    assert second.lateral_force is not None
    assert not np.array_equal(first.lateral_force[:500], second.lateral_force[:500])
    assert first.metadata["line_m"] == second.metadata["line_m"]


def test_the_path_is_compared_where_there_are_places_and_only_there(
    cuts: tuple[ComparedCut, list[ComparedCut]],
) -> None:
    on_rig, drawn = cuts
    assert set(measures_of([on_rig])) == set(MEASURES) | set(PATH_MEASURES)
    assert set(PATH_METRICS) < set(PATH_MEASURES)
    found = PATH_MEASURES["place_rmse"].value(on_rig, drawn)
    assert found is not None
    assert 0.0 < found < 5e-3


def test_estimates_are_not_the_truth_of_the_simulator_and_the_lateral_force_comes_late() -> None:
    estimated = cut_once(
        EstimatedPathCutEnv(line="arc", target_length=0.06), SteerByForce(), seed=SEED, episode=EPISODE
    )
    known = cut_once(PathCutEnv(line="arc", target_length=0.06), SteerByForce(), seed=SEED, episode=EPISODE)
    assert estimated.value != known.value
    assert estimated.value == pytest.approx(known.value, abs=0.4)
    late = EstimatedPathCutEnv(
        line="arc", target_length=0.06, force_delay=0.04, lateral_noise=0.0, lateral_resolution=0.0
    )
    late.reset(seed=SEED)
    plant, parts = late.cutting.plant, []
    for _ in range(60):
        late.step(np.array([0.6, 0.0, 0.3], np.float32))
        parts.append((plant.beside["lateral_force"].copy(), plant.lateral_force.copy()))
    felt, true = (np.concatenate(part) for part in zip(*parts, strict=True))
    np.testing.assert_array_equal(felt[40:], true[:-40])
    assert np.abs(true).max() > 0.03
