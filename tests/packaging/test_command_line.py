"""The command ``cutenv``: it passes arguments on, and a missing extra is answered with the pip command."""

from __future__ import annotations

import subprocess
import sys
import types

import pytest

import cutenv
from cutenv import cli


def install(monkeypatch: pytest.MonkeyPatch, main: object) -> None:
    """Stand in for the module behind ``cutenv bench``."""
    module = types.ModuleType("cutenv.bench")
    module.main = main  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cutenv.bench", module)


def test_version_is_that_of_the_package() -> None:
    command = [sys.executable, "-m", "cutenv", "--version"]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ran.stdout == f"cutenv {cutenv.__version__}\n"


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--help"])
    shown = capsys.readouterr().out
    assert all(name in shown and command.summary in shown for name, command in cli.COMMANDS.items())


def test_an_unknown_command_is_refused_and_the_known_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["behcn"])
    assert "bench" in capsys.readouterr().err


@pytest.mark.parametrize(("returned", "status"), [(None, 0), (0, 0), (3, 3)])
def test_arguments_are_passed_on_and_the_status_comes_back(
    monkeypatch: pytest.MonkeyPatch, returned: int | None, status: int
) -> None:
    seen: list[list[str]] = []

    def main(argv: list[str]) -> int | None:
        seen.append(argv)
        return returned

    install(monkeypatch, main)
    assert cli.main(["bench", "--help", "--n", "3"]) == status
    assert seen == [["--help", "--n", "3"]]


def test_a_missing_extra_is_answered_with_the_pip_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)

    def main(argv: list[str]) -> None:
        import stable_baselines3.common  # noqa: F401

    install(monkeypatch, main)
    assert cli.main(["bench"]) == 1
    assert "pip install 'cutenv[rl]'" in capsys.readouterr().err


def test_a_missing_module_of_no_extra_is_not_explained_away(monkeypatch: pytest.MonkeyPatch) -> None:
    def main(argv: list[str]) -> None:
        raise ModuleNotFoundError("No module named 'cutenv.gone'", name="cutenv.gone")

    install(monkeypatch, main)
    with pytest.raises(ModuleNotFoundError, match="gone"):
        cli.main(["bench"])
