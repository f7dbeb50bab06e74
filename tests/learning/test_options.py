"""A dataclass of arguments is a command line, with its defaults, choices and meanings."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from options import option, parse


@dataclass(frozen=True, kw_only=True)
class Arguments:
    name: str = option("", "of the run")
    cuts: int = option(100, "that are made")
    noise_mm: float = option(0.5, "of the depth")
    tissue: str = option("liver", "to cut", ("liver", "uniform"))
    files: tuple[str, ...] = option((), "to read")
    quiet: bool = option(False, "say nothing")


def parsed(monkeypatch: pytest.MonkeyPatch, *given: str) -> Arguments:
    monkeypatch.setattr("sys.argv", ["program", *given])
    return parse(Arguments, "About it.")


def test_without_options_the_defaults_hold(monkeypatch):
    assert parsed(monkeypatch) == Arguments()


def test_options_arrive_with_their_kinds(monkeypatch):
    given = ["--name", "7", "--cuts", "7", "--noise-mm", "7", "--tissue", "uniform", "--files", "a", "b", "--quiet"]
    expected = Arguments(name="7", cuts=7, noise_mm=7.0, tissue="uniform", files=("a", "b"), quiet=True)
    assert parsed(monkeypatch, *given) == expected
    assert isinstance(parsed(monkeypatch, *given).noise_mm, float)


@pytest.mark.parametrize("given", [("--cuts", "x"), ("--tissue", "bone"), ("--cust", "3")])
def test_nonsense_is_refused(monkeypatch, given):
    with pytest.raises(SystemExit, match="2"):
        parsed(monkeypatch, *given)


def test_help_tells_meanings_and_defaults(monkeypatch, capsys):
    with pytest.raises(SystemExit, match="0"):
        parsed(monkeypatch, "--help")
    shown = capsys.readouterr().out
    assert "that are made (default 100)" in shown
    assert "About it." in shown
