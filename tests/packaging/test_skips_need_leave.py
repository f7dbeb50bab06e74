"""A skip passes only where a file lists it, also when the tests run in several processes."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"
SKIPPING = """
import pytest

@pytest.mark.parametrize("n", [1, 2])
def test_of_a_screen(n):
    pytest.skip("no screen")

def test_that_runs():
    pass
"""


def run_pytest(folder: Path, leave: str, *options: str) -> subprocess.CompletedProcess[str]:
    shutil.copy(CONFTEST, folder)
    (folder / "test_some.py").write_text(SKIPPING)
    (folder / "allowed.txt").write_text(leave)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-rN"]
    return subprocess.run(
        [*command, "--allowed-skips", "allowed.txt", *options], cwd=folder, capture_output=True, text=True
    )


@pytest.mark.parametrize("options", [(), ("-n", "1")], ids=["one process", "workers"])
def test_an_unlisted_skip_fails_and_is_named(tmp_path: Path, options: tuple[str, ...]) -> None:
    ran = run_pytest(tmp_path, "# nothing is listed\n", *options)
    assert ran.returncode == 1
    assert "SKIPPED WITHOUT LEAVE test_some.py::test_of_a_screen[2]" in ran.stdout


@pytest.mark.parametrize("name", ["test_some.py", "test_some.py::test_of_a_screen"])
def test_a_listed_skip_passes(tmp_path: Path, name: str) -> None:
    ran = run_pytest(tmp_path, f"{name}  # no screen")
    assert ran.returncode == 0, ran.stdout
    assert ran.stdout.splitlines()[-1].strip("= ").startswith("1 passed, 2 skipped")


def test_the_name_of_another_test_gives_no_leave(tmp_path: Path) -> None:
    assert run_pytest(tmp_path, "test_some.py::test_of_a\ntest_so\n").returncode == 1
