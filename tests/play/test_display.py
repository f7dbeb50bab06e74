"""Without a display a window is refused at once, with the cure; nothing waits for keys that nobody can press."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("pygame", reason="playing is an extra: pip install 'cutenv[play]'")
pytest.importorskip("pymunk", reason="playing is an extra: pip install 'cutenv[play]'")

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
