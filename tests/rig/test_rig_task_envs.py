"""RigDepthCut-v1 and RigPathCut-v1: DepthCut and PathCut on a rig with a further axis, with rewards from estimates."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scripted_operator import ScriptedOperator

from cutenv.agents.policy.depth_policies import DEPTH_SCRIPTS
from cutenv.agents.policy.path_policies import PATH_SCRIPTS
from cutenv.commands.cli import main
from cutenv.envs.depth_cut import to_depth_action
from cutenv.envs.path_cut import to_path_action
from cutenv.envs.rig_cut import RigDepthCutEnv, RigPathCutEnv
from cutenv.records import load_one
from cutenv.rig.config.settings import fake_settings
from cutenv.rig.errors import RigError
from cutenv.rig.toml_file import to_toml
from cutenv.sim.tissue.lines import arc

UPRIGHT = math.pi / 2
BENT = arc(0.06, turn=math.radians(20.0))
pytestmark = pytest.mark.usefixtures("quick_return")


class Task(NamedTuple):
    """A task with a further axis, and what its tests need to know of it."""

    made: Callable[..., Any]
    simulated: Callable[[], Any]
    scripts: Mapping[str, Callable[[], Any]]
    script: str
    axis: str
    action: Callable[[float, float, float], Any]
    third: str  # name of the third number of an action
    group: str  # name in ``info`` of the estimates
    estimates: set[str]
    scale: float  # depth of the blade, or distance of the line to its left, of one unit of the observation [m]


DEPTH = Task(
    RigDepthCutEnv, lambda: gymnasium.make("cutenv/DepthCut-v1", target_length=0.06, surface_spread=0.0), DEPTH_SCRIPTS,
    "follow the depth", "height", to_depth_action, "descent", "depth",
    {"too_deep_mm2", "uncut_mm2", "mean_error_mm"}, 0.02,
)  # fmt: skip
PATH = Task(
    RigPathCutEnv, lambda: gymnasium.make("cutenv/PathCut-v1", target_length=0.06), PATH_SCRIPTS, "steer by force",
    "side", to_path_action, "turn", "path", {"area_mm2", "mean_distance_mm", "largest_distance_mm"}, 0.005,
)  # fmt: skip
BOTH = pytest.mark.parametrize("task", [DEPTH, PATH], ids=["depth", "path"])


@pytest.fixture
def made():
    """Make environments on the fake rig, and close them at the end."""
    envs = []

    def make(task: Task, **options: Any) -> Any:
        envs.append(task.made(rig="fake", target_length=0.06, **options))
        return envs[-1]

    yield make
    for env in envs:
        env.close()


def cut(task, env, name=None, seed=5, episode=0, until=math.inf):
    """One cut: return, last info, and depth of the blade or its distance from the line at each decision [m]."""
    policy = task.scripts[name or task.script]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng(0))
    total, places, ended = 0.0, [], False
    while not ended and len(places) < until:
        observation, reward, ended, _, info = env.step(policy(observation))
        assert env.observation_space.contains(observation)
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        total += reward
        places.append(task.scale * observation[15])
    return total, info, np.array(places)


@BOTH
def test_it_has_the_simulators_spaces(task, made):
    env, simulated = made(task), task.simulated()
    assert env.observation_space == simulated.observation_space
    assert env.action_space == simulated.action_space


@pytest.mark.parametrize("name", ["RigCut-v1", "RigDepthCut-v1", "RigPathCut-v1"])
def test_gymnasiums_checker_finds_nothing(name):
    check_env(gymnasium.make(f"cutenv/{name}", rig="fake").unwrapped, skip_render_check=True)


@BOTH
def test_what_is_hidden_is_not_told(task, made):
    _, info, _ = cut(task, made(task), until=30)
    assert "truth" not in info
    assert set(info[task.group]) == task.estimates
    if task is DEPTH:
        assert info["reward_terms"]["layer_area"] == info["reward_terms"]["layer_depth"] == 0.0


@pytest.mark.parametrize(
    ("task", "asked", "pushed"),
    [
        (DEPTH, [("will move", "fake"), ("Did it go up first", True)], {"extra_force": 30.0}),
        (PATH, [("will move: to the left", "fake"), ("Did it go to the left first", True)], {"force": 30.0}),
    ],
    ids=["depth", "path"],
)
def test_a_stop_leaves_the_blade_where_it_is_until_the_operators_yes(task, asked, pushed, made):
    env = made(task, operator=ScriptedOperator([*asked, ("was stopped", False)]))
    cut(task, env, until=60)
    place, fake = env.the_fake().bench.cross_motion(task.axis)[0], env.the_fake()
    (fake.faults if task is DEPTH else fake.faults.side).__dict__.update(pushed)
    info = env.step(task.action(0.01, UPRIGHT, 0.0))[4]
    assert info["end"] == "stopped"
    assert info["is_success"] is False
    assert info["stop"]["cause"] in ("force limit", "force rise")
    assert info["reward_terms"]["safety"] < -0.5
    with pytest.raises(RigError, match="not agreed"):
        env.reset(seed=1)
    assert fake.bench.cross_motion(task.axis)[0] == pytest.approx(place, abs=5e-4)


@pytest.mark.parametrize(
    ("task", "fault", "command", "causes"),
    [
        (DEPTH, "one_way", (0.005, UPRIGHT, -0.005), {"cannot be raised"}),
        (PATH, "blocked", (0.01, UPRIGHT, 0.5), {"encoder stuck", "following error", "acceleration limit"}),
    ],
    ids=["depth", "path"],
)
def test_a_blade_that_cannot_be_raised_or_moved_to_the_side_is_stopped(task, fault, command, causes, made):
    env = made(task)
    cut(task, env, until=60)
    setattr(env.the_fake().faults_of(task.axis), fault, True)
    ended, info = False, {}
    for _ in range(300):
        *_, ended, _, info = env.step(task.action(*command))
        if ended:
            break
    assert info["end"] == "stopped"
    assert info["stop"]["cause"] in causes


@BOTH
def test_an_action_that_is_no_three_numbers_stops_the_blade(task, made):
    env = made(task)
    for action in ([0.0, 1.0], [0.0, 1.0, math.nan], [0.0, 1.0, 0.0, 0.0], "down"):
        env.reset(seed=0)
        with pytest.raises(ValueError, match=rf"must hold 3 numbers in \[-1, 1\] \(speed, angle, {task.third}\)"):
            env.step(action)


@pytest.mark.parametrize(
    ("task", "given", "reach", "said"),
    [
        (DEPTH, {}, {"highest": 0.001, "lowest": -0.001}, "the wanted depth needs heights of"),
        (PATH, {"line": BENT}, {"leftmost": 0.01}, r"the line goes from .*side.rightmost_mm, leftmost_mm"),
    ],
    ids=["depth", "path"],
)
def test_a_wanted_cut_out_of_reach_is_refused_before_anything_moves(task, given, reach, said, made):
    env = made(task, **given)
    axis = dataclasses.replace(env.settings.cross_axes[task.axis], **reach)
    env._source.settings = dataclasses.replace(env.settings, **{task.axis: axis})
    with pytest.raises(RigError, match=said):
        env.reset(seed=0)
    assert env.session.plant.supervisor.phase == "unready"


def test_it_shows_the_simulators_wanted_depth_and_lays_its_layer(made):
    env = made(DEPTH)
    simulated = DEPTH.simulated().unwrapped
    for episode in range(2):
        ours, _ = env.reset(seed=7, options={"episode": episode})
        theirs, _ = simulated.reset(seed=7, options={"episode": episode})
        assert ours[:12] == pytest.approx(theirs[:12], abs=1e-6)
        assert ours[12:] == pytest.approx(theirs[12:], abs=2e-3)  # height and level agree to some hundredths of a mm
        laid = env.the_fake().bench.plant.descents
        for name in ("boundary", "deep_toughness", "deep_modulus"):
            assert float(laid[name][0]) == float(simulated.cutting.motion[name][0])


@pytest.mark.parametrize("name", ["follow the depth", "depth by force"])
def test_the_same_script_follows_the_depth_as_in_the_simulator(made, name):
    env = made(DEPTH)
    simulated = DEPTH.simulated()
    for episode in range(2):
        ours, our_info, our_depths = cut(DEPTH, env, name, episode=episode)
        theirs, their_info, their_depths = cut(DEPTH, simulated, name, episode=episode)
        assert our_info["end"] == their_info["end"] == "finished"
        assert abs(ours - theirs) < 0.15
        shared = min(len(our_depths), len(their_depths))
        assert np.sqrt(np.mean((our_depths[:shared] - their_depths[:shared]) ** 2)) < 0.5e-3
        true = env.the_fake().bench.plant
        passed = int(float(true.states["tip"][0]) * 2000)
        assert np.mean(np.abs(env.cutting.floor - true.floor)[:passed]) < 1.1e-3  # the surface is off by 0.5


def test_hovering_is_dearer_than_cutting(made):
    env = made(DEPTH, deadline_s=12.0)
    following, _, _ = cut(DEPTH, env)
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


def test_it_has_the_simulators_line(made):
    env, simulated = made(PATH), PATH.simulated()
    for episode in range(2):
        ours, _ = env.reset(seed=7, options={"episode": episode})
        theirs, _ = simulated.reset(seed=7, options={"episode": episode})
        # At rest, in the middle of the clamp, all but the stiffness's own numbers are the same.
        assert ours == pytest.approx(theirs, abs=5e-3)
        assert np.array_equal(env.cutting.line.y, simulated.unwrapped.cutting.line.y)


@pytest.mark.parametrize(("name", "apart"), [("look ahead", 0.2e-3), ("steer by force", 1.5e-3)])  # it feels all noise
def test_the_same_script_follows_the_line_as_in_the_simulator(made, name, apart):
    env = made(PATH)
    simulated = PATH.simulated()
    _, our_info, ours = cut(PATH, env, name)
    _, their_info, theirs = cut(PATH, simulated, name)
    assert our_info["end"] == their_info["end"] == "finished"
    shared = min(len(ours), len(theirs))
    assert np.sqrt(np.mean((ours[:shared] - theirs[:shared]) ** 2)) < apart
    true, expected = env.the_fake().bench.tissue.plant.cut_distance, env.cutting.cut_distance
    shared = min(len(true), len(expected))
    assert np.mean(np.abs(true[:shared] - expected[:shared])) < 0.6e-3  # the mean tissue drags along less, or more


def test_on_a_straight_line_nothing_goes_to_the_side(made):
    env = made(PATH, line="straight")
    _, info, aside = cut(PATH, env, "look ahead")
    assert info["end"] == "finished"
    assert info["path"]["largest_distance_mm"] < 0.05
    assert np.max(np.abs(aside)) < 5e-5
    assert abs(env.the_fake().bench.cross_motion("side")[0]) < 5e-5


def test_across_the_line_it_ends_off_the_line(made):
    env = made(PATH, line=BENT)
    env.reset(seed=1)
    ended, info = False, {}
    while not ended:
        *_, ended, _, info = env.step(to_path_action(0.02, UPRIGHT, 0.0))
    assert info["end"] == "off_line"
    assert info["path"]["largest_distance_mm"] > 8.0
    assert info["reward_terms"]["safety"] < -0.5


def test_between_cuts_the_blade_goes_back_the_way_it_came(made):
    env = made(PATH, line=BENT)
    cut(PATH, env, until=150)
    y, _ = env.the_fake().bench.cross_motion("side")
    way = list(env.session.plant._way)
    assert y > 0.002
    assert len(way) > 20
    passed = []
    fake, step = env.the_fake(), env.the_fake().bench.step
    fake.bench.step = lambda *told: (
        step(*told),
        passed.append((fake.bench.motion[0], fake.bench.cross_motion("side")[0])),
    )
    env.reset(seed=6)
    back = np.array(passed)
    away = [np.min(np.hypot(*(back - place).T)) for place in way]
    assert max(away) < 3e-4
    assert np.hypot(*back[-1]) < 1e-4


def test_the_record_has_place_lateral_force_and_line(made, tmp_path):
    env = made(PATH, line=BENT, records=tmp_path)
    cut(PATH, env)
    env.close()
    trace = load_one(env.records[0])
    assert len(trace.metadata["line_m"]) > 20
    assert np.ptp(trace.blade_y) > 0.01
    assert np.ptp(trace.lateral_force) > 0.1
    farthest = np.argmax(trace.blade_x)
    assert 1.02 < trace.position[farthest] / trace.blade_x[farthest] < 1.1  # arc length along the bent line
