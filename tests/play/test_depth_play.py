"""Cuts by a person along a wanted depth: the wheel leads the blade's level, the record holds it, the card tells it."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path

import numpy as np
import pytest

from cutenv.commands import play
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.play.devices import LOWERED_BY_NOTCH, MouseDevice, simple_hand
from cutenv.play.haptics import Stylus
from cutenv.play.play_session import Session, SessionPlan
from cutenv.play.played_depth_cut import PlayedDepthCut
from cutenv.recording import load
from cutenv.task.depth import DESCENT_SCALE
from cutenv.viewer.scene import Moment

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")


def played(levels: bool = True, target_length: float = 0.06) -> PlayedDepthCut:
    cut = PlayedDepthCut(seed=3, target_length=target_length)
    hand = simple_hand(target_length, level=cut.wanted_level if levels else lambda position: 0.0)
    while not cut.end:
        cut.tick(hand.read())
    return cut


def test_a_hand_that_keeps_its_level_at_the_specimens_own_depth_is_that_of_gentle_cutting() -> None:
    gentle = GentleCutEnv(drive="hand", control_hz=100)
    depth = DepthCutEnv(drive="hand", control_hz=100, wanted="profile")
    for env in (gentle, depth):
        env.reset(seed=5)
    for k in range(300):
        action = np.array([0.5, np.sin(0.05 * k)], np.float32)
        ours, reward, ended, *_ = gentle.step(action)
        theirs, other, over, *_ = depth.step(np.append(action, np.float32(0.0)))
        assert np.array_equal(ours, theirs[:12])
        assert (reward, ended) == (other, over)
        if ended:
            break


def test_a_hand_that_follows_the_dashed_depth_cuts_as_deep_as_wanted() -> None:
    followed, held = played(levels=True), played(levels=False)
    assert followed.cutting.errors["mean_error_mm"] < 1.0
    ended = Moment.of(held.plant, held.cutting)
    assert ended.verdict == "stopped: the layer below was opened too deep"
    there = dataclasses.replace(ended, end="finished", tip=ended.target, angle=np.pi / 2)
    assert there.verdict == "finished: not as deep as wanted"
    assert dataclasses.replace(there, angle=1.2).verdict == "finished: blade at 69°, not upright"
    assert held.end == "layer"  # the surface rises, so that a blade at one level gets too deep


def test_the_record_holds_height_and_vertical_force(tmp_path: Path) -> None:
    session = Session(
        MouseDevice(), SessionPlan(task="depth", seed=3, target_length=0.06, countdown=0.0), folder=tmp_path
    )
    session.device = simple_hand(0.06, level=session.cut.wanted_level)
    session.begin()
    for k in range(2000):
        session.advance(0.02 * k)
        if session.phase == "ended":
            break
    (trace,) = load(session.records[0])
    assert trace.height is not None
    assert trace.vertical_force is not None
    assert np.ptp(trace.height) > 0.005
    assert trace.metadata["environment"] == "cutenv/DepthCut-v1"
    assert json.loads(json.dumps(trace.metadata))["mean_error_mm"] < 1.0
    words = session.sight().verdict
    assert len(words) == 1
    assert words[0].startswith(f"Depth: {trace.metadata['mean_error_mm']:.1f} mm off")


def test_the_wheel_lowers_the_blade_by_half_a_millimetre_a_notch() -> None:
    mouse, cut = MouseDevice(), PlayedDepthCut(seed=3, target_length=0.06)
    start = cut.level
    mouse.lower(-2.0)
    for _ in range(400):
        cut.tick(mouse.read())
    assert cut.level == pytest.approx(start - 2.0 * LOWERED_BY_NOTCH, abs=2e-5)
    mouse.open()
    assert mouse.read() == Stylus(0.0, np.pi / 2)


def test_wheel_finger_and_second_stick_lead_the_depth_and_with_shift_the_wheel_tilts() -> None:
    pygame = pytest.importorskip("pygame")
    from cutenv.play.play_window import PlayWindow

    session = Session(MouseDevice(), SessionPlan(task="depth", seed=3, target_length=0.06, countdown=0.0))
    window = PlayWindow(session, scripted=False)
    session.begin()
    session.advance(0.0)
    session.advance(0.01)
    pygame.event.post(pygame.event.Event(pygame.MOUSEWHEEL, x=0, y=-1))
    window.take_events()
    assert window.mouse.read().level == -LOWERED_BY_NOTCH
    pygame.key.set_mods(pygame.KMOD_SHIFT)
    pygame.event.post(pygame.event.Event(pygame.MOUSEWHEEL, x=0, y=-1))
    window.take_events()
    pygame.key.set_mods(0)
    assert window.mouse.read().level == -LOWERED_BY_NOTCH
    assert window.mouse.read().angle < np.pi / 2
    width, height = window._window.size
    for kind, finger, y in ((pygame.FINGERDOWN, 1, 90), (pygame.FINGERDOWN, 2, 90), (pygame.FINGERMOTION, 2, 90 + 24)):
        told = {"finger_id": finger, "touch_id": 1, "x": 100 / width, "y": y / height, "dx": 0.0, "dy": 0.0}
        pygame.event.post(pygame.event.Event(kind, **told))
    window.take_events()
    assert window.mouse.read().level == pytest.approx(-3 * LOWERED_BY_NOTCH), "a second finger turns the wheel, too"
    pygame.event.post(pygame.event.Event(pygame.CONTROLLERAXISMOTION, axis=pygame.CONTROLLER_AXIS_RIGHTY, value=32767))
    window.take_events()
    assert window.gamepad.read().level == pytest.approx(-1e-3 * DESCENT_SCALE, rel=0.01)
    session.close()


def test_the_command_plays_a_cut_with_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--task", "depth", "--scripted", "--seed", "3", "--target-length", "60mm", "--out", str(tmp_path)]
    assert play.main([*arguments, "--picture", str(tmp_path / "cut.png")]) == 0
    assert (tmp_path / "cut.png").stat().st_size > 20_000
    assert "record: " in capsys.readouterr().out
    assert play.main([*arguments, "--course", "first", "--operator", "P07"]) == 2
    assert "--task" in capsys.readouterr().err
