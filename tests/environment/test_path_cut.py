"""cutenv/PathCut-v1: a blade that is steered cuts along a line, and no trick of the plane pays."""

from __future__ import annotations

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import cutenv  # noqa: F401
from cutenv.envs.path_cut import PathBatch, PathCutEnv, to_path_action
from cutenv.task.observation import COMPONENTS
from cutenv.task.path_terms import ALL_PATH_TERMS, PATH_COMPONENTS, PATH_COSTS
from cutenv.tissue.drawn_lines import KINDS, STORED, drawn_lines, first_of_pair, kind_of
from cutenv.tissue.lines import arc, half_ellipse, length_within
from cutenv.tissue.path_model import stiffness_on_line
from cutenv.tissue.specimen import Specimen

UPRIGHT = math.pi / 2


def test_on_the_straight_line_it_is_gentle_cut_to_the_last_bit():
    gentle = gymnasium.make("cutenv/GentleCut-v1")
    steered = gymnasium.make("cutenv/PathCut-v1", line="straight")
    rng = np.random.default_rng(0)
    for episode in range(4):
        seen, info = gentle.reset(seed=3 if episode == 0 else None)
        shown, _ = steered.reset(seed=3 if episode == 0 else None)
        ended = False
        while not ended:
            np.testing.assert_array_equal(shown[: len(COMPONENTS)], seen)
            action = np.array([rng.uniform(-0.3, 1.0), rng.uniform(-1.0, 1.0)], np.float32)
            seen, reward, ended, _, info = gentle.step(action)
            shown, same, too, _, found = steered.step(np.append(action, np.float32(0.0)))
            assert (same, too) == (reward, ended)
            for group in ("truth", "energy", "cost_terms", "reward_terms"):
                assert {name: found[group][name] for name in info[group]} == info[group]
        assert (found["end"], found["is_success"]) == (info["end"], info["is_success"])
        assert set(found["path"].values()) == {0.0}


@pytest.mark.parametrize(
    "keywords", [{}, {"line": "excision", "start_before_target": 0.03}, {"line": half_ellipse(), "control_hz": 40}]
)
def test_a_batch_is_bit_for_bit_single_cuts(keywords):
    many = gymnasium.make_vec("cutenv/PathCut-v1", num_envs=3, **keywords)
    singles = [gymnasium.make("cutenv/PathCut-v1", **keywords) for _ in range(3)]
    shown, _ = many.reset(seed=10)
    for n, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=10 + n)[0], shown[n])
    rng, waits, ends = np.random.default_rng(1), np.zeros(3, bool), 0
    while ends < 5:
        actions = rng.uniform(-1.0, 1.0, (3, 3)).astype(np.float32)
        actions[:, 0] = np.abs(actions[:, 0])
        shown, rewards, ended, _, infos = many.step(actions)
        for n, single in enumerate(singles):
            if waits[n]:
                np.testing.assert_array_equal(single.reset()[0], shown[n])
                waits[n] = False
                continue
            seen, reward, over, _, info = single.step(actions[n])
            np.testing.assert_array_equal(seen, shown[n])
            assert (reward, over) == (rewards[n], ended[n])
            for group in ("truth", "energy", "reward_terms", "path"):
                for name, value in info[group].items():
                    assert infos[group][name][n] == value, (group, name)
            assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
            assert abs(info["energy"]["residual"]) <= 1e-12 * max(info["energy"]["work"], 1e-3)
            if over:
                assert infos["end"][n] == info["end"]
                waits[n], ends = True, ends + 1


def test_gymnasium_accepts_it():
    check_env(PathCutEnv(), skip_render_check=True)


