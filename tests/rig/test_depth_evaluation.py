"""A cut along a wanted depth on a rig beside the simulator: the same task, the same estimates, compared alike."""

from __future__ import annotations

import numpy as np
import pytest
from cutenv.sim_to_real.estimated_depth_cut import EstimatedDepthCutEnv

from cutenv.envs import RigCutEnv, RigDepthCutEnv
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.policy.depth_scripts import FollowDepth
from cutenv.scoring import DEPTH_METRICS
from cutenv.sim_to_real.curves import height_rmse, position_rmse
from cutenv.sim_to_real.measures import DEPTH_MEASURES, MEASURES, measures_of
from cutenv.sim_to_real.paired_experiment import cut_once, simulator_like

SEED, EPISODE = 5, 1


@pytest.fixture(scope="module")
def rig():
    env = RigDepthCutEnv(rig="fake", wanted="ramp", target_length=0.06)
    yield env
    env.close()


@pytest.fixture(scope="module")
def simulator(rig):
    return simulator_like(rig, target_length=0.06)


@pytest.fixture(scope="module")
def cuts(rig, simulator):
    """One cut on the rig, and two draws of noise in the simulator."""
    drawn = [cut_once(simulator, FollowDepth(), seed=SEED, episode=EPISODE, noise=noise) for noise in range(2)]
    return cut_once(rig, FollowDepth(), seed=SEED, episode=EPISODE), drawn


def test_the_simulator_of_a_rig_with_height_cuts_along_the_depth_that_the_rig_wants(rig, simulator, cuts):
    assert isinstance(simulator, EstimatedDepthCutEnv)
    np.testing.assert_array_equal(simulator.cutting.whole["wanted"], rig.cutting.whole["wanted"])
    on_rig, drawn = cuts
    for cut in drawn:
        for name in ("wanted_depth_m", "target_length_m"):
            assert cut.trace.metadata[name] == on_rig.trace.metadata[name]
        np.testing.assert_allclose(cut.trace.depth[0], on_rig.trace.depth[0], atol=1e-6)
    assert simulator_like(RigCutEnv(rig="fake"), target_length=0.06).action_names == ("speed", "angle")


def test_both_sides_record_height_and_vertical_force_and_are_near(cuts):
    on_rig, drawn = cuts
    for cut in drawn:
        assert {"height", "vertical_force"} <= set(cut.trace.known)
        assert height_rmse(on_rig.trace, cut.trace) < 0.5e-3
        assert position_rmse(on_rig.trace, cut.trace) < 5e-3
        assert cut.value == pytest.approx(on_rig.value, abs=0.3)
        assert cut.card["mean_depth_error"] == pytest.approx(on_rig.card["mean_depth_error"], abs=0.5e-3)
    assert on_rig.trace.vertical_force.max() > 0.1


def test_draws_of_noise_differ_in_the_forces_alone(cuts):
    first, second = cuts[1]
    assert not np.array_equal(first.trace.vertical_force[:500], second.trace.vertical_force[:500])
    assert first.trace.metadata["wanted_depth_m"] == second.trace.metadata["wanted_depth_m"]


def test_the_depth_is_compared_where_there_is_height_and_only_there(cuts):
    on_rig, drawn = cuts
    assert set(measures_of([on_rig])) == set(MEASURES) | set(DEPTH_MEASURES)
    assert set(DEPTH_METRICS) - set(DEPTH_MEASURES) == {"layer_area", "layer_depth"}  # which no rig sees
    assert set(measures_of([])) == set(MEASURES)
    found = DEPTH_MEASURES["height_rmse"].value(on_rig, drawn)
    assert 0.0 < found < 0.5e-3
    assert DEPTH_MEASURES["uncut_area"].value(on_rig, drawn) == on_rig.card["uncut_area"]


def test_estimates_are_not_the_truth_of_the_simulator():
    env = EstimatedDepthCutEnv(wanted="step", target_length=0.06)
    truth = DepthCutEnv(wanted="step", target_length=0.06)
    estimated = cut_once(env, FollowDepth(), seed=SEED, episode=EPISODE)
    known = cut_once(truth, FollowDepth(), seed=SEED, episode=EPISODE)
    assert estimated.value != known.value
    assert estimated.value == pytest.approx(known.value, abs=0.4)
