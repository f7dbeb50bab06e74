"""A window by a fake clock, and what a person does to it."""

from __future__ import annotations

from typing import Any

import pytest

from cutenv.people.play.play_window import PlayWindow

pygame = pytest.importorskip("pygame", reason='playing is an extra: pip install "cutenv[play]"')
pytest.importorskip("pymunk", reason='playing is an extra: pip install "cutenv[play]"')

FRAME = 1.0 / 60.0


class FakeClock:
    """Goes on by a picture at every question."""

    def __init__(self, frame: float = FRAME) -> None:
        self.now, self.frame = 0.0, frame

    def __call__(self) -> float:
        self.now += self.frame
        return self.now


def post(kind: int, **what: Any) -> None:
    pygame.event.post(pygame.event.Event(kind, **what))


def press(key: int) -> None:
    post(pygame.KEYDOWN, key=key)


def show(window: PlayWindow, pictures: int = 1) -> None:
    for _ in range(pictures):
        window.show_next()


def begin(window: PlayWindow) -> None:
    press(pygame.K_SPACE)
    show(window, 20)
    assert window.session.phase == "cutting"