def test_the_docstring_has_the_declared_tables():
    doc = " ".join((PathCutEnv.__doc__ or "").split())
    first = len(COMPONENTS)
    for number, one in enumerate(PATH_COMPONENTS):
        row = f"{first + number} {one.name} {one.meaning} {one.unit} {round(one.scale, 4):g} 0"
        assert row in doc
    for cost in PATH_COSTS:
        assert f"{cost.name} {cost.weight:g} {cost.text}" in doc
    for keyword in PathCutEnv.other_keywords:
        assert f"``{keyword}``" in doc or f" {keyword} " in doc, keyword


def test_the_line_ahead_is_where_it_is_drawn():
    env = PathCutEnv(line="s")
    env.reset(seed=4)
    for k in range(150):
        seen, _, _, _, info = env.step(to_path_action(0.012, UPRIGHT, 0.4 * math.sin(0.1 * k)))
    heading = math.atan2(env.cutting.steerings["across"][0], env.cutting.steerings["ahead"][0])
    assert abs(heading) > 0.02
    s, line = info["truth"]["blade_m"], env.cutting.line
    points = np.arange(301) * 0.5e-3
    found = dict(zip((one.name for one in PATH_COMPONENTS), seen[len(COMPONENTS) :], strict=True))
    for name, ahead in (("", 0.0), ("_near", 0.005), ("_further", 0.010), ("_far", 0.020)):
        east = np.interp(s + ahead, points, line.x) - info["truth"]["blade_x_m"]
        north = np.interp(s + ahead, points, line.y) - info["truth"]["blade_y_m"]
        left = -math.sin(heading) * east + math.cos(heading) * north
        turn = math.sin(np.interp(s + ahead, points, line.angle) - heading)
        assert 0.005 * found["aside" + name] == pytest.approx(left, abs=1e-8)
        assert 0.5 * found["direction" + name] == pytest.approx(turn, abs=1e-5)
        assert 25.0 * found["bend" + name] == pytest.approx(np.interp(s + ahead, points, line.curvature), abs=1e-4)


def test_the_map_is_the_cut_beside_the_line():
    env = PathCutEnv(line="arc")
    env.reset(seed=2)
    for _ in range(250):
        _, _, _, _, info = env.step(to_path_action(0.012, UPRIGHT, 0.0))
    cut, curvature = env.cutting.cut_distance, env.cutting.line.curvature
    area = 0.5e-3 * (np.abs(cut) * (1.0 - 0.5 * curvature[: len(cut)] * cut)).sum()
    assert info["path"]["area_mm2"] == pytest.approx(1e6 * area, rel=1e-9)
    assert info["path"]["largest_distance_mm"] == pytest.approx(1e3 * np.abs(cut).max(), rel=1e-12)
    assert info["path"]["largest_distance_mm"] > 1.0


def test_a_cut_between_turns_of_the_crack_is_in_the_map_at_once():
    """A long response leaves much of the cut to what runs straight on."""
    env = PathCutEnv(line="arc", response_time=0.1, control_hz=1000, target_length=0.08)
    env.reset(seed=2)
    largest = 0.0
    for _ in range(4950):
        _, _, _, _, info = env.step(to_path_action(0.012, UPRIGHT, 0.0))
        assert info["path"]["largest_distance_mm"] >= largest - 1e-3
        largest = info["path"]["largest_distance_mm"]
    steering = env.cutting.steerings[0]
    assert env.cutting.paths["area"][0] > env.cutting.paths["passed_area"][0]
    assert int(env.cutting.plant.states["tip"][0] * 2000) > steering["cell"]


def test_drawn_lines_are_as_told():
    lines, records = drawn_lines(*STORED.values())
    for n, line in enumerate(lines):
        assert length_within(line) >= 0.13
        assert (abs(line.y[:201]).max() >= 0.008) == (kind_of(n) != "straight")
    for n in range(1, len(lines), 2):
        np.testing.assert_array_equal(lines[n].y, -lines[n + 1].y)
    for name in ("along", "coupled", "across"):
        assert np.isfinite(records[name]).all()
    np.testing.assert_array_equal(records["along"][0], 1.0)
    np.testing.assert_array_equal(records["coupled"][0], 0.0)


