"""Every generated block is on its page, once, and is what its script prints."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from cutenv.recording import UNITS, load
from scripts import update_docs

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "scripts" / "update_docs.py"
RECORDS = (ROOT / "docs" / "reference" / "files" / "records.md").read_text(encoding="utf-8")

CHEAP = (
    "parameters", "benchmark", "results", "errata", "metrics", "weights", "ends", "tissue-file", "rig-file",
    "slow-rig", "class-attacks", "test-times",
)  # fmt: skip
"""Blocks that are printed from what is in the repository, in a second."""


def blocks_of(text: str) -> list[str]:
    """Return the names of the blocks that begin in a text."""
    return re.findall(r"^<!-- ([\w-]+) -->$", text, re.MULTILINE)


def test_every_block_is_on_its_page_once() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    found = Counter(
        (name, page.relative_to(ROOT).as_posix())
        for page in pages
        for name in blocks_of(page.read_text(encoding="utf-8"))
        if name in update_docs.PAGES
    )
    assert found == Counter(update_docs.PAGES.items())


@pytest.mark.parametrize("name", update_docs.PAGES)
def test_no_block_is_empty(name: str) -> None:
    text = (ROOT / update_docs.PAGES[name]).read_text(encoding="utf-8")
    assert len(update_docs.block_of(text, name).strip().splitlines()) >= 5


def test_a_block_that_is_there_twice_is_noticed() -> None:
    block = "<!-- speed -->\n<!-- /speed -->\n"
    with pytest.raises(SystemExit, match="speed 2 times"):
        update_docs.block_of(2 * block, "speed")


def test_the_cheap_blocks_are_what_the_script_prints() -> None:
    done = subprocess.run([sys.executable, PROGRAM, "--check", *CHEAP], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("interval", "beginning"),
    [
        ("0.073 [0.027, 0.120]", "PPO beats the best script by 0.07 of return"),
        ("-0.073 [-0.120, -0.027]", "PPO is worse than the best script by 0.07 of return"),
        ("0.010 [-0.027, 0.047]", "PPO against the best script is undecided"),
    ],
)
def test_the_sentence_about_the_agent_follows_the_interval(interval: str, beginning: str) -> None:
    sentence = update_docs.verdict([{"seed": "1", "agent minus script: return": interval}])
    assert sentence.startswith(beginning)
    assert "one training seed" in sentence


def test_the_record_that_is_shown_loads_as_the_text_above_it_says(tmp_path: Path) -> None:
    (shown,) = re.findall(r"```csv\n(.*?)```", RECORDS, re.DOTALL)
    (tmp_path / "rig.csv").write_text(shown)
    first, second = load(tmp_path / "rig.csv")
    assert list(first.force) == [0.05, 0.31]
    assert (first.metadata["cut"], second.metadata["cut"]) == (3, 4)
    assert first.speed == pytest.approx([0.0254, 0.0254])
    assert second.angle == pytest.approx([math.pi / 4] * 2)
    (tmp_path / "rig.csv").write_text(shown.partition("\n")[2])  # without the metadata
    assert load(tmp_path / "rig.csv", force="-x")[1].force == pytest.approx(second.force)


def test_the_units_that_are_listed_are_those_that_are_understood() -> None:
    listed = dict(re.findall(r"^\| (`(?:time|force|position|speed|angle)`.*?) \| (.*) \|$", RECORDS, re.MULTILINE))
    found = {re.findall(r"`(\w+)`", fields)[0]: re.findall(r"`(\w+)`", units) for fields, units in listed.items()}
    found["depth"] = found["position"]
    assert found == {field: [unit for unit in units if "/" not in unit] for field, units in UNITS.items()}
