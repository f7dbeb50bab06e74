"""Every generated block is on its page, once, and is what its script prints."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from cutenv.records import UNITS, load
from scripts.checks import BLOCKS
from scripts.documentation.page_blocks import block_of
from scripts.documentation.training_blocks import verdict

ROOT = Path(__file__).parents[2]
RECORDS = (ROOT / "docs" / "reference" / "files" / "records.md").read_text(encoding="utf-8")

CHEAP = (  # blocks that are printed from what is in the repository, in a second
    "parameters", "benchmark", "results", "errata", "metrics", "weights", "ends", "tissue-file", "rig-file",
    "slow-rig", "class-attacks", "test-times",
)  # fmt: skip


def blocks_of(text: str) -> list[str]:
    """Return the names of the blocks that end in a text."""
    return re.findall(r"^<!-- /([\w-]+) -->$", text, re.MULTILINE)


def test_every_block_is_on_its_page_once() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    found = Counter(
        (name, page.relative_to(ROOT).as_posix())
        for page in pages
        for name in blocks_of(page.read_text(encoding="utf-8"))
    )
    assert found == Counter((name, check.page) for name, check in BLOCKS.items())


@pytest.mark.parametrize("name", BLOCKS)
def test_no_block_is_empty(name: str) -> None:
    assert len(block_of(ROOT / BLOCKS[name].page, name).strip().splitlines()) >= 5


def test_a_block_that_is_there_twice_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(2 * "<!-- speed -->\n<!-- /speed -->\n")
    with pytest.raises(SystemExit, match="speed 2 times"):
        block_of(tmp_path / "page.md", "speed")


def test_the_cheap_blocks_are_what_the_script_prints() -> None:
    command = [sys.executable, "-m", "scripts.update_docs", "--check", *CHEAP]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("interval", "beginning"),
    [
        ("0.073 [0.027, 0.120]", "PPO beats the best script by 0.073 of return"),
        ("-0.073 [-0.120, -0.027]", "PPO is worse than the best script by 0.073 of return"),
        ("0.010 [-0.027, 0.047]", "PPO against the best script is undecided"),
    ],
)
def test_the_sentence_about_the_agent_follows_the_interval(interval: str, beginning: str) -> None:
    sentence = verdict(*map(float, re.findall(r"-?[\d.]+", interval)), 1)
    assert sentence.startswith(beginning)
    assert "one training run" in sentence


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
