"""Cuts by a person along a wanted depth or a line: the hand leads level or direction, record and card hold it."""

from __future__ import annotations

import dataclasses
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from played import Pushing
from played_window import begin, post, press, pygame, show

from cutenv.commands import play
from cutenv.display.viewer.scene import Moment
from cutenv.people.play.devices import (
    KEY_SPEED,
    LEAD,
    LOWERED_BY_NOTCH,
    GamepadDevice,
    MouseDevice,
    ScriptedDevice,
    simple_hand,
)
from cutenv.people.play.hand_model import turn_toward
from cutenv.people.play.haptics import Stylus
from cutenv.people.play.picture import LAYOUT
from cutenv.people.play.play_session import Session, SessionPlan
from cutenv.people.play.play_window import PlayWindow
from cutenv.people.play.played_cut import PlayedCut, PlayedDepthCut, PlayedPathCut
from cutenv.records import load_one
from cutenv.records.scoring.cut_map import LINE_KEY
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.trace import Trace
from cutenv.task.depth import DESCENT_SCALE
from cutenv.task.path import TURN_SCALE

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
UPRIGHT = math.pi / 2


def whole(cut: PlayedCut, hand: ScriptedDevice | None = None) -> PlayedCut:
    """Lead a cut to its end by a hand, by default its simple one."""
    hand = hand or cut.simple_hand()
    while not cut.end:
        cut.tick(hand.read())
    return cut


def led(cut: PlayedPathCut, along: float, across: float, ticks: int) -> PlayedPathCut:
    """Hold the hand at a place."""
    for _ in range(ticks):
        cut.tick(Stylus(along, UPRIGHT, across=across))
    return cut


def test_on_the_straight_line_the_hand_is_that_of_gentle_cutting_to_the_last_bit() -> None:
    gentle, straight = (whole(kind) for kind in (
        PlayedCut(seed=3, target_length=0.06), PlayedPathCut(line="straight", seed=3, target_length=0.06)
    ))  # fmt: skip
    assert len(gentle.readings) > 4000
    assert np.array_equal(gentle.readings, straight.readings)
    assert gentle.end == straight.end


def test_a_hand_that_follows_the_dashed_depth_cuts_as_deep_as_wanted() -> None:
    followed = whole(PlayedDepthCut(seed=3, target_length=0.06))
    held = whole(PlayedDepthCut(seed=3, target_length=0.06), simple_hand(0.06, level=lambda position: 0.0))
    assert followed.cutting.errors["mean_error_mm"] < 1.0
    ended = Moment.of(held.plant, held.cutting)
    assert ended.verdict == "stopped: the layer below was opened too deep"
    there = dataclasses.replace(ended, end="finished", tip=ended.target, angle=np.pi / 2)
    assert there.verdict == "finished: not as deep as wanted"
    assert dataclasses.replace(there, angle=1.2).verdict == "finished: blade at 69°, not upright"
    assert held.end == "layer"  # the surface rises, so that a blade at one level gets too deep


@pytest.mark.parametrize("line", ["arc", "s", "excision", "random"])
def test_a_hand_that_goes_along_a_line_cuts_within_millimetres_of_it(line: str) -> None:
    cut = PlayedPathCut(line=line, seed=4, target_length=0.06)
    assert whole(cut).end != "off_line"
    found = cut.cutting.errors
    assert 0.05 < found["mean_distance_mm"] < 1.5
    assert found["largest_distance_mm"] < 3.0
    assert np.ptp(cut.cutting.line.y[:120]) > 0.005, "straight on would not have done"


def test_the_blade_turns_to_where_the_hand_is_moved_and_no_faster_than_an_agent_may() -> None:
    cut = PlayedPathCut(line="straight", seed=4, target_length=0.06)
    led(cut, 0.02, 0.0, 1500)
    turned = []
    for _ in range(1500):
        before = cut.cutting.shown_path.heading
        led(cut, cut.hand_place[0] + 0.002, cut.hand_place[1] + 0.001, 1)
        after = cut.cutting.shown_path.heading
        turned.append(math.asin(before[0] * after[1] - before[1] * after[0]))
    assert math.atan2(*cut.cutting.shown_path.heading[::-1]) == pytest.approx(math.atan2(1, 2), abs=0.05)
    assert max(turned) <= 1e-3 * TURN_SCALE * (1 + 1e-9)


def test_the_blade_points_ahead_to_either_side_and_is_drawn_back_without_a_turn() -> None:
    assert turn_toward(0.002, 0.0) == 0.0
    assert turn_toward(0.002, 1e-4) == -turn_toward(0.002, -1e-4) > 0.0
    assert turn_toward(0.0, 0.003) == TURN_SCALE
    assert turn_toward(-0.003, 0.001) == 0.0


