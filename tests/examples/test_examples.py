"""Every example runs, asserts a number that it prints, and has its page.

They run in this process: imports and compiled code, most of an example's time, are then paid for once.
"""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TIMED = ("thousand_at_once", "train_sb3")
"""Examples that print what depends on the machine: a rate, or what PyTorch has learned."""
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_and_prints_what_its_page_shows(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))  # given back afterwards, whatever an example sets
    try:
        runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    except SystemExit as ended:  # an extra is missing, and the example names the cure
        if not re.fullmatch(r"\w+ is not installed: pip install 'cutenv\[\w+\]'", str(ended.code)):
            raise
        pytest.skip(str(ended.code))
    printed = capsys.readouterr().out
    assert re.search(r"\d", printed)
    shown = re.search(r"```text\n(.*?)```", (ROOT / "docs" / "examples" / f"{name}.md").read_text("utf-8"), re.DOTALL)
    assert shown is None if name in TIMED else shown[1].strip() == printed.strip()


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_short_asserts_something_and_has_its_page(name):
    code = (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8")
    assert len(code.splitlines()) <= 61
    assert re.search(r"^ *assert ", code, re.MULTILINE)
    assert f'--8<-- "examples/{name}.py"' in (ROOT / "docs" / "examples" / f"{name}.md").read_text(encoding="utf-8")
    assert f"({name}.md)" in (ROOT / "docs" / "examples" / "index.md").read_text(encoding="utf-8")


def test_there_are_examples():
    assert len(EXAMPLES) >= 8


def test_the_notebook_prints_what_its_page_shows():
    from scripts.documentation import notebook_page

    page, figures = notebook_page.run(json.loads(notebook_page.NOTEBOOK.read_text(encoding="utf-8")))
    assert page == notebook_page.PAGE.read_text(encoding="utf-8")
    assert len(figures) == 1
    for beginning in ("finished", "lag: ", "estimate off by", "weight of jumps", "fast then slow minus upright"):
        assert f"```text\n{beginning}" in page
