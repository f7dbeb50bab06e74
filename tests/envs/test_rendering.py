"""The picture of a cut: what it shows, where it stands, and that it needs no display."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import cutenv  # noqa: F401  (registers the environment)
from cutenv.display.viewer import CutViewer, Layout, Moment, palette
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.gentle_cut import GentleCutEnv

pygame = pytest.importorskip("pygame", reason='drawing is an extra: pip install "cutenv[view]"')

LAYOUT = Layout()
VIEWS_FROM_ABOVE = np.s_[60:385, 50:650]
VIEW_FROM_THE_SIDE = np.s_[402:520, 50:650]
CHART = np.s_[568:706, 60:650]
LEGEND = np.s_[590:706, 672:944]
Picture = NDArray[np.uint8]


@pytest.fixture
def env() -> Iterator[GentleCutEnv]:
    env = GentleCutEnv(render_mode="rgb_array", specimen_class="uniform", target_length=0.08)
    env.reset(seed=3)
    yield env
    env.close()


def picture_of(env: GentleCutEnv) -> Picture:
    picture = env.render()
    assert picture is not None
    return picture


def advance(env: GentleCutEnv, steps: int, speed: float = 0.55, angle: float = 1.0) -> None:
    for _ in range(steps):
        env.step(np.array([speed, angle], np.float32))


def check_differs(before: Picture, after: Picture, part: tuple[slice, slice], least: int = 100) -> None:
    """At least ``least`` pixels of a part of the picture have changed."""
    changed = np.any(before[part] != after[part], axis=-1).sum()
    assert changed >= least, f"{changed} pixels changed"


# The environment's promises


def test_rgb_array_is_a_picture_of_the_declared_shape(env: GentleCutEnv) -> None:
    picture = picture_of(env)
    assert picture.dtype == np.uint8
    assert picture.shape == (LAYOUT.height, LAYOUT.width, 3)
    assert picture.flags.writeable


def test_a_picture_belongs_to_whoever_asked_for_it(env: GentleCutEnv) -> None:
    first = picture_of(env)
    kept = first.copy()
    advance(env, 50)
    picture_of(env)
    assert np.array_equal(first, kept)


def test_the_same_moment_gives_the_same_picture(env: GentleCutEnv) -> None:
    advance(env, 100)
    assert np.array_equal(picture_of(env), picture_of(env))


@pytest.mark.parametrize("part", [VIEWS_FROM_ABOVE, VIEW_FROM_THE_SIDE, CHART], ids=["above", "side", "chart"])
def test_every_view_changes_as_the_cut_advances(env: GentleCutEnv, part: tuple[slice, slice]) -> None:
    before = picture_of(env)
    advance(env, 100)
    after = picture_of(env)
    check_differs(before, after, part)
    with pytest.raises(AssertionError, match="0 pixels changed"):
        check_differs(before, after, LEGEND)


def test_the_view_from_the_side_shows_the_angle_of_the_blade(env: GentleCutEnv) -> None:
    advance(env, 150)
    advance(env, 20, speed=0.0)
    upright = picture_of(env)
    advance(env, 40, speed=0.0, angle=1.0)
    with pytest.raises(AssertionError):
        check_differs(upright, picture_of(env), VIEW_FROM_THE_SIDE, least=1000)
    advance(env, 40, speed=0.0, angle=-1.0)
    check_differs(upright, picture_of(env), VIEW_FROM_THE_SIDE, least=1000)


def test_the_force_of_every_step_is_drawn_however_rarely_a_picture_is_asked_for(env: GentleCutEnv) -> None:
    felt = []
    for _ in range(150):
        advance(env, 1, speed=0.8)
        felt.append(env.cutting.readings["force"].copy())
    picture_of(env)
    drawn = env._viewer._trace.whole()[:, 1]
    assert {force.min() for force in felt} | {force.max() for force in felt} <= set(drawn)


def test_the_last_term_of_the_reward_stands_clear_of_the_legend(env: GentleCutEnv) -> None:
    advance(env, 20)
    assert np.all(picture_of(env)[588:592, 665:950] == palette.PAPER)


def test_a_new_cut_starts_with_an_empty_chart(env: GentleCutEnv) -> None:
    fresh = picture_of(env)
    advance(env, 100)
    picture_of(env)
    env.reset(seed=3)
    assert np.array_equal(picture_of(env), fresh)


def test_rendering_without_a_render_mode_warns() -> None:
    env = GentleCutEnv()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def test_drawing_does_not_change_the_cut() -> None:
    ends = []
    for mode in (None, "rgb_array"):
        env = GentleCutEnv(render_mode=mode)
        env.reset(seed=5)
        for _ in range(40):
            observation = env.step(np.array([0.5, 0.0], np.float32))[0]
            if mode:
                env.render()
        ends.append(observation)
    assert np.array_equal(*ends)


# Display and window


def test_arrays_need_no_display_and_leave_the_environment_variables_alone(env: GentleCutEnv) -> None:
    pygame.display.quit()
    variables = dict(os.environ)
    picture_of(env)
    assert not pygame.display.get_init()
    assert dict(os.environ) == variables


def test_closing_an_array_viewer_leaves_a_window_of_others_open(
    env: GentleCutEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    picture_of(env)
    env.close()
    assert pygame.display.get_init()
    pygame.display.quit()


@pytest.fixture
def window_env(monkeypatch: pytest.MonkeyPatch) -> Iterator[GentleCutEnv]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = GentleCutEnv(render_mode="human", control_hz=200)
    yield env
    env.close()
    pygame.display.quit()


def test_human_mode_shows_the_picture_in_a_window_and_closes_it(window_env: GentleCutEnv) -> None:
    window_env.reset(seed=0)
    advance(window_env, 3)
    assert window_env.render() is None
    window = pygame.display.get_surface()
    assert window.get_size() == (LAYOUT.width, LAYOUT.height)
    assert tuple(window.get_at((2, 2)))[:3] == palette.HEADER_COLOUR
    window_env.close()
    assert not pygame.display.get_init()
    window_env.close()


def test_closing_the_window_ends_the_drawing_and_not_the_cut(window_env: GentleCutEnv) -> None:
    window_env.reset(seed=0)
    advance(window_env, 1)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    advance(window_env, 1)
    assert not pygame.display.get_init()
    advance(window_env, 5)
    assert not pygame.display.get_init()


def test_the_window_keeps_the_pace_of_the_control(window_env: GentleCutEnv) -> None:
    window_env.reset(seed=0)
    advance(window_env, 5)
    start = time.perf_counter()
    advance(window_env, 20)
    assert time.perf_counter() - start > 0.8 * 20 / 200


def test_a_missing_pygame_names_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    for window in (False, True):
        with pytest.raises(ImportError, match=r'pip install "cutenv\[view\]"'):
            CutViewer(window=window)


# Where things stand


@pytest.mark.parametrize("length", [0.06, 0.0733, 0.1])
def test_the_target_line_stands_where_the_geometry_says(env: GentleCutEnv, length: float) -> None:
    """The target line crosses the uncut slab, the view from the side and the chart at ``length``."""
    env.reset(seed=0, options={"target_length": length})
    picture = picture_of(env)
    column = round(LAYOUT.along(length))
    for row in (150, LAYOUT.blade_end - 78, LAYOUT.chart_top + 40):
        found = picture[round(row), column - 1 : column + 1].astype(int)
        assert np.abs(found - palette.TARGET).sum(axis=-1).min() < 60, f"row {row}: {found.tolist()}"


def test_the_tolerance_ends_three_millimetres_beyond_the_target(env: GentleCutEnv) -> None:
    """The band of the tolerance ends there in the chart: tinted to the left, not to the right."""
    picture = picture_of(env)
    column, row = LAYOUT.along(0.083), round(LAYOUT.chart_top + 30)
    inside, outside = picture[row, round(column) - 3], picture[row, round(column) + 3]
    assert outside.tolist() == list(palette.PANEL)
    assert inside.tolist() != list(palette.PANEL)


@pytest.mark.parametrize(("end", "colour"), [("finished", palette.SUCCESS), ("overshoot", palette.FAILURE)])
def test_the_end_colours_the_head_of_the_picture(
    env: GentleCutEnv, monkeypatch: pytest.MonkeyPatch, end: str, colour: tuple[int, int, int]
) -> None:
    moment = dataclasses.replace(Moment.of(env.plant, env.cutting), end=end, success=end == "finished")
    monkeypatch.setattr(Moment, "of", lambda plant, cutting: moment)
    picture = picture_of(env)
    assert picture[2, 2].tolist() == list(colour)


def test_a_picture_of_a_cut_with_depth_shows_the_wanted_floor_and_others_do_not() -> None:
    pictures = {}
    for env in (DepthCutEnv(render_mode="rgb_array"), GentleCutEnv(render_mode="rgb_array")):
        env.reset(seed=3)
        side = env.render()[400:522, 80:620].astype(int)
        blue = (side[..., 2] - side[..., 0] > 120).sum(axis=0)
        pictures[type(env)] = int((blue > 0).sum())
        env.close()
    assert pictures[DepthCutEnv] > 250  # the dashed line, from end to end
    assert pictures[GentleCutEnv] < 60  # the target alone
