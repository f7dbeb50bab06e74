"""The window under SDL's dummy driver."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from played import TARGET

from cutenv.people.play.devices import MouseDevice
from cutenv.people.play.play_session import Session, SessionPlan
from cutenv.people.play.play_window import PlayWindow


@pytest.fixture
def window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PlayWindow]:
    from played_window import FakeClock, pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    played = Session(
        MouseDevice(), SessionPlan(seed=6, target_length=TARGET, countdown=0.2), folder=tmp_path, handle=True
    )
    window = PlayWindow(played, clock=FakeClock())
    window._window._fps = 0.0  # the clock is a fake: there is nothing to wait for
    yield window
    window._window.close()
    played.close()
    pygame.display.quit()
