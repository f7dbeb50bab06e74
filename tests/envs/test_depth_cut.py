"""cutenv/DepthCut-v1: depth is an action."""

from __future__ import annotations

import math

import numpy as np
import pytest
from map_tasks import cut

import cutenv  # noqa: F401
from cutenv.agents.learning.evaluation import Contestant, evaluate
from cutenv.agents.policy.depth_policies import FollowDepth, HoldDepth
from cutenv.envs.depth_cut import DepthCutEnv, to_depth_action
from cutenv.envs.vector import CutBatch
from cutenv.task.depth import DEEP, DEPTH_CUT, LEAST_BELOW, LEAST_CHANGE, MOST_BELOW, SHALLOW

UPRIGHT = math.pi / 2


def test_the_map_is_the_floor_of_the_cut():
    env, _, info = cut("depth", FollowDepth(), 6)
    descent = env.cutting.motion[0]
    passed = slice(0, descent["cell"] + 1)
    error = (env.cutting.floor - env.cutting.whole["wanted"][0])[passed]
    assert info["depth"]["too_deep_mm2"] == pytest.approx(0.5e3 * np.maximum(error, 0.0).sum(), abs=1e-9)
    assert info["depth"]["uncut_mm2"] == pytest.approx(0.5e3 * np.maximum(-error, 0.0).sum(), abs=1e-9)
    beyond = np.maximum(env.cutting.floor - descent["boundary"], 0.0)[passed]
    assert info["depth"]["layer_mm2"] == pytest.approx(0.5e3 * beyond.sum(), abs=1e-9)


def test_no_slice_has_the_surface_of_another_and_what_is_known_of_it_is_its_measurement():
    """A learner that knew the mean surface by heart would else know each surface better than it was measured."""
    batch = CutBatch(200, DepthCutEnv())
    batch.give_seeds(range(200), np.arange(200), np.random.default_rng(0))
    batch.begin(np.arange(200))
    surface, measured = batch.cuts.motions["surface"][:, 100:], batch.cuts.nominals["depth"][:, 100:]  # from 50 mm on
    assert np.std(surface, axis=0).mean() == pytest.approx(2.0e-3, rel=0.15)
    assert np.std(measured - surface) == pytest.approx(0.5e-3, rel=0.1)
    assert abs(np.mean(measured - surface)) < 0.1e-3
    env = DepthCutEnv(surface_spread=0.0)
    flat = [env.reset(seed=seed)[1] and env.specimen.depth for seed in range(2)]
    np.testing.assert_array_equal(*flat)
    env = DepthCutEnv()
    env.reset(seed=1)
    given = env.specimen
    env.reset(seed=2, options={"specimen": given})
    assert env.specimen == given


def test_a_mean_surface_is_that_of_the_whole_class_uniform():
    env = DepthCutEnv(specimen_class="uniform")
    depths = [env.reset(seed=seed)[1] and env.specimen.depth for seed in range(2)]
    np.testing.assert_array_equal(*depths)


def test_wanted_depths_are_as_told():
    for kind in ("constant", "ramp", "step"):
        for seed in range(20):
            env = DepthCutEnv(wanted=kind)
            _, info = env.reset(seed=seed)
            wanted = env.cutting.whole["wanted"][0]
            assert SHALLOW - 1e-12 <= wanted.min()
            assert wanted.max() <= DEEP + 1e-12
            below = info["truth"]["layer_m"] - wanted.max()
            assert LEAST_BELOW - 1e-12 <= below <= MOST_BELOW + 1e-12
            change = np.ptp(wanted[: int(info["truth"]["target_length_m"] / 0.5e-3) + 1])
            if kind == "constant":
                assert change == 0.0
            else:
                assert change >= 0.9 * LEAST_CHANGE


def test_the_layer_below_is_hidden_at_the_start():
    shown = [DepthCutEnv(wanted="constant", layer=layer).reset(seed=8)[0] for layer in (True, False)]
    np.testing.assert_array_equal(*shown)


def test_a_dip_between_decisions_is_not_forgotten():
    """The map does not depend on how often decisions are made: a floor that was cut stays cut."""
    found = []
    for hz in (1, 50):
        env = DepthCutEnv(wanted="constant", control_hz=hz, layer=False)
        env.reset(seed=4)
        for descent, seconds in ((0.0, 3), (0.5, 1), (-0.5, 1)):
            for _ in range(seconds * hz):
                info = env.step(to_depth_action(0.005, UPRIGHT, descent * 0.01))[-1]
        found.append(info["depth"])
    for name, value in found[0].items():
        assert value == pytest.approx(found[1][name], abs=1e-9)
    assert found[0]["too_deep_mm2"] > 1.0


def test_pressing_on_ends_in_the_layer_and_costs_more_than_stopping():
    env = DepthCutEnv(wanted="constant", force_limit_per_depth=1e5)
    env.reset(seed=2)
    total, ended = 0.0, False
    while not ended:
        _, reward, ended, _, info = env.step(to_depth_action(0.006, UPRIGHT, 0.004))
        total += reward
    assert info["end"] == "layer"
    assert not info["is_success"]
    assert info["depth"]["layer_mm"] > 3.0
    assert info["reward_terms"]["safety"] < -0.4
    assert total < -0.1  # the return of doing nothing


def test_success_asks_for_the_depth():
    shallow = [cut("depth", HoldDepth(), seed, wanted="step")[2] for seed in range(20)]
    assert any(info["end"] == "finished" for info in shallow)
    for info in shallow:
        if info["is_success"]:
            assert info["depth"]["mean_error_mm"] <= 1.5
        assert info["is_success"] == (info["reward_terms"]["success"] > 0.0)


def test_rows_have_the_depth_in_numbers():
    (row,) = evaluate({"it": Contestant(FollowDepth())}, [3], {"task": "depth"}, processes=1)
    assert {"mean_error_mm", "too_deep_mm2", "layer_mm", *(f"reward_{cost.name}" for cost in DEPTH_CUT.costs)} <= set(
        row
    )


def test_a_cut_that_is_begun_is_as_deep_as_wanted():
    env = DepthCutEnv(start_before_target=0.02)
    _, info = env.reset(seed=9)
    begun = env.cutting.motion["cell"][0]
    error = (env.cutting.floor - env.cutting.whole["wanted"][0])[: begun + 1]
    assert begun > 50
    assert np.abs(error).max() < 3e-3  # the surface was measured with an error of 0.5 mm
    assert info["depth"]["mean_error_mm"] > 0.0
