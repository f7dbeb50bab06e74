"""Promises of the safety page have tests, and the tests are those that the page lists."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

TESTS = Path(__file__).parents[1]
FOLDERS = ("drivers", "emulation", "rig")
PAGE = TESTS.parent / "docs" / "rig" / "safety.md"
_MARK = re.compile(r"pytest\.mark\.promise\('(S\d+)'\)")


def marked() -> dict[str, set[str]]:
    """Tests by the promise that they prove."""
    found = defaultdict(set)
    for file in (file for folder in FOLDERS for file in (TESTS / folder).glob("test_*.py")):
        for function in ast.parse(file.read_text(encoding="utf-8")).body:
            for mark in getattr(function, "decorator_list", ()):
                if (said := _MARK.fullmatch(ast.unparse(mark))) is not None:
                    found[said[1]].add(function.name)
    return dict(found)


def test_each_promise_has_its_tests_and_each_of_these_its_promise() -> None:
    page = PAGE.read_text(encoding="utf-8")
    promised = re.findall(r"^\*\*(S\d+) ", page, re.MULTILINE)
    assert promised == [f"S{number}" for number in range(1, len(promised) + 1)]
    listed = {
        number: set(re.findall(r"`(test_\w+)`", tests))
        for number, tests in re.findall(r"^\| (S\d+) \| (.*) \|$", page, re.MULTILINE)
    }
    assert list(listed) == promised
    assert listed == marked()
