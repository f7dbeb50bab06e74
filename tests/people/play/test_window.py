"""The window under SDL's dummy driver: keys, mouse and gamepad, pictures, and a cut that outlives the window."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from played import TARGET, Pushing, begun, run, session, whole
from played_window import FRAME, FakeClock, begin, post, press, pygame, show

from cutenv.commands import cli
from cutenv.display.viewer import palette
from cutenv.display.viewer.canvas import Canvas
from cutenv.display.viewer.views import tint
from cutenv.display.viewer.window import Window
from cutenv.people.play import play_window
from cutenv.people.play.devices import GamepadDevice, HandMotion, MouseDevice, ScriptedDevice
from cutenv.people.play.picture import LAYOUT, PlayPicture, fault_lines
from cutenv.people.play.play_session import GIVEN_UP, Session, SessionPlan, ViewState
from cutenv.people.play.play_window import PlayWindow
from cutenv.records import load_one
from cutenv.records.scoring import TechniqueFault
from cutenv.sim.tissue import measured_liver


def test_space_begins_the_mouse_leads_the_hand_and_the_wheel_leans_the_blade(window: PlayWindow) -> None:
    show(window)
    assert window.session.phase == "ready"
    begin(window)
    for _ in range(40):
        post(pygame.MOUSEMOTION, rel=(1, 7), pos=(0, 0), buttons=(0, 0, 0))
        show(window)
    post(pygame.MOUSEWHEEL, x=0, y=-6)
    press(pygame.K_UP)
    press(pygame.K_UP)
    show(window, 60)
    sight = window.session.sight()
    assert sight.hand == pytest.approx(40 / LAYOUT.scale, abs=1e-4)
    assert np.degrees(sight.moment.angle) == pytest.approx(70.0)


def test_what_the_mouse_does_before_the_cut_does_not_move_the_hand(window: PlayWindow) -> None:
    press(pygame.K_SPACE)
    show(window, 5)
    post(pygame.MOUSEMOTION, rel=(200, 0), pos=(0, 0), buttons=(0, 0, 0))
    show(window, 20)
    assert window.session.phase == "cutting"
    assert window.session.sight().hand == 0.0


def test_a_gamepad_that_begins_a_cut_leads_it(window: PlayWindow) -> None:
    show(window)
    post(pygame.CONTROLLERBUTTONDOWN, button=pygame.CONTROLLER_BUTTON_A)
    show(window, 20)
    assert window.session.phase == "cutting"
    assert isinstance(window.session.device, GamepadDevice)
    post(pygame.CONTROLLERAXISMOTION, axis=pygame.CONTROLLER_AXIS_LEFTX, value=32767)
    post(pygame.CONTROLLERAXISMOTION, axis=pygame.CONTROLLER_AXIS_TRIGGERRIGHT, value=32767)
    post(pygame.MOUSEMOTION, rel=(900, 0), pos=(0, 0), buttons=(0, 0, 0))
    show(window, 60)
    sight = window.session.sight()
    assert sight.hand == pytest.approx(0.0254, rel=0.1)
    assert np.degrees(sight.moment.angle) == pytest.approx(45.0)


def test_closing_the_window_amid_a_cut_keeps_the_record(window: PlayWindow, tmp_path: Path) -> None:
    begin(window)
    show(window, 30)
    post(pygame.QUIT)
    window.run()
    (record,) = tmp_path.iterdir()
    assert load_one(record).metadata["end"] == GIVEN_UP


def test_an_error_amid_a_cut_keeps_the_record(
    window: PlayWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(window)
    show(window, 30)

    def fail(self: PlayPicture, sight: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(PlayPicture, "draw", fail)
    with pytest.raises(KeyboardInterrupt):
        window.run()
    (record,) = tmp_path.iterdir()
    assert load_one(record).metadata["end"] == GIVEN_UP


def test_escape_closes_and_r_c_and_p_do_what_the_help_says(window: PlayWindow) -> None:
    show(window)
    press(pygame.K_c)
    press(pygame.K_p)
    show(window)
    assert window.session.chosen_class == "vascular"
    assert window.session.practice
    begin(window)
    cut = window.session.cut
    press(pygame.K_r)
    show(window)
    assert window.session.phase == "countdown"
    assert window.session.cut is not cut
    press(pygame.K_ESCAPE)
    window.run()
    assert not window._window.open


def test_slow_pictures_take_nothing_from_the_physics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blank = Canvas(8, 8, palette.PAPER)
    monkeypatch.setattr(PlayPicture, "draw", lambda self, sight: blank)
    ends = []
    for frame in (FRAME, 0.05):
        played = session(tmp_path, handle=True)
        window = PlayWindow(played, clock=FakeClock(frame))
        window._window._fps = 0.0
        played.begin()
        while played.phase != "ended":
            window.show_next()
        ends.append(played.cut.readings)
    assert np.array_equal(*ends)


def test_a_device_that_pushes_is_served_beside_the_pictures_and_let_go_with_the_window(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = Pushing()
    played = Session(device, SessionPlan(seed=6, target_length=TARGET, countdown=0.0), folder=tmp_path, handle=True)
    window = PlayWindow(played)
    draw, pictures = PlayPicture.draw, []

    def draw_some(self: PlayPicture, sight: ViewState) -> Canvas:
        pictures.append(len(sight.readings))
        if window._window.open and (pictures[-1] > 300 or len(pictures) > 2000):
            press(pygame.K_ESCAPE)
        return draw(self, sight)

    monkeypatch.setattr(PlayPicture, "draw", draw_some)
    press(pygame.K_SPACE)
    window.run()
    assert pictures[-1] > 300
    assert len(device.forces) >= pictures[-1]
    assert device.forces[-1] == 0.0
    assert not device.is_open
    (record,) = tmp_path.iterdir()
    assert load_one(record).metadata["device"] == "Pushing"


# Pictures


def picture_of(played: Session) -> np.ndarray:
    return PlayPicture().draw(played.sight()).picture()


def cut_halfway(**changes: Any) -> Session:
    played, clock = begun(handle=True, **changes)
    for k in range(200):
        played.advance(clock + k * FRAME)
    return played


def test_practice_shows_what_is_hidden_and_no_practice_does_not_tell_the_tip() -> None:
    played = cut_halfway()
    plain = picture_of(played)
    state = played.cut.plant.states
    # Same lag, so that the tissue looks the same but for the tip: from the side nothing may change with it.
    side = np.s_[370:560, 60:560]
    played.show_hidden(True)
    shown = picture_of(played)
    assert np.any(plain[side] != shown[side])
    assert np.any(plain[430:650, 600:] != shown[430:650, 600:])
    played.show_hidden(False)
    state["tip"] -= 0.004
    assert np.array_equal(picture_of(played)[side], plain[side])
    played.show_hidden(True)
    assert not np.array_equal(picture_of(played)[side], shown[side])


@pytest.mark.parametrize("phase", ["ready", "countdown", "ended"])
def test_each_phase_has_a_card_of_its_own(phase: str) -> None:
    played = session(handle=True)
    pictures = {"ready": picture_of(played)}
    played.begin()
    played.advance(0.0)
    pictures["countdown"] = picture_of(played)
    run(played)
    pictures["ended"] = picture_of(played)
    middle = np.s_[120:330, 130:560]
    for other, picture in pictures.items():
        assert np.array_equal(picture[middle], pictures[phase][middle]) == (other == phase)


def test_the_head_of_the_picture_tells_success_by_its_colour() -> None:
    played = whole(handle=True)
    colour = palette.SUCCESS if played.cut.cutting.success else palette.FAILURE
    assert picture_of(played)[2, 2].tolist() == list(colour)


def test_the_same_advice_is_given_once() -> None:
    played = whole(handle=True)
    lurches = [
        TechniqueFault(kind="lurch", time=t, position=0.05, says=f"lurched at {t:.0f} s", try_next="lean more")
        for t in (1.0, 2.0)
    ]
    short = TechniqueFault(kind="short", time=3.0, position=0.07, says="ended short", try_next="lead farther")
    lines = fault_lines(dataclasses.replace(played.card, faults=(*lurches, short)))
    assert [words for words, _, _ in lines] == [
        "Ended short",
        "Next time: lead farther.",
        "Lurched at 1 s; lurched at 2 s",
        "Next time: lean more.",
    ]
    assert [words for words, _, _ in fault_lines(dataclasses.replace(played.card, faults=()))] == [
        "No fault was found."
    ]


def test_the_colour_of_the_force_goes_from_steel_over_amber_to_vermilion() -> None:
    quantities = {"blade": 0.05, "force_allowed_per_depth": 200.0, "force_limit_per_depth": 500.0}
    quantities |= {"limited_at": lambda along: 0.02}
    assert tint(0.0, quantities) == palette.STEEL
    assert tint(4.0, quantities) == palette.COST_COLOUR
    assert tint(-12.0, quantities) == palette.LIMIT


def test_the_same_moment_gives_the_same_picture_whatever_was_drawn_before() -> None:
    played = session(handle=True)
    often = PlayPicture()
    played.begin()
    clock = run(played, until="cutting")
    for k in range(100):
        played.advance(clock + k * FRAME)
        last = often.draw(played.sight()).picture()
    once = picture_of(played)
    # The line of the force is drawn part by part in one, at once in the other: its smoothing differs.
    assert np.mean(np.any(last != once, axis=-1)) < 0.002


def test_a_cut_that_left_no_record_has_an_end_card_too() -> None:
    played = Session(ScriptedDevice(lambda time: HandMotion(0.0, 1.57)), SessionPlan(countdown=0.0), handle=True)
    played.begin()
    played.advance(0.0)
    played.advance(0.02)
    played.close()
    assert played.phase == "ended"
    picture_of(played)


def test_a_scripted_cut_that_is_seen_is_shown_at_its_own_pace_and_then_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    paces = []

    class Hurried(Window):
        def __init__(self, width: int, height: int, fps: float) -> None:
            paces.append(fps)
            super().__init__(width, height, 0.0)

    monkeypatch.setattr(play_window, "is_seen", lambda: True)
    drawn = Canvas(LAYOUT.width, LAYOUT.height, palette.PAPER)
    monkeypatch.setattr(PlayPicture, "draw", lambda self, sight: drawn)
    monkeypatch.setattr(play_window, "CARD_SECONDS", 0.5)
    monkeypatch.setattr(play_window, "Window", Hurried)
    plan = SessionPlan(specimen_class="uniform", target_length=TARGET, seed=6, countdown=0.0, cuts=2)
    played = Session(MouseDevice(), plan, folder=tmp_path, operator="P07")
    phases: list[str] = []
    played.after_advance = lambda: phases.append(played.phase)
    PlayWindow(played, scripted=True).run()
    assert paces == [play_window.FPS]
    assert phases.count("ended") == pytest.approx(2 * 0.5 * play_window.FPS, abs=4)


# The command


def test_the_command_plays_a_script_records_it_and_saves_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    out, picture, tissue = tmp_path / "cuts", tmp_path / "end.png", tmp_path / "softer.json"
    tissue.write_text(dataclasses.replace(measured_liver(), name="softer", fracture_resistance=120.0).to_json())
    cuts = "--scripted --cuts 2 --seed 6 --operator P07 --specimen-class uniform --practice --target-length 50mm"
    options = [*cuts.split(), "--tissue", str(tissue)]
    assert cli.main(["play", *options, "--out", str(out), "--picture", str(picture)]) == 0
    traces = [load_one(path) for path in sorted(out.iterdir())]
    assert [trace.metadata["specimen_episode"] for trace in traces] == [0, 1]
    assert all(trace.metadata["practice"] for trace in traces)
    assert traces[1].metadata["specimen"] == "uniform of softer, seed 6, number 1"
    assert all(trace.metadata["success"] for trace in traces)
    assert pygame.image.load(str(picture)).get_size() == (LAYOUT.width, LAYOUT.height)
    said = capsys.readouterr().out
    assert "of 100" in said
    assert str(out) in said


def test_without_the_extra_the_command_names_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cutenv.commands.play.find_spec", lambda name: None)
    assert cli.main(["play"]) == 1
    assert "pip install 'cutenv[play]'" in capsys.readouterr().err
