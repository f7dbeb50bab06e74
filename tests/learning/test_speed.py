"""``agents/speed.py`` trains with the settings of ``ppo.py`` and tells how fast; ``cutenv bench`` reads it."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

import speed
from ppo import Arguments

from cutenv.bench import ppo

SMALL = dataclasses.replace(Arguments(), environments=4, rollout=32, batch_size=32)


def test_decisions_are_counted_after_the_first_update_and_the_share_is_one():
    found = speed.speed(SMALL, updates=2)
    assert found["decisions"] == 2 * 4 * 32
    assert found["decisions_per_s"] > 0.0
    assert 0.0 < found["environments_share"] < 1.0


def test_the_benchmark_reads_what_the_program_prints(tmp_path):
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "speed.py").write_text(
        f"import sys; sys.path.insert(0, {str(Path(speed.__file__).parent)!r})\n"
        "import json, dataclasses, speed\nfrom ppo import Arguments\n"
        "small = dataclasses.replace(Arguments(), environments=4, rollout=32, batch_size=32)\n"
        "print(json.dumps(speed.speed(small, 1)))\n"
    )
    found = ppo.training_speed(tmp_path)
    assert found["decisions"] == 128
    assert set(found) == {"decisions", "decisions_per_s", "environments_share"}


def test_no_updates_are_refused():
    done = subprocess.run(
        [sys.executable, speed.__file__, "--updates", "0"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "--updates 0 is less than 1" in done.stderr
