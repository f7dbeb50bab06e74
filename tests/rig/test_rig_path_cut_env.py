"""RigPathCut-v1 is PathCut on a rig with an axis to the side: same spaces, same line, rewards from estimates."""

from __future__ import annotations

import dataclasses
import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scripted_operator import ScriptedOperator

from cutenv.envs.path_cut import to_path_action
from cutenv.envs.rig_path_cut import RigPathCutEnv
from cutenv.policy.path_scripts import PATH_SCRIPTS
from cutenv.recording import load_one
from cutenv.rig.errors import RigError
from cutenv.tissue.lines import arc

UPRIGHT = math.pi / 2
BENT = arc(0.06, turn=math.radians(20.0))


@pytest.fixture
def env():
    env = RigPathCutEnv(rig="fake", target_length=0.06)
    yield env
    env.close()


def cut(env, name="steer by force", seed=5, episode=0, until=math.inf):
    """One cut: return, last info, and distance of the line to the left of the blade at each decision [m]."""
    policy = PATH_SCRIPTS[name]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng(0))
    total, aside, ended = 0.0, [], False
    while not ended and len(aside) < until:
        observation, reward, ended, _, info = env.step(policy(observation))
        assert env.observation_space.contains(observation)
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        total += reward
        aside.append(0.005 * observation[15])
    return total, info, np.array(aside)


def test_it_has_the_simulators_spaces_and_line(env):
    simulated = gymnasium.make("cutenv/PathCut-v1", target_length=0.06)
    assert env.observation_space == simulated.observation_space
    assert env.action_space == simulated.action_space
    for episode in range(4):
        ours, _ = env.reset(seed=7, options={"episode": episode})
        theirs, _ = simulated.reset(seed=7, options={"episode": episode})
        # At rest, in the middle of the clamp, all but the stiffness's own numbers are the same.
        assert ours == pytest.approx(theirs, abs=5e-3)
        assert np.array_equal(env.cutting.line.y, simulated.unwrapped.cutting.line.y)


def test_gymnasiums_checker_finds_nothing():
    check_env(gymnasium.make("cutenv/RigPathCut-v1", rig="fake").unwrapped, skip_render_check=True)


@pytest.mark.parametrize(("name", "apart"), [("look ahead", 0.2e-3), ("steer by force", 1.5e-3)])  # it feels all noise
def test_the_same_script_cuts_as_in_the_simulator(env, name, apart):
    simulated = gymnasium.make("cutenv/PathCut-v1", target_length=0.06)
    _, our_info, ours = cut(env, name)
    _, their_info, theirs = cut(simulated, name)
    assert our_info["end"] == their_info["end"] == "finished"
    shared = min(len(ours), len(theirs))
    assert np.sqrt(np.mean((ours[:shared] - theirs[:shared]) ** 2)) < apart
    true, expected = env.the_fake().bench.tissue.plant.cut_distance, env.cutting.cut_distance
    shared = min(len(true), len(expected))
    assert np.mean(np.abs(true[:shared] - expected[:shared])) < 0.6e-3  # the mean tissue drags along less, or more


def test_on_a_straight_line_nothing_goes_to_the_side():
    env = RigPathCutEnv(rig="fake", target_length=0.06, line="straight")
    _, info, aside = cut(env, "look ahead")
    assert info["end"] == "finished"
    assert info["path"]["largest_distance_mm"] < 0.05
    assert np.max(np.abs(aside)) < 5e-5
    assert abs(env.the_fake().bench.beside("side")[0]) < 5e-5
    env.close()


def test_what_is_hidden_is_not_told(env):
    _, info, _ = cut(env, until=30)
    assert "truth" not in info
    assert set(info["path"]) == {"area_mm2", "mean_distance_mm", "largest_distance_mm"}


