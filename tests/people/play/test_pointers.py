"""Mouse, pen and fingers lead the hand, whatever the size of the window; without a display it is refused at once."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from played_window import begin, post, press, pygame, show

from cutenv.display.viewer import palette
from cutenv.display.viewer.window import Window
from cutenv.people.play.devices import LEAD
from cutenv.people.play.hand_model import MAX_HAND_SPEED
from cutenv.people.play.picture import LAYOUT
from cutenv.people.play.play_window import PlayWindow


def test_a_flick_of_the_mouse_does_not_run_the_cut_away(window: PlayWindow) -> None:
    begin(window)
    post(pygame.MOUSEMOTION, rel=(480, 0), pos=(0, 0), buttons=(0, 0, 0))
    show(window, 12)
    sight = window.session.sight()
    assert sight.hand == pytest.approx(LEAD, abs=3e-4)
    show(window, 30)
    assert window.session.sight().hand == pytest.approx(LEAD, abs=1e-5)
    post(pygame.MOUSEMOTION, rel=(-480, 0), pos=(0, 0), buttons=(0, 0, 0))
    show(window, 30)
    assert window.session.sight().hand == pytest.approx(0.0, abs=1e-5)


def test_a_mouse_leads_far_enough_for_the_hands_full_speed(window: PlayWindow) -> None:
    begin(window)
    for _ in range(60):
        post(pygame.MOUSEMOTION, rel=(20, 0), pos=(0, 0), buttons=(0, 0, 0))
        show(window)
    assert float(window.session.cut.plant.states["hand_speed"][0]) == pytest.approx(MAX_HAND_SPEED, rel=0.01)


def test_a_free_pointer_leads_by_where_it_is_and_is_not_caught(window: PlayWindow) -> None:
    press(pygame.K_m)
    begin(window)
    assert not pygame.event.get_grab()
    for x in range(300, 340):  # where it comes in means nothing
        post(pygame.MOUSEMOTION, rel=(0, 0), pos=(x, 9), buttons=(0, 0, 0))
        show(window)
    show(window, 30)
    assert window.session.sight().hand == pytest.approx(39 / LAYOUT.scale, abs=1e-4)
    press(pygame.K_m)
    show(window)
    assert pygame.event.get_grab()


def test_one_finger_leads_the_hand_and_another_leans_the_blade(window: PlayWindow) -> None:
    begin(window)
    width, height = window._window.size

    def touch(kind: int, finger: int, x: float, y: float) -> None:
        post(kind, finger_id=finger, touch_id=1, x=x / width, y=y / height, dx=0.0, dy=0.0)

    touch(pygame.FINGERDOWN, 7, 500.0, 300.0)
    touch(pygame.FINGERDOWN, 8, 100.0, 300.0)
    for k in range(1, 41):
        touch(pygame.FINGERMOTION, 7, 500.0 + k, 300.0)
        touch(pygame.FINGERMOTION, 8, 100.0 - k, 300.0 + 1.8 * k)
        post(pygame.MOUSEMOTION, rel=(1, 0), pos=(500 + k, 300), buttons=(1, 0, 0), touch=True)
        show(window)
    # Lifted and put down elsewhere, a finger begins anew.
    touch(pygame.FINGERUP, 7, 540.0, 300.0)
    touch(pygame.FINGERDOWN, 9, 20.0, 20.0)
    show(window, 30)
    sight = window.session.sight()
    assert sight.hand == pytest.approx(40 / LAYOUT.scale, abs=1e-4)
    assert np.degrees(sight.moment.angle) == pytest.approx(60.0)


def test_the_picture_fills_the_window_and_keeps_its_proportions(window: PlayWindow) -> None:
    shown = window._window
    wide = (1440, 600)
    pygame.display.set_mode(wide, pygame.RESIZABLE)
    show(window)
    screen = pygame.display.get_surface()
    margin = (wide[0] - 800) // 2  # 960 x 720 fits as 800 x 600
    assert shown.size == wide
    right = wide[0] - margin
    colours = [tuple(screen.get_at((x, 5)))[:3] for x in (margin - 2, margin + 2, right - 3, right + 2)]
    assert colours[0] == colours[3] == palette.PAPER
    assert colours[1] == colours[2] == pytest.approx(palette.HEADER_COLOUR, abs=4)  # smoothed
    assert shown.in_picture(margin, 0.0) == (0.0, 0.0)
    assert shown.in_picture(right, 600.0) == pytest.approx((LAYOUT.width, LAYOUT.height))


def test_f11_fills_the_screen_and_gives_it_back(window: PlayWindow) -> None:
    press(pygame.K_F11)
    show(window)
    assert window._window.size == pygame.display.get_desktop_sizes()[0]
    press(pygame.K_F11)
    show(window)
    assert window._window.size == (LAYOUT.width, LAYOUT.height)


@pytest.mark.parametrize(
    ("screen", "size"), [((3840, 2160), (1920, 1440)), ((1920, 1080), (960, 720)), ((1280, 600), (800, 600))]
)
def test_a_window_opens_at_a_size_that_the_screen_has_room_for(
    screen: tuple[int, int], size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(pygame.display, "get_desktop_sizes", lambda: [screen])
    opened = Window(LAYOUT.width, LAYOUT.height, 0.0)
    assert opened.size == size
    opened.close()


DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there always is a display")


@pytest.mark.parametrize("driver", [None, "x11"])
def test_play_without_a_display_ends_at_once_with_the_cure(driver: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in DISPLAYS}
    environment |= {} if driver is None else {"SDL_VIDEODRIVER": driver}
    command = [sys.executable, "-m", "cutenv", "play"]
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=30, check=False)
    assert ran.returncode == 2, ran.stderr
    line = ran.stderr.strip().splitlines()[-1]  # SDL may have written above it
    assert "Traceback" not in ran.stderr
    assert line.startswith("cutenv play: no window can be opened: ")
    assert "SDL_VIDEODRIVER=dummy" in line
