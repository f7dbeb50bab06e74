"""A skip passes only with leave: a file names the test, or the test is marked to need a program that is not there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from scripts import test_programs

ROOT = Path(__file__).parents[2]
CONFTEST = Path(__file__).parents[1] / "conftest.py"
SKIPPING = """
import pytest

@pytest.mark.parametrize("n", [1, 2])
def test_of_a_screen(n):
    pytest.skip("no screen")

def test_that_runs():
    pass
"""
NEEDING = """
import pytest

@pytest.mark.needs("chromium")
def test_of_a_page():
    raise AssertionError("it must not run without a browser")
"""
WITH_BROWSERS = ("people/browser", "people/classroom", "documentation", "display/report", "display/viewer")


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


def test_a_listed_skip_passes(tmp_path: Path) -> None:
    ran = run_pytest(tmp_path, "test_some.py::test_of_a_screen  # no screen")
    assert ran.returncode == 0, ran.stdout
    assert ran.stdout.splitlines()[-1].strip("= ").startswith("1 passed, 2 skipped")


@pytest.mark.parametrize("leave", ["test_some.py", "test_some.py::test_of_a", "test_so"])
def test_the_name_of_a_whole_file_or_of_another_test_gives_no_leave(tmp_path: Path, leave: str) -> None:
    assert run_pytest(tmp_path, leave).returncode == 1


def test_the_list_names_tests_that_there_are_and_never_whole_files() -> None:
    for line in (ROOT / ".ci" / "allowed-skips.txt").read_text().splitlines():
        if not line.startswith("#"):
            file, _, test = line.partition("  #")[0].partition("::")
            assert f"def {test}(" in (ROOT / file).read_text(), line


def needing(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """A test that needs a browser, on a machine that has none."""
    shutil.copy(CONFTEST, folder)
    (folder / "test_page.py").write_text(NEEDING)
    (folder / "allowed.txt").touch()
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-rN", "--allowed-skips", "allowed.txt"]
    hidden = os.environ | {"PATH": str(folder), "PYTHONPATH": str(ROOT)}
    return subprocess.run([*command, *options], cwd=folder, capture_output=True, text=True, env=hidden)


def test_a_test_whose_program_is_not_there_is_left_out_and_says_how_to_get_it(tmp_path: Path) -> None:
    ran = needing(tmp_path)
    assert ran.returncode == 0, ran.stdout
    assert "left out: 1 tests that need chromium; to run them: apt-get install chromium" in ran.stdout


def test_what_was_installed_may_not_be_left_out(tmp_path: Path) -> None:
    ran = needing(tmp_path, "--installed=firefox,chromium")
    assert ran.returncode == 1
    assert "SKIPPED WITHOUT LEAVE test_page.py::test_of_a_page" in ran.stdout
    assert needing(tmp_path, "--installed=firefox").returncode == 0


def test_on_a_machine_without_any_browser_every_test_of_one_is_left_out_with_leave() -> None:
    """The marked tests of all folders that have pages, with every program hidden by the search path."""
    folders = [str(ROOT / "tests" / name) for name in WITH_BROWSERS]
    leave = ["--allowed-skips", str(ROOT / ".ci" / "allowed-skips.txt"), "-p", "no:cacheprovider"]
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rN", "-m", "needs", *leave, *folders],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | {"PATH": str(Path(sys.executable).parent)},
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-2000:]
    assert "WITHOUT LEAVE" not in ran.stdout
    assert "left out" in ran.stdout
    assert {"need chromium", "need firefox"} <= set(re.findall(r"need (?:chromium|firefox)", ran.stdout))


def test_an_installer_that_fails_leaves_its_group_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("apt-get", "npm"):
        program = tmp_path / name
        program.write_text("#!/bin/sh\nexit 100\n")
        program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(test_programs, "NPM", tmp_path / "npm-packages")
    before = test_programs.missing()
    assert {"chromium", "firefox"} <= set(before)
    test_programs.install()
    assert test_programs.missing() == before