def test_across_the_line_it_ends_off_the_line():
    env = RigPathCutEnv(rig="fake", target_length=0.06, line=BENT)
    env.reset(seed=1)
    ended, info = False, {}
    while not ended:
        *_, ended, _, info = env.step(to_path_action(0.02, UPRIGHT, 0.0))
    assert info["end"] == "off_line"
    assert info["path"]["largest_distance_mm"] > 8.0
    assert info["reward_terms"]["safety"] < -0.5
    env.close()


def test_between_cuts_the_blade_goes_back_the_way_it_came():
    env = RigPathCutEnv(rig="fake", target_length=0.06, line=BENT)
    cut(env, until=150)
    y, _ = env.the_fake().bench.beside("side")
    way = list(env.session.plant._way)
    assert y > 0.002
    assert len(way) > 20
    passed = []
    fake, step = env.the_fake(), env.the_fake().bench.step
    fake.bench.step = lambda *told: (step(*told), passed.append((fake.bench.motion[0], fake.bench.beside("side")[0])))
    env.reset(seed=6)
    back = np.array(passed)
    away = [np.min(np.hypot(*(back - place).T)) for place in way]
    assert max(away) < 3e-4
    assert np.hypot(*back[-1]) < 1e-4
    env.close()


def test_a_blade_that_cannot_be_moved_to_the_side_is_stopped(env):
    cut(env, until=60)
    env.the_fake().faults.side.blocked = True
    ended, info = False, {}
    for _ in range(300):
        *_, ended, _, info = env.step(to_path_action(0.01, UPRIGHT, 0.5))
        if ended:
            break
    assert info["end"] == "stopped"
    assert info["stop"]["cause"] in ("encoder stuck", "following error", "acceleration limit")


def test_a_stop_leaves_the_blade_where_it_is_until_the_operators_yes():
    asked = [("will move: to the left", "fake"), ("Did it go to the left first", True), ("was stopped", False)]
    env = RigPathCutEnv(rig="fake", target_length=0.06, operator=ScriptedOperator(asked))
    cut(env, until=80)
    place = env.the_fake().bench.beside("side")[0]
    env.the_fake().faults.side.force = 30.0
    info = env.step(to_path_action(0.01, UPRIGHT, 0.0))[4]
    assert info["end"] == "stopped"
    assert info["is_success"] is False
    assert info["stop"]["cause"] in ("force limit", "force rise")
    with pytest.raises(RigError, match="not agreed"):
        env.reset(seed=1)
    assert env.the_fake().bench.beside("side")[0] == pytest.approx(place, abs=5e-4)
    env.close()


def test_a_line_out_of_reach_is_refused_before_anything_moves():
    env = RigPathCutEnv(rig="fake", target_length=0.06, line=BENT)
    axis = dataclasses.replace(env.settings.side, leftmost=0.01)
    env._source.settings = dataclasses.replace(env.settings, side=axis)
    with pytest.raises(RigError, match=r"the line goes from .*side.rightmost_mm, leftmost_mm"):
        env.reset(seed=0)
    assert env.session.plant.supervisor.phase == "unready"
    env.close()


@pytest.mark.parametrize("action", [[0.0, 1.0], [0.0, 1.0, math.nan], "left"])
def test_an_action_that_is_no_three_numbers_stops_the_blade(env, action):
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"must hold 3 numbers in \[-1, 1\] \(speed, angle, turn\)"):
        env.step(action)


def test_the_record_has_place_lateral_force_and_line(tmp_path):
    env = RigPathCutEnv(rig="fake", target_length=0.06, line=BENT, records=tmp_path)
    cut(env)
    env.close()
    trace = load_one(env.records[0])
    assert len(trace.metadata["line_m"]) > 20
    assert np.ptp(trace.blade_y) > 0.01
    assert np.ptp(trace.lateral_force) > 0.1
    farthest = np.argmax(trace.blade_x)
    assert 1.02 < trace.position[farthest] / trace.blade_x[farthest] < 1.1  # arc length along the bent line
