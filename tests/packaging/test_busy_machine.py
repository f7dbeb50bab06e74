"""A test in real time that fails while the machine stalls is run again; one that fails by itself is not."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"
FAILING = """
import ctypes
from pathlib import Path
import pytest

{mark}
def test_of_a_rig():
    ran = Path("ran.txt")
    ran.write_text(ran.read_text() + "x" if ran.exists() else "x")
    {stall}
    assert len(ran.read_text()) == 3, "a blade that did not stop"
"""
STALL = "ctypes.PyDLL(None).usleep(80_000)  # no other thread runs meanwhile"


MARK = "@pytest.mark.real_time"


def runs(folder: Path, room: str, stall: str, mark: str = "") -> tuple[int, str]:
    """How often a failing test of a folder ran, and what pytest printed."""
    text = CONFTEST.read_text(encoding="utf-8")
    patient = re.sub(r"^LATE = .*", "LATE = 0.04", text, flags=re.MULTILINE)  # however busy this machine is
    assert patient != text
    (folder / CONFTEST.name).write_text(patient, encoding="utf-8")
    (folder / room).mkdir()
    (folder / room / "test_some.py").write_text(FAILING.format(stall=stall, mark=mark))
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--reruns=5", "--only-rerun=the host stalled"]
    printed = subprocess.run(command, cwd=folder, capture_output=True, text=True).stdout
    return len((folder / "ran.txt").read_text()), printed


@pytest.mark.parametrize(("room", "mark"), [("rig", ""), ("play", MARK)])
def test_a_failure_while_the_machine_stalls_is_run_again(tmp_path: Path, room: str, mark: str) -> None:
    count, printed = runs(tmp_path, room, STALL, mark)
    assert count == 3
    assert re.search(r"1 passed,.* 2 rerun", printed)


@pytest.mark.parametrize(("room", "stall", "mark"), [("rig", "", ""), ("scoring", STALL, ""), ("play", "", MARK)])
def test_another_failure_is_told_at_once(tmp_path: Path, room: str, stall: str, mark: str) -> None:
    count, printed = runs(tmp_path, room, stall, mark)
    assert count == 1
    assert "a blade that did not stop" in printed
