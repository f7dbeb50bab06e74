"""Docstrings name their subject: none begins with Of, What, How, Where, Why, Whether or As."""

from __future__ import annotations

import ast
from pathlib import Path

import measure_codebase
import pytest

ROOT = Path(__file__).parents[2]


FOLDERS = ("cutenv", "agents", "scripts", "examples")


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_docstring_names_its_subject(folder: str) -> None:
    found, wrong = 0, []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for line, text in measure_codebase.docstrings(ast.parse(path.read_text(encoding="utf-8"))):
            found += 1
            if measure_codebase.FRAGMENT.match(text.strip()):
                wrong.append(f"{path.relative_to(ROOT)}:{line}: {text.strip().splitlines()[0]}")
    assert found > 0, f"no docstring found in {folder}: nothing was checked"
    assert not wrong, "begin with the noun or verb instead:\n" + "\n".join(wrong)
