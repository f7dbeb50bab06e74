"""RigDepthCut-v1 is DepthCut on a rig with a height axis: same spaces, same wanted depth, rewards from estimates."""

from __future__ import annotations

import dataclasses
import json
import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scripted_operator import ScriptedOperator

from cutenv.cli import main
from cutenv.envs.depth_cut import to_depth_action
from cutenv.envs.rig_depth_cut import RigDepthCutEnv
from cutenv.policy.depth_scripts import DEPTH_SCRIPTS
from cutenv.recording import load_one
from cutenv.rig.config.imitated_rig import fake_settings
from cutenv.rig.errors import RigError
from cutenv.rig.toml_text import to_toml

UPRIGHT = math.pi / 2


@pytest.fixture
def env():
    env = RigDepthCutEnv(rig="fake", target_length=0.06)
    yield env
    env.close()


def cut(env, name="follow the depth", seed=5, episode=0, until=math.inf):
    """One cut: return, last info, level of the blade at each decision [m]."""
    policy = DEPTH_SCRIPTS[name]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng(0))
    total, depths, ended = 0.0, [], False
    while not ended and len(depths) < until:
        observation, reward, ended, _, info = env.step(policy(observation))
        assert env.observation_space.contains(observation)
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        total += reward
        depths.append(0.02 * observation[15])
    return total, info, np.array(depths)


def test_it_has_the_simulators_spaces(env):
    simulated = gymnasium.make("cutenv/DepthCut-v1", surface_spread=0.0)
    assert env.observation_space == simulated.observation_space
    assert env.action_space == simulated.action_space


def test_gymnasiums_checker_finds_nothing():
    check_env(gymnasium.make("cutenv/RigDepthCut-v1", rig="fake").unwrapped, skip_render_check=True)


def test_it_shows_the_simulators_wanted_depth_and_lays_its_layer(env):
    simulated = gymnasium.make("cutenv/DepthCut-v1", target_length=0.06, surface_spread=0.0).unwrapped
    for episode in range(4):
        ours, _ = env.reset(seed=7, options={"episode": episode})
        theirs, _ = simulated.reset(seed=7, options={"episode": episode})
        assert ours[:12] == pytest.approx(theirs[:12], abs=1e-6)
        assert ours[12:] == pytest.approx(theirs[12:], abs=2e-3)  # height and level agree to some hundredths of a mm
        laid = env.the_fake().bench.plant.descents
        for name in ("boundary", "deep_toughness", "deep_modulus"):
            assert float(laid[name][0]) == float(simulated.cutting.descents[name][0])


@pytest.mark.parametrize("name", ["follow the depth", "depth by force"])
def test_the_same_script_cuts_as_in_the_simulator(env, name):
    simulated = gymnasium.make("cutenv/DepthCut-v1", target_length=0.06, surface_spread=0.0)
    for episode in range(3):
        ours, our_info, our_depths = cut(env, name, episode=episode)
        theirs, their_info, their_depths = cut(simulated, name, episode=episode)
        assert our_info["end"] == their_info["end"] == "finished"
        assert abs(ours - theirs) < 0.15
        shared = min(len(our_depths), len(their_depths))
        assert np.sqrt(np.mean((our_depths[:shared] - their_depths[:shared]) ** 2)) < 0.5e-3
        true = env.the_fake().bench.plant
        passed = int(float(true.cuts.states["tip"][0]) * 2000)
        assert np.mean(np.abs(env.cutting.floor - true.floor)[:passed]) < 1e-3  # the measured surface is off by 0.5 mm


def test_hovering_is_dearer_than_cutting(env):
    following, _, _ = cut(env)
    env.reset(seed=5, options={"episode": 0})
    total, ended, info = 0.0, False, {}
    for _ in range(100):
        env.step(to_depth_action(0.0, UPRIGHT, -0.01))
    while not ended:
        speed = 0.02 if env.cutting.plant.position < 0.06 else 0.0
        _, reward, ended, _, info = env.step(to_depth_action(speed, UPRIGHT, 0.0))
        total += reward
    assert info["is_success"] is False
    assert info["depth"]["uncut_mm2"] > 100.0
    assert total < following - 0.5


