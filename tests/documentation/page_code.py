"""The code of a page: Python and commands in their order, each with what the page has installed by then."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = ["../README.md", *sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))]  # paths from docs/
CONTRIBUTORS = ("development/", "results/", "validation/", "reference/")
"""Beginnings of the pages whose commands are for a checkout that has everything."""
FENCE = re.compile(
    r"(?:<!-- (not run|not checked|after the commands): (\S.*?) -->\n)?^( *)```(\w*)\n(.*?)^\3```$",
    re.DOTALL | re.MULTILINE,
)
INSTALLS = re.compile(r"(?<!/)pipx? install ([^`\n&#]+)")
"""Not ``.venv-ray/bin/pip``, which installs elsewhere."""
SHOWN = re.compile(r"\n+(?:It prints `([^`\n]+)`|(?: *)```text\n(.*?)^ *```$)", re.DOTALL | re.MULTILINE)
WITH_A_VALUE = ("-c", "--index-url")  # options of pip that are followed by a value
FIRST = frozenset({"cutenv[view]"})
"""Requirements of the page Install, for a page that names no extra; one that does has those that it names alone."""


class Code(NamedTuple):
    """A block of code."""

    language: str
    text: str
    marked: str  # "not run", "not checked", "after the commands", or ""
    installed: frozenset[str]  # requirements that the page has named so far, FIRST if none
    prints: str  # what the page shows as printed, "" if nothing

    def commands(self) -> Iterator[list[str]]:
        """Every command as words, without what follows a pipe."""
        for line in self.text.replace("\\\n", " ").splitlines():
            if words := shlex.split(line, comments=True):
                yield words


def requirements(words: list[str]) -> Iterator[str]:
    """Yield the requirements among the words after ``pip install``; the checkout is ``cutenv``, too."""
    value_of = ""
    for word in words:
        if word.startswith("-") or value_of in WITH_A_VALUE:
            value_of = word
            continue
        value_of = ""
        yield re.sub(r"^(\.|/cutenv|.*\.whl)(?=\[|$)", "cutenv", word)


def code_of(page: str) -> list[Code]:
    """The blocks of a page, but for those that are an example's file."""
    text = (DOCS / page).read_text(encoding="utf-8")
    installs = [(found.end(), {*requirements(shlex.split(found[1]))}) for found in INSTALLS.finditer(text)]
    blocks = []
    for fence in FENCE.finditer(text):
        marked, _, indent, language, code = fence.groups()
        if "--8<--" in code:
            continue
        installed = frozenset().union(*(each for end, each in installs if end <= fence.end()))
        shown = SHOWN.match(text, fence.end())
        blocks.append(
            Code(
                language=language,
                text=re.sub(f"^{indent}", "", code, flags=re.MULTILINE),
                marked=marked or "",
                installed=installed if any(each.startswith("cutenv") for each in installed) else FIRST | installed,
                prints=(shown[1] or shown[2]) if shown else "",
            )
        )
    return blocks