def test_the_hand_stands_before_the_blade_where_it_points() -> None:
    cut = led(PlayedPathCut(line="arc", seed=4, target_length=0.06), 0.03, 0.01, 1500)
    ahead = np.subtract(cut.hand_place, cut.cutting.blade_place)
    heading = cut.cutting.shown_path.heading
    assert np.hypot(*ahead) > 1e-3
    assert ahead[0] * heading[1] == pytest.approx(ahead[1] * heading[0], abs=1e-9)


def recorded(task: str, folder: Path, **plan: Any) -> tuple[Session, Trace]:
    """A session of one cut of a task by its simple hand, and the record of it."""
    session = Session(
        MouseDevice(), SessionPlan(task=task, seed=3, target_length=0.06, countdown=0.0, **plan), folder=folder
    )
    session.device = session.cut.simple_hand()
    session.begin()
    for k in range(2000):
        session.advance(0.02 * k)
        if session.phase == "ended":
            break
    return session, load_one(session.records[0])


def test_the_record_holds_height_and_vertical_force(tmp_path: Path) -> None:
    session, trace = recorded("depth", tmp_path)
    assert trace.vertical_force is not None
    assert np.ptp(trace.height) > 0.005
    assert trace.metadata["environment"] == "cutenv/DepthCut-v1"
    assert trace.metadata["mean_error_mm"] < 1.0
    (words,) = session.sight().verdict
    assert words.startswith(f"Depth: {trace.metadata['mean_error_mm']:.1f} mm off")


def test_the_record_holds_places_lateral_force_and_the_line(tmp_path: Path) -> None:
    session, trace = recorded("path", tmp_path, line="s")
    cut = session.cut
    assert isinstance(cut, PlayedPathCut)
    assert np.array_equal(np.column_stack((trace.blade_x, trace.blade_y)), cut.places)
    assert np.array_equal(trace.lateral_force, cut.lateral_force)
    assert np.ptp(trace.lateral_force) > 0.2
    # The blade's way over its speed is the time: the places are those of the readings.
    ways = np.hypot(np.diff(trace.blade_x), np.diff(trace.blade_y))
    assert np.allclose(ways, 1e-3 * np.abs(trace.speed[1:]), atol=1e-8)
    line = np.array(trace.metadata[LINE_KEY])
    assert np.allclose(line[10], (cut.cutting.line.x[50], cut.cutting.line.y[50]), atol=1e-6)
    assert np.allclose(np.hypot(*np.diff(line, axis=0).T), 5 * SPACING, rtol=1e-3)
    (words,) = session.sight().verdict
    told = cut.cutting.errors
    assert words == (
        f"Path: {told['mean_distance_mm']:.1f} mm off the line in the mean, {told['largest_distance_mm']:.1f} mm at "
        f"most; {told['area_mm2']:.0f} mm² between them."
    )
    assert trace.metadata["area_mm2"] == round(told["area_mm2"], 3)
    assert trace.metadata["environment"] == "cutenv/PathCut-v1"


def test_an_end_off_the_line_is_told_in_words() -> None:
    cut = PlayedPathCut(line="arc", seed=4, target_length=0.09)
    for k in range(20_000):
        cut.tick(Stylus(min(0.012e-3 * k, 0.12), UPRIGHT))
    assert cut.end == "off_line"
    moment = Moment.of(cut.plant, cut.cutting)
    assert moment.verdict == "stopped: the cut came too far from the line"
    there = dataclasses.replace(moment, end="finished", tip=moment.target)
    assert there.verdict == "finished: not along the line"


def test_the_wheel_lowers_the_blade_by_half_a_millimetre_a_notch() -> None:
    mouse, cut = MouseDevice(), PlayedDepthCut(seed=3, target_length=0.06)
    start = cut.level
    mouse.lower(-2.0)
    for _ in range(400):
        cut.tick(mouse.read())
    assert cut.level == pytest.approx(start - 2.0 * LOWERED_BY_NOTCH, abs=2e-5)
    mouse.open()
    assert mouse.read() == Stylus(0.0, np.pi / 2)


def test_a_mouse_leads_in_the_plane_by_three_millimetres_at_most_and_keeps_its_direction() -> None:
    mouse = MouseDevice()
    mouse.move(0.03, 0.04)
    mouse.keep_near(0.0, 0.0)
    assert mouse.read()[:1] + mouse.read()[4:] == pytest.approx((0.6 * LEAD, 0.8 * LEAD))
    mouse.open()
    assert mouse.read() == Stylus(0.0, UPRIGHT)


