"""cutenv/PathCut-v1: a blade that is steered cuts along a line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from map_tasks import cut, returns

import cutenv  # noqa: F401
from cutenv.agents.policy.path_policies import BladeOnLine, StraightOn
from cutenv.display.viewer import palette
from cutenv.display.viewer.scene import Layout
from cutenv.envs.path_cut import PathCutEnv, to_path_action
from cutenv.sim.tissue.drawn_lines import KINDS, MIXED_KINDS, STORED, drawn_lines, first_of_pair, kind_of
from cutenv.sim.tissue.lines import arc, length_within
from cutenv.sim.tissue.path_model import stiffness_on_line
from cutenv.sim.tissue.specimen import Specimen
from cutenv.task.observation import COMPONENTS
from cutenv.task.path import PATH_COMPONENTS

UPRIGHT = math.pi / 2


def test_the_line_ahead_is_where_it_is_drawn():
    env = PathCutEnv(line="s")
    env.reset(seed=4)
    for k in range(150):
        seen, _, _, _, info = env.step(to_path_action(0.012, UPRIGHT, 0.4 * math.sin(0.1 * k)))
    heading = math.atan2(env.cutting.motion["across"][0], env.cutting.motion["ahead"][0])
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
    steering = env.cutting.motion[0]
    assert env.cutting.whole["area"][0] > env.cutting.whole["passed_area"][0]
    assert int(env.cutting.plant.states["tip"][0] * 2000) > steering["cell"]


def test_drawn_lines_are_as_told():
    lines, records = drawn_lines(*STORED.values())
    for n, line in enumerate(lines):
        if kind_of(n) == "fusiform":
            continue
        assert length_within(line) >= 0.13
        assert (abs(line.y[:201]).max() >= 0.008) == (kind_of(n) != "straight")
        assert records["length"][n] == 0.0
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
        found[seed] = kind_of(int(env.cutting.whole["line"][0]))
    assert set(found.values()) == set(MIXED_KINDS)
    again = PathCutEnv()
    again.reset(seed=7)
    assert kind_of(int(again.cutting.whole["line"][0])) == found[7]


def test_the_picture_has_the_cut_where_it_is():
    pytest.importorskip("pygame", reason="pictures are an extra: pip install 'cutenv[view]'")
    env = PathCutEnv(line="excision", render_mode="rgb_array", target_length=0.08)
    env.reset(seed=4)
    for _ in range(150):
        env.step(to_path_action(0.012, UPRIGHT, 0.0))
    picture, shown = env.render(), env.cutting.shown_path
    assert np.abs(shown.cut[:, 1]).max() > 0.002
    layout = Layout()
    for x, y in shown.cut[10:-20:5]:
        column, row = layout.clamp + layout.scale * x, layout.cut_line - layout.scale * y  # left is up
        assert np.abs(picture[round(row), round(column)].astype(int) - palette.GAP).max() < 60
        assert np.abs(picture[round(row) + 12, round(column)].astype(int) - palette.GAP).max() > 60


def test_cutting_straight_across_costs_more_than_doing_nothing():
    assert returns("path", StraightOn(), line="s").mean() < -0.1


def test_a_cut_that_leaves_its_line_ends_there_and_costs_more_than_stopping():
    _, total, info = cut("path", StraightOn(), 3, line="s", target_length=0.1)
    assert info["end"] == "off_line"
    assert not info["is_success"]
    assert 8.0 < info["path"]["largest_distance_mm"] < 12.0
    assert info["reward_terms"]["safety"] < -0.4
    assert total < -0.1  # the return of doing nothing


def test_a_blade_that_leaves_the_slab_stays_there_until_the_deadline():
    env = PathCutEnv(line="straight", deadline_s=6.0, line_limit=0.03)
    env.reset(seed=1)
    ended, k = False, 0
    while not ended:
        _, _, ended, _, info = env.step(to_path_action(0.0254, UPRIGHT, 1.5 if k < 50 else 0.0))
        k += 1
    assert info["end"] in ("deadline", "force_limit")
    assert abs(info["truth"]["blade_y_m"]) <= 0.0151


def test_force_to_the_side_counts_against_the_limit():
    """The same motion ends at a limit of force between the part along the blade and the whole."""
    sizes = {}
    for limit in (1000.0, 150.0):
        env = PathCutEnv(line="straight", force_limit_per_depth=limit, line_limit=0.03)
        env.reset(seed=5)
        along = whole = 0.0
        for k in range(150):
            _, _, ended, _, info = env.step(to_path_action(0.01, UPRIGHT, 1.5 if 40 < k < 80 else 0.0))
            forces, lateral = env.cutting.readings["true_force"], env.cutting.across[: env.cutting.updates]
            along, whole = max(along, np.abs(forces).max()), max(whole, np.hypot(forces, lateral).max())
            if ended:
                break
        sizes[limit] = along, whole, info.get("end")
    assert sizes[1000.0][1] > 1.02 * sizes[1000.0][0]


def test_success_asks_for_the_line():
    cuts = [cut("path", BladeOnLine(), seed, line="s")[2] for seed in range(20)]
    finished = [info for info in cuts if info["end"] == "finished"]
    assert finished
    for info in finished:
        if info["is_success"]:
            assert info["path"]["largest_distance_mm"] <= 3.0
            assert info["path"]["mean_distance_mm"] <= 1.0 / 0.95
        assert info["is_success"] == (info["reward_terms"]["success"] > 0.0)
    assert not all(info["is_success"] for info in finished)


def test_a_length_beyond_a_given_line_is_refused_at_reset():
    env = PathCutEnv(line=arc(0.04), target_length=0.02)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="leaves the slab"):
        env.reset(options={"target_length": 0.06})


def test_a_loaded_blade_that_is_turned_across_its_way_stays_loaded():
    """It feels nothing along its way then, but the tissue still holds it from the side."""
    env = PathCutEnv(line="straight", target_length=0.06)
    env.reset(seed=1)
    for speed, turn, steps in ((0.012, 0.0, 265), (0.0, 0.0, 20), (0.0, 1.5, 55), (0.0, 0.0, 60)):
        for _ in range(steps):
            _, _, ended, _, info = env.step(to_path_action(speed, UPRIGHT, turn))
            assert not ended
    along, across = env.cutting.readings["force"][-1], env.cutting.across[-1]
    assert along < env.plant.cuts["laws"]["friction_per_depth"][0, 0] * 0.01
    assert abs(across) > 1.0
    assert info["truth"]["blade_m"] - info["truth"]["tip_m"] > 0.005
    assert env.cutting.progress["quiet"][0] == 0.0
