"""What the README shows is what the code does."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv.recording import UNITS, load, load_operators

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def run_example(example: str, folder: Path) -> list[str]:
    done = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_an_example_runs_as_it_stands(number, tmp_path):
    run_example(EXAMPLES[number], tmp_path)


def test_the_first_example_prints_what_the_text_below_it_says(tmp_path):
    end, success, tip, residual = run_example(EXAMPLES[0], tmp_path)
    assert f"`{end} {success} {tip[:6]}...`" in README
    assert abs(float(residual)) < 1e-14


def test_the_measuring_example_prints_what_its_comments_say(tmp_path):
    (example,) = (example for example in EXAMPLES if "estimate_fracture_resistance" in example)
    modulus, resistance = map(float, run_example(example, tmp_path))
    assert modulus == pytest.approx(38.5e3, rel=0.02)
    assert resistance == pytest.approx(211.0, rel=0.03)


def test_the_record_that_is_shown_loads_as_the_text_above_it_says(tmp_path):
    shown, _ = re.findall(r"```csv\n(.*?)```", README, re.DOTALL)
    (tmp_path / "rig.csv").write_text(shown)
    first, second = load(tmp_path / "rig.csv")
    assert list(first.force) == [0.05, 0.31]
    assert (first.metadata["cut"], second.metadata["cut"]) == (3, 4)
    assert first.speed == pytest.approx([0.0254, 0.0254])
    assert second.angle == pytest.approx([math.pi / 4] * 2)
    (tmp_path / "rig.csv").write_text(shown.partition("\n")[2])  # without the metadata
    assert load(tmp_path / "rig.csv", force="-x")[1].force == pytest.approx(second.force)


def test_the_table_of_operators_that_is_shown_loads(tmp_path):
    _, shown = re.findall(r"```csv\n(.*?)```", README, re.DOTALL)
    (tmp_path / "operators.csv").write_text(shown)
    rows = load_operators(tmp_path / "operators.csv")
    assert [(row.record, row.group, row.order) for row in rows] == [
        ("N01_01.csv", "novice", 1.0),
        ("N01_02.csv", "novice", 2.0),
        ("E01_01.csv", "expert", 1.0),
    ]


def test_the_units_that_are_listed_are_those_that_are_understood():
    listed = dict(re.findall(r"^\| (`(?:time|force|position|speed|angle)`.*?) \| (.*) \|$", README, re.MULTILINE))
    found = {re.findall(r"`(\w+)`", fields)[0]: re.findall(r"`(\w+)`", units) for fields, units in listed.items()}
    found["depth"] = found["position"]
    assert found == {field: [unit for unit in units if "/" not in unit] for field, units in UNITS.items()}


def test_there_is_an_example_of_each_use():
    assert len(EXAMPLES) == 8


def update(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, str(ROOT / "scripts" / "update_readme.py")]
    return subprocess.run([*program, *arguments], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("block", ["parameters", "benchmark"])
def test_a_table_is_what_the_script_prints(block):
    done = update("--check", block)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("block", ["agreement", "speed", "training", "headroom", "specimens", "rig-faults", "rig-soak"])
def test_no_block_is_empty(block):
    content = re.search(rf"<!-- {block} -->\n(.*?)<!-- /{block} -->", README, re.DOTALL)
    assert content
    assert len(content[1].strip().splitlines()) >= 5


def test_links_lead_somewhere():
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