def test_a_stick_moves_the_hand_across_and_away_is_to_the_left() -> None:
    pad = GamepadDevice()
    pad.hold(0.0, 0.0, 0.0, -1.0)
    for _ in range(500):
        pad.read()
    assert pad.across == pytest.approx(0.5 * 0.0254, rel=0.01)
    with pytest.raises(ValueError, match="sideways"):
        pad.hold(0.0, 0.0, 0.0, 3.0)


def test_wheel_finger_and_second_stick_lead_the_depth_and_with_shift_the_wheel_tilts() -> None:
    session = Session(MouseDevice(), SessionPlan(task="depth", seed=3, target_length=0.06, countdown=0.0))
    window = PlayWindow(session, scripted=False)
    window._window._fps = 0.0
    begin(window)
    post(pygame.MOUSEWHEEL, x=0, y=-1)
    window.take_events()
    assert window.mouse.read().level == -LOWERED_BY_NOTCH
    pygame.key.set_mods(pygame.KMOD_SHIFT)
    post(pygame.MOUSEWHEEL, x=0, y=-1)
    window.take_events()
    pygame.key.set_mods(0)
    assert window.mouse.read().level == -LOWERED_BY_NOTCH
    assert window.mouse.read().angle < np.pi / 2
    width, height = window._window.size
    for kind, finger, y in ((pygame.FINGERDOWN, 1, 90), (pygame.FINGERDOWN, 2, 90), (pygame.FINGERMOTION, 2, 90 + 24)):
        told = {"finger_id": finger, "touch_id": 1, "x": 100 / width, "y": y / height, "dx": 0.0, "dy": 0.0}
        post(kind, **told)
    window.take_events()
    assert window.mouse.read().level == pytest.approx(-3 * LOWERED_BY_NOTCH), "a second finger turns the wheel, too"
    post(pygame.CONTROLLERAXISMOTION, axis=pygame.CONTROLLER_AXIS_RIGHTY, value=32767)
    window.take_events()
    assert window.gamepad.read().level == pytest.approx(-1e-3 * DESCENT_SCALE, rel=0.01)
    session.close()


def test_mouse_arrow_keys_and_stick_lead_the_hand_across_in_the_window() -> None:
    session = Session(MouseDevice(), SessionPlan(task="path", line="arc", seed=3, target_length=0.06, countdown=0.0))
    window = PlayWindow(session)
    window._window._fps = 0.0
    begin(window)
    post(pygame.MOUSEMOTION, rel=(0, -3), pos=(0, 0), buttons=(0, 0, 0))
    window.take_events()
    assert window.mouse.across == pytest.approx(3 / LAYOUT.scale)
    press(pygame.K_UP)
    press(pygame.K_RIGHT)
    window.take_events()
    assert window.mouse.velocity == pytest.approx((KEY_SPEED / math.sqrt(2), KEY_SPEED / math.sqrt(2)))
    assert window.mouse.angle == UPRIGHT
    for key in (pygame.K_UP, pygame.K_RIGHT):
        post(pygame.KEYUP, key=key)
    post(pygame.CONTROLLERAXISMOTION, axis=pygame.CONTROLLER_AXIS_LEFTY, value=-32767)
    show(window)
    assert window.mouse.velocity == (0.0, 0.0)
    assert window.gamepad.velocity[1] == pytest.approx(0.0254, rel=0.01)
    session.close()


@pytest.mark.parametrize("task", [["depth"], ["path", "--line", "arc"]])
def test_the_command_plays_a_cut(task: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--task", *task, "--scripted", "--seed", "3", "--target-length", "60mm", "--out", str(tmp_path)]
    assert play.main([*arguments, "--picture", str(tmp_path / "cut.png")]) == 0
    assert (tmp_path / "cut.png").stat().st_size > 20_000
    printed = capsys.readouterr().out
    assert "record: " in printed
    assert int(re.search(r"overall score (\d+) of 100", printed)[1]) > 50  # a cut worth watching


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--task", "depth", "--course", "first", "--operator", "P07"], "--task"),
        (["--line", "arc"], "--line arc is for cuts along a drawn line"),
        (["--task", "path", "--device", "inverse3"], "--task path is steered by mouse, keys or gamepad"),
        (["--course", "first", "--operator", "P07", "--line", "arc"], "--line cannot be given with --course"),
    ],
)
def test_what_does_not_fit_is_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert play.main(arguments) == 2
    assert message in capsys.readouterr().err


def test_a_session_refuses_a_line_without_its_task_and_a_device_that_pushes() -> None:
    with pytest.raises(ValueError, match="needs a task along a line"):
        Session(MouseDevice(), SessionPlan(line="arc"))
    with pytest.raises(ValueError, match="takes no device that pushes"):
        Session(Pushing(), SessionPlan(task="path"))
