"""What the tests take is measured, kept by folder and by test, and tests can be left out by it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scripts import suite_times

ROOT = Path(__file__).parents[2]
BUSY = """
import subprocess, sys, time

WORK = "import time\\nwhile time.process_time() < 0.3: pass"

def test_that_starts_a_program():
    subprocess.run([sys.executable, "-c", WORK], check=True)

def test_that_waits():
    time.sleep(0.1)
"""
TEST = "tests/some/test_busy.py::test"
CASES = {
    "tests/rig/test_a.py::test_one[x]": (2.0, 2.5),
    "tests/rig/test_a.py::test_one[y]": (1.0, 4.0),
    "tests/rig/test_b.py::test_waits": (0.1, 1.5),
    "tests/play/test_c.py::test_short[a[0]]": (0.5, 0.5),
}


def run_pytest(folder: Path, *options: str) -> str:
    """Run the tests of a folder with this suite's configuration, and return what is printed."""
    here = folder / "tests" / "some"
    here.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "tests" / "conftest.py", folder / "tests")
    (here / "test_busy.py").write_text(BUSY)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", f"--rootdir={folder}", *options]
    scripts = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True, env=scripts).stdout


@pytest.mark.parametrize("options", [(), ("-n", "1")], ids=["one process", "workers"])
def test_a_test_takes_what_its_programs_take(tmp_path: Path, options: tuple[str, ...]) -> None:
    printed = run_pytest(tmp_path, "--times", "times.csv", *options)
    processor, wall = suite_times.read(tmp_path / "times.csv")["tests/some"]
    assert 0.3 <= processor < 3.0
    assert wall >= 0.4
    assert "| `tests/some` |" in printed


def test_cases_are_summed_and_short_tests_are_in_their_folder_alone() -> None:
    rows = suite_times.summed(CASES)
    assert rows == {
        "tests/rig": pytest.approx((3.1, 8.0)),
        "tests/play": (0.5, 0.5),
        "tests/rig/test_a.py::test_one": (3.0, 6.5),
        "tests/rig/test_b.py::test_waits": (0.1, 1.5),
    }


def test_what_is_kept_is_read_again(tmp_path: Path) -> None:
    rows = suite_times.summed(CASES)
    suite_times.write(tmp_path / "times.csv", rows)
    assert suite_times.read(tmp_path / "times.csv") == {name: pytest.approx(both) for name, both in rows.items()}
    assert suite_times.read(tmp_path / "none.csv") == {}


def test_the_tables_begin_with_what_takes_most_and_sum_up_all() -> None:
    lines = suite_times.tables(suite_times.summed(CASES)).splitlines()
    assert lines[2:5] == ["| `tests/rig` | 3 | 8 |", "| `tests/play` | 0 | 0 |", "| `all` | 4 | 8 |"]
    assert lines[-2:] == ["| `rig/test_a.py::test_one` | 3 | 6 |", "| `rig/test_b.py::test_waits` | 0 | 2 |"]


def test_tests_that_took_longer_can_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "tests").mkdir()
    rows = {"tests/some": (3.0, 3.0), f"{TEST}_that_starts_a_program": (3.0, 3.0), f"{TEST}_that_wait": (9.0, 9.0)}
    suite_times.write(tmp_path / "tests" / "times.csv", rows)
    assert "1 passed, 1 deselected" in run_pytest(tmp_path, "--at-most=2.5")
    assert "2 passed" in run_pytest(tmp_path, "--at-most=3")


def test_no_test_begins_when_the_time_is_over(tmp_path: Path) -> None:
    printed = run_pytest(tmp_path, "--within=0")
    assert "2 skipped" in printed
    assert "left out: 2 tests that need more time; to run them: python3 scripts/start.py test" in printed
    assert "2 passed" in run_pytest(tmp_path, "--within=60")
