"""What the pages of the documentation show is what the code does."""

from __future__ import annotations

import contextlib
import io
import pkgutil
import re
import shlex
import types
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from cutenv import cli

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))
FENCE = re.compile(
    r"(?:<!-- (not run|not checked): (\S.*?) -->\n)?^( *)```(\w+)\n(.*?)^\3```$", re.DOTALL | re.MULTILINE
)


def blocks(page: str, language: str) -> Iterator[str]:
    """The code of a page in one language, but for what is marked with a reason, and what is an example's file."""
    for reason, _, indent, found, code in FENCE.findall((DOCS / page).read_text(encoding="utf-8")):
        if found == language and not reason and "--8<--" not in code:
            yield re.sub(f"^{indent}", "", code, flags=re.MULTILINE)


PYTHON = [(page, number) for page in PAGES for number, _ in enumerate(blocks(page, "python"))]


@pytest.mark.parametrize(("page", "number"), PYTHON)
def test_the_python_of_a_page_runs_as_it_stands(page, number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    code = list(blocks(page, "python"))[number]
    module = types.ModuleType("__main__")  # a name of its own for every block: none lives on another's imports
    exec(compile(code, f"{page}, block {number}", "exec"), module.__dict__)


def commands(page: str) -> Iterator[list[str]]:
    """Every command of a page, as words, without what follows a pipe."""
    for code in blocks(page, "bash"):
        for line in code.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if words:
                yield words


@cache
def help_of(*names: str) -> str:
    """What ``cutenv NAMES --help`` prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.raises(SystemExit) as ended:
        cli.main([*names, "--help"])
    assert ended.value.code == 0
    return printed.getvalue()


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_are_there_with_their_options(page):
    for words in commands(page):
        if words[0] == "cutenv" and not words[1].startswith("-"):
            listed = help_of(*(words[1:3] if words[1] == "rig" else words[1:2]))
            for option in (word.partition("=")[0] for word in words if word.startswith("--")):
                assert re.search(rf"{re.escape(option)}\b", listed), f"{' '.join(words)}: there is no {option}"
        for program in (word for word in words if word.endswith(".py")):
            assert (ROOT / program).is_file()


@pytest.mark.parametrize("page", PAGES)
def test_the_names_and_files_that_a_page_mentions_are_there(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    for name in re.findall(r"`(cutenv(?:\.\w+)+)`", text):
        assert pkgutil.resolve_name(name) is not None
    for path in re.findall(r"`((?:agents|assets|cutenv|docs|examples|scripts|tests)/[\w./-]*)`", text):
        assert re.search(r"-v\d+$", path) or (ROOT / path).exists(), path  # an environment or a data set


def test_a_page_that_shows_code_is_run():
    assert len(PYTHON) >= 20
    assert sum(words[0] == "cutenv" for page in PAGES for words in commands(page)) >= 50


def test_the_picture_of_the_architecture_shows_every_part_of_the_package_once(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import draw_architecture

    shown = [package for row in draw_architecture.ROWS for wing in row for package in wing.packages]
    there = {
        path.stem for path in (ROOT / "cutenv").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert sorted(shown) == sorted(there - {"__init__", "__main__"})
    assert draw_architecture.PICTURE.read_text(encoding="utf-8") == draw_architecture.picture()
