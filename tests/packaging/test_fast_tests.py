"""``start.py test --fast`` finds the tests of a change by what they import and name, within two minutes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from scripts import fast_tests

FILES = {
    "cutenv/__init__.py": "",
    "cutenv/cut/__init__.py": "from cutenv.cut.law import force\n",
    "cutenv/cut/law.py": "def force(): ...\n",
    "cutenv/cut/blade.py": "",
    "cutenv/rig/plant.py": "def go():\n    from cutenv.cut.law import force\n",
    "cutenv/commands/law.py": "",
    "scripts/print_law.py": "import cutenv.cut.law\n",
    "docs/page.md": "",
    "tests/cut/test_direct.py": "from cutenv.cut import force\n",
    "tests/cut/test_other.py": "import cutenv.cut.blade\n",
    "tests/rig/conftest.py": "import cutenv.rig.plant\n",
    "tests/rig/test_by_fixture.py": "",
    "tests/rig/test_by_program.py": 'PROGRAM = "scripts/print_law.py"\n',
    "tests/play/ready.py": "import cutenv.cut.law\n",
    "tests/play/test_by_helper.py": "import ready\n",
    "tests/play/test_nothing.py": "import math\n",
    "tests/play/test_law_command.py": "",
    "tests/play/test_pages.py": 'FOLDER = "docs"\n',
}


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Lay out a package with its tests, all committed on main."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(fast_tests, "ROOT", tmp_path)
    monkeypatch.setattr(fast_tests, "TESTS", tmp_path / "tests")
    for remembered in (fast_tests.modules, fast_tests.imported_names, fast_tests.imports, fast_tests.used):
        remembered.cache_clear()
    git = ["git", "-C", str(tmp_path), "-c", "user.name=A", "-c", "user.email=a@example.org"]
    for command in (["init", "-q", "-b", "main"], ["add", "."], ["commit", "-qm", "Begin"]):
        subprocess.run([*git, *command], check=True)
    return tmp_path


def found(project: Path, change: str) -> list[str]:
    return [path.stem.removeprefix("test_") for path in fast_tests.concerned([project / change])]


def test_what_imports_a_module_comes_first_and_then_what_imports_its_importers(project: Path) -> None:
    near = found(project, "cutenv/cut/law.py")
    assert near == ["direct", "by_helper", "by_fixture", "by_program", "other", "law_command"]


def test_a_changed_test_comes_first(project: Path) -> None:
    assert found(project, "tests/cut/test_other.py")[0] == "other"


def test_a_name_that_a_package_passes_on_is_its_modules(project: Path) -> None:
    test = project / "tests/cut/test_direct.py"
    assert fast_tests.nearness(test, project / "cutenv/cut/law.py") == (1, False)
    assert fast_tests.nearness(test, project / "cutenv/cut/blade.py") == (3, False)


def test_a_command_and_a_page_are_found_by_name(project: Path) -> None:
    assert found(project, "cutenv/commands/law.py") == ["law_command"]
    assert found(project, "docs/page.md") == ["pages"]


def test_what_is_uncommitted_or_new_or_differs_from_main_has_changed(project: Path) -> None:
    assert fast_tests.changed(None) == []
    (project / "cutenv/cut/law.py").write_text("def force(): return 1\n")
    (project / "cutenv/new.py").touch()
    expected = [project / "cutenv/cut/law.py", project / "cutenv/new.py"]
    assert fast_tests.changed(None) == expected
    git = ["git", "-C", str(project), "-c", "user.name=A", "-c", "user.email=a@example.org"]
    for command in (["checkout", "-qb", "branch"], ["add", "."], ["commit", "-qm", "Change"]):
        subprocess.run([*git, *command], check=True)
    assert fast_tests.changed(None) == expected
    assert fast_tests.changed("HEAD") == []


def test_files_are_taken_until_their_seconds_fill_the_time(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tests = [project / f"tests/{name}.py" for name in ("one", "two", "three")]
    seconds = dict(zip(tests, (60.0, 70.0, 50.0), strict=True))
    monkeypatch.setattr(fast_tests, "seconds_of", seconds.get)
    assert fast_tests.chosen(tests, budget=120.0) == [tests[0], tests[2]]


def test_a_file_takes_what_its_tests_took_but_for_those_that_are_left_out(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = {"tests/cut/test_direct.py::test_a": (1.0, 4.0), "tests/cut/test_direct.py::test_b": (60.0, 60.0)}
    monkeypatch.setattr(fast_tests.suite_times, "read", lambda: times)
    assert fast_tests.seconds_of(project / "tests/cut/test_direct.py") == pytest.approx(fast_tests.START + 4.0, abs=0.2)


def test_lint_runs_too_and_the_last_line_says_what_was_left_out(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    called: list[list[str]] = []
    monkeypatch.setattr(fast_tests.subprocess, "call", lambda command, cwd: called.append(command) or 1)
    monkeypatch.setattr(fast_tests, "changed", lambda since: [project / "cutenv/cut/law.py"])
    monkeypatch.setattr(fast_tests, "BUDGET", 3.0)
    assert fast_tests.main(["-x"]) == 1
    (command,) = called
    assert command[-1] == "-x"
    assert set(fast_tests.LINT) < set(command)
    assert "tests/cut/test_direct.py" in command
    last = capsys.readouterr().out.splitlines()[-1]
    assert "left out 3 test files" in last
    assert last.endswith("everything: python3 scripts/start.py test")


def test_the_lint_that_it_runs_is_there() -> None:
    text = (Path(__file__).parent / "test_habits.py").read_text()
    assert all(f"def {test.partition('::')[2]}(" in text for test in fast_tests.LINT)