@pytest.mark.parametrize("kind", range(1, len(KINDS)))
def test_stored_stiffness_is_that_of_the_model(kind):
    specimen, number = Specimen.drawn(3), 10
    lines, records = drawn_lines(*STORED.values())
    place = 1 + 64 * (kind - 1) + number
    np.testing.assert_array_equal(lines[place].y, first_of_pair(kind, number).y)
    solved = stiffness_on_line(specimen, lines[place])
    for name, part in zip(("along", "coupled", "across"), solved, strict=True):
        np.testing.assert_allclose(records[name][place] * specimen.stiffness(), part, rtol=1e-7, atol=1e-6)


def test_every_kind_is_drawn_and_the_seed_draws_the_line():
    found = {}
    for seed in range(40):
        env = PathCutEnv()
        env.reset(seed=seed)
        found[seed] = kind_of(int(env.cutting.paths["line"][0]))
    assert set(found.values()) == set(KINDS)
    again = PathCutEnv()
    again.reset(seed=7)
    assert kind_of(int(again.cutting.paths["line"][0])) == found[7]


def test_return_is_the_sum_of_the_terms_since_reset():
    env = PathCutEnv(line="excision", deadline_s=4.0)
    env.reset(seed=1)
    total, ended = 0.0, False
    while not ended:
        _, reward, ended, _, info = env.step(to_path_action(0.015, 1.2, 0.1))
        total += reward
    assert tuple(info["reward_terms"]) == ALL_PATH_TERMS
    assert sum(env.cutting.reward_totals.values()) == pytest.approx(total, abs=1e-9)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"line": "circle"}, "line must be one of"),
        ({"line": [(0.0, 0.0), (0.05, 0.01), (0.03, 0.02)]}, r"turns back at \(0.03, 0.02\) m"),
        ({"line": [(0.0, 0.0), (0.01, 0.02), (0.03, 0.025)]}, r"turns too far at \(.* m"),
        ({"line": [(0.0, 0.0), (0.05, 0.02), (0.1, 0.05)]}, r"leaves the slab at \(.* m. Stay within 30 mm"),
        (
            {"line": [(0.0, 0.0), (0.03, 0.0), (0.04, 0.004), (0.05, 0.0), (0.06, 0.0), (0.1, 0.0)]},
            r"bends too far at \(.* m",
        ),
        ({"line": arc(0.04)}, r"leaves the slab at \(0.0\d*, 0.0\d*\) m, after 5\d mm.*target_length of at most 0.02"),
        ({"line": arc(0.04), "target_length": 0.03}, "a cut of 30 mm needs 30 mm more"),
        ({"reward_from": "estimate"}, "reward_from"),
        ({"relaxing_share": 0.3}, "relaxing_share = 0.3"),
        ({"line_limit": -1.0}, "line_limit"),
        ({"crack_curvature": 1e9}, "crack_curvature"),
        ({"weight_offline": 1.0}, "weight_off_line"),
    ],
)
def test_bad_keywords_are_refused_by_name_and_place(keywords, message):
    with pytest.raises(ValueError, match=message):
        PathCutEnv(**keywords)


def test_a_length_beyond_a_given_line_is_refused_at_reset():
    env = PathCutEnv(line=arc(0.04), target_length=0.02)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="leaves the slab"):
        env.reset(options={"target_length": 0.06})


@pytest.mark.parametrize("action", [[0.0, 0.0], [0.0, 0.0, math.nan], [[0.0, 0.0, 0.0]]])
def test_bad_actions_are_refused(action):
    env = PathCutEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="speed, angle, turn"):
        env.step(np.array(action, np.float32))
    batch = PathBatch(1, env)
    batch.give_seeds([0], np.arange(1), np.random.default_rng())
    batch.begin(np.arange(1))
    with pytest.raises(ValueError, match="speed, angle"):
        batch.decide(np.array([action], np.float32))
