"""A dataclass of arguments is a command line, with its defaults, choices and meanings."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from cutenv.learning.options import option, parse


@dataclass(frozen=True, kw_only=True)
class Arguments:
    name: str = option("", "of the run")
    cuts: int = option(100, "that are made")
    noise_mm: float = option(0.5, "of the depth")
    tissue: str = option("liver", "to cut", ("liver", "uniform"))
    files: tuple[str, ...] = option((), "to read")
    quiet: bool = option(False, "say nothing")


def parsed(*given: str) -> Arguments:
    return parse(Arguments, "About it.", given)


def test_without_options_the_defaults_hold():
    assert parsed() == Arguments()


def test_without_a_command_line_that_of_the_process_is_read(monkeypatch):
    monkeypatch.setattr("sys.argv", ["program", "--cuts", "7"])
    assert parse(Arguments, None).cuts == 7


def test_options_arrive_with_their_kinds():
    given = ["--name", "7", "--cuts", "7", "--noise-mm", "7", "--tissue", "uniform", "--files", "a", "b", "--quiet"]
    expected = Arguments(name="7", cuts=7, noise_mm=7.0, tissue="uniform", files=("a", "b"), quiet=True)
    assert parsed(*given) == expected
    assert isinstance(parsed(*given).noise_mm, float)


@pytest.mark.parametrize("given", [("--cuts", "x"), ("--tissue", "bone"), ("--cust", "3")])
def test_nonsense_is_refused(given):
    with pytest.raises(SystemExit, match="2"):
        parsed(*given)


def test_help_tells_meanings_and_defaults(capsys):
    with pytest.raises(SystemExit, match="0"):
        parsed("--help")
    shown = capsys.readouterr().out
    assert "that are made (default 100)" in shown
    assert "About it." in shown
