"""Devices of Force Dimension, by forcedimension_core and a stand-in for the vendor's library, in another process."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv.play.force_dimension import ForceDimensionLink

SCRIPT = Path(__file__).parents[2] / "scripts/emulated_force_dimension.py"
PLAYED = """
import json, sys, time
from cutenv.play.force_dimension import FORCE_DIMENSION_AXES, FORCE_DIMENSION_COUPLING, ForceDimensionLink
from cutenv.play.polled_handle import PolledHandle
device = PolledHandle(ForceDimensionLink(), FORCE_DIMENSION_COUPLING, FORCE_DIMENSION_AXES)
device.open()
start, pressed, free, held, lost = time.monotonic(), False, [], [], None
while (now := time.monotonic() - start) < 3.6 and lost is None:
    try:
        stylus = device.read()
        device.push(2.0 if now > 1.2 else 0.0)
    except OSError as error:
        lost = str(error)
    pressed |= "next" in stylus.buttons
    off = stylus.position - 0.0127 * (now - 0.3)
    (free if 0.9 < now < 1.15 else held if 1.5 < now < 1.75 else []).append(off)
    time.sleep(0.001)
stale = device.stale
device.close()
print(json.dumps([pressed, sum(free) / len(free), sum(held) / len(held), lost, stale]))
"""


def test_without_package_or_library_it_is_refused_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "forcedimension_core", None)
    with pytest.raises(OSError, match=r"forcedimension_core.* is not installed|libdrd of the Force Dimension SDK"):
        ForceDimensionLink().open()


@pytest.mark.skipif(
    importlib.util.find_spec("forcedimension_core") is None or sys.platform != "linux",
    reason="forcedimension_core wants a Python below 3.13",
)
def test_the_hand_is_followed_a_force_holds_it_back_and_a_silent_device_is_lost(tmp_path: Path) -> None:
    subprocess.run([sys.executable, SCRIPT, "--build", tmp_path], check=True, capture_output=True)
    command = [sys.executable, SCRIPT, "--port", "0", "--wait", "0.3", "--freeze", "1.8"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        try:
            there = os.environ | {"FDSDK": str(tmp_path), "DHD_PORT": emulator.stdout.readline().strip()}
            ran = subprocess.run([sys.executable, "-c", PLAYED], env=there, capture_output=True, text=True)
        finally:
            emulator.kill()
    assert ran.returncode == 0, ran.stderr
    pressed, free, held, lost, stale = json.loads(ran.stdout.splitlines()[-1])
    assert pressed
    assert held - free == pytest.approx(-2.0 / 400.0, abs=0.0015)
    assert "sent nothing sound for 1 s" in lost
    assert stale > 10
