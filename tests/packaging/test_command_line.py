"""The command ``cutenv``: it passes arguments on, and a missing extra is answered with the pip command."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest

import cutenv
from cutenv.commands import cli

ROOT = Path(__file__).parents[2]


def install(monkeypatch: pytest.MonkeyPatch, main: object) -> None:
    """Stand in for the module behind ``cutenv demo``."""
    module = types.ModuleType("cutenv.commands.demo")
    module.main = main  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cutenv.commands.demo", module)


def test_version_is_that_of_the_package() -> None:
    command = [sys.executable, "-m", "cutenv", "--version"]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    assert re.fullmatch(rf"cutenv {re.escape(cutenv.__version__)}(\+[0-9a-f]{{12}}(\.changed)?)?\n", ran.stdout)


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--help"])
    shown = capsys.readouterr().out
    assert all(name in shown and command.summary in shown for name, command in cli.COMMANDS.items())


@pytest.mark.parametrize(("given", "nearest"), [(["evalute"], "evaluate"), (["rig", "Runn"], "run")])
def test_an_unknown_command_is_refused_and_the_nearest_is_named(
    capsys: pytest.CaptureFixture[str], given: list[str], nearest: str
) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(given)
    assert f"Did you mean {nearest!r}?" in capsys.readouterr().err


@pytest.mark.parametrize(("returned", "status"), [(None, 0), (0, 0), (3, 3)])
def test_arguments_are_passed_on_and_the_status_comes_back(
    monkeypatch: pytest.MonkeyPatch, returned: int | None, status: int
) -> None:
    seen: list[list[str]] = []

    def main(argv: list[str]) -> int | None:
        seen.append(argv)
        return returned

    install(monkeypatch, main)
    assert cli.main(["demo", "--help", "--n", "3"]) == status
    assert seen == [["--help", "--n", "3"]]


def test_a_missing_extra_is_answered_with_the_pip_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)

    def main(argv: list[str]) -> None:
        import stable_baselines3.common  # noqa: F401

    install(monkeypatch, main)
    assert cli.main(["demo"]) == 1
    assert "pip install 'cutenv[rl]'" in capsys.readouterr().err


def test_a_missing_module_of_no_extra_is_not_explained_away(monkeypatch: pytest.MonkeyPatch) -> None:
    def main(argv: list[str]) -> None:
        raise ModuleNotFoundError("No module named 'cutenv.gone'", name="cutenv.gone")

    install(monkeypatch, main)
    with pytest.raises(ModuleNotFoundError, match="gone"):
        cli.main(["demo"])


def of_stand_in(body: str) -> list[str]:
    """The program ``cutenv demo`` with this body."""
    code = (
        "import sys, types; import cutenv.commands.cli as cli; module = types.ModuleType('cutenv.commands.demo')\n"
        f"def main(argv):\n    {body}\n"
        "module.main = main; sys.modules['cutenv.commands.demo'] = module; raise SystemExit(cli.main(['demo']))"
    )
    return [sys.executable, "-c", code]


@pytest.mark.skipif(sys.platform == "win32", reason="there a pipe without a reader raises another error")
@pytest.mark.parametrize(
    "body", ["print('a line')", "for _ in range(100_000): print('a line')", "print(1); sys.exit(0)"]
)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_nobody_reads_any_more_ends_the_command_quietly(body: str, unbuffered: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        ran = subprocess.run(
            of_stand_in(body), stdout=writing, stderr=subprocess.PIPE, text=True, check=False,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    finally:
        os.close(writing)
    assert (ran.returncode, ran.stderr) == (cli.READER_GONE, "")


def test_another_broken_pipe_is_not_hidden() -> None:
    program = of_stand_in("raise BrokenPipeError('the worker has gone')")
    ran = subprocess.run(program, capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert "the worker has gone" in ran.stderr


@pytest.mark.parametrize(
    ("name", "given", "module", "extra"),
    [("train", [], "torch", "rl"), ("datasets", ["--dataset", "a-v0", "--policy", "nothing"], "minari", "data")],
)
def test_a_missing_extra_of_a_command_is_one_line(
    name: str, given: list[str], module: str, extra: str, tmp_path: Path
) -> None:
    block = f"import sys; sys.modules[{module!r}] = None; "
    code = block + f"import cutenv.commands.cli as cli; raise SystemExit(cli.main({[name, *given]!r}))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 1
    assert ran.stderr == f"cutenv {name}: {module} is not installed: pip install 'cutenv[{extra}]'\n"
    assert list(tmp_path.iterdir()) == []
