"""The README is short, and what it shows is what the code does."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv.commands.cli import COMMANDS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
LONGEST = 150  # lines of the README; more belongs to a page of the documentation


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= LONGEST


def test_its_ten_lines_print_what_the_text_below_them_says(tmp_path: Path) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    done = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    end, success, tip, residual = done.stdout.split()
    assert f"`{end} {success} {tip[:6]}...`" in README
    assert abs(float(residual)) < 1e-14


def test_its_commands_are_there() -> None:
    shown = [shlex.split(command) for command in re.findall(r"`(cutenv [^`]+)`", README)]
    assert {words[1] for words in shown} >= {"demo", "docs", "play", "rig", "score"}
    assert {words[1] for words in shown} <= set(COMMANDS)


def test_it_keeps_the_two_commands_that_set_everything_up() -> None:
    for command in ("train", "test"):
        assert f"\npython3 scripts/start.py {command}\n" in README


def test_its_table_has_five_rows_and_an_honest_sentence() -> None:
    block = re.search(r"<!-- results -->\n(.*?)<!-- /results -->", README, re.DOTALL)
    assert block
    rows = [line for line in block[1].splitlines() if line.startswith("| ")]
    assert len(rows) - 2 == 5
    assert re.search(r"95 % interval of the paired difference \[.*\], (one training run|\d+ training runs)", block[1])


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\((?!http)([^)#]+)\)", README))))
def test_its_links_lead_somewhere(target: str) -> None:
    assert (ROOT / target).exists()