def test_what_is_hidden_is_not_told(env):
    _, info, _ = cut(env, until=30)
    assert "truth" not in info
    assert set(info["depth"]) == {"too_deep_mm2", "uncut_mm2", "mean_error_mm"}
    assert info["reward_terms"]["layer_area"] == info["reward_terms"]["layer_depth"] == 0.0


def test_a_stop_leaves_the_blade_where_it_is_until_the_operators_yes():
    asked = [("will move", "fake"), ("Did it go up first", True), ("was stopped", False)]
    env = RigDepthCutEnv(rig="fake", target_length=0.06, operator=ScriptedOperator(asked))
    cut(env, until=60)
    height = env.the_fake().bench.beside("height")[0]
    env.the_fake().faults.extra_force = 30.0
    info = env.step(to_depth_action(0.01, UPRIGHT, 0.0))[4]
    assert info["end"] == "stopped"
    assert info["is_success"] is False
    assert info["reward_terms"]["safety"] < -0.5
    with pytest.raises(RigError, match="not agreed"):
        env.reset(seed=1)
    assert env.the_fake().bench.beside("height")[0] == pytest.approx(height, abs=5e-4)
    env.close()


def test_a_blade_that_cannot_be_raised_during_a_cut_is_stopped(env):
    cut(env, until=60)
    env.the_fake().faults.height.one_way = True
    ended, info = False, {}
    for _ in range(200):
        _, _, ended, _, info = env.step(to_depth_action(0.005, UPRIGHT, -0.005))
        if ended:
            break
    assert info["end"] == "stopped"
    assert info["stop"]["cause"] == "cannot be raised"


@pytest.mark.parametrize("action", [[0.0, 1.0], [0.0, 1.0, math.nan], [0.0, 1.0, 0.0, 0.0], "down"])
def test_an_action_that_is_no_three_numbers_stops_the_blade(env, action):
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"must hold 3 numbers in \[-1, 1\] \(speed, angle, descent\)"):
        env.step(action)


def test_a_wanted_depth_out_of_reach_is_refused_before_anything_is_cut(env):
    axis = dataclasses.replace(env.settings.height, highest=0.001, lowest=-0.001)
    env._source.settings = dataclasses.replace(env.settings, height=axis)
    with pytest.raises(RigError, match="the wanted depth needs heights of"):
        env.reset(seed=0)
    assert env.session.plant.supervisor.phase == "unready"


def test_a_rig_without_the_axis_is_refused(tmp_path, capsys):
    settings = dataclasses.replace(
        fake_settings(), emulated=False, name="bench 2", depth_profile=((0, 0.01), (0.15, 0.01))
    )
    path = tmp_path / "rig.toml"
    path.write_text(to_toml(settings), encoding="utf-8")
    assert main(["rig", "run", "--task", "depth", "--policy", "follow the depth", "--rig", str(path)]) == 2
    assert "rig 'bench 2' has no height axis" in capsys.readouterr().err


def test_the_command_cuts_and_records(tmp_path, capsys):
    out, told = tmp_path / "cuts", tmp_path / "told.json"
    options = ["--rig", "fake", "--target-length", "60mm", "--out", str(out), "--json", str(told)]
    assert main(["rig", "run", "--task", "depth", "--policy", "follow the depth", *options]) == 0
    assert "estimated mean error of the depth" in capsys.readouterr().out
    result = json.loads(told.read_text(encoding="utf-8"))
    trace = load_one(result["record"])
    assert trace.metadata["vertical_axis"] == "z"
    assert np.ptp(trace.height) > 1e-3
    assert np.ptp(trace.vertical_force) > 0.1
    assert result["depth"]["mean_error_mm_estimated"] < 1.5


@pytest.mark.parametrize(
    ("policy", "said"),
    [("probe and creep", "is a script of cutenv/GentleCut-v1"), ("ppo-free", "was trained in cutenv/GentleCut-v1")],
)
def test_a_policy_of_another_task_is_refused(policy, said, capsys):
    assert main(["rig", "run", "--task", "depth", "--policy", policy, "--rig", "fake"]) == 2
    assert said in capsys.readouterr().err
