"""What the README shows is what the code does."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_runs_and_ends_with_a_closed_energy_account(example):
    done = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True, check=True, cwd=ROOT)
    end, total, tip, residual = done.stdout.split()
    assert end == "finished"
    assert 0.0 < float(total) < 1.0
    assert 0.05 < float(tip) < 0.11
    assert abs(float(residual)) < 1e-12


def test_there_is_an_example():
    assert EXAMPLES


def update(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, str(ROOT / "scripts" / "update_readme.py")]
    return subprocess.run([*program, *arguments], capture_output=True, text=True, check=False)


def test_the_table_of_constants_is_what_the_script_prints():
    done = update("--check", "parameters")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("block", ["parameters", "agreement", "speed", "training", "specimens"])
def test_no_block_is_empty(block):
    content = re.search(rf"<!-- {block} -->\n(.*?)<!-- /{block} -->", README, re.DOTALL)
    assert content
    assert len(content[1].strip().splitlines()) >= 5


def test_links_lead_somewhere():
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
