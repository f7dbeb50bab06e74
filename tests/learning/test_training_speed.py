"""``scripts/training_speed.py`` trains with the settings of ``cutenv train``; ``scripts/bench.py`` reads its result."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import pytest

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

import training_speed
from program import ROOT
from speed import ppo

from cutenv.learning.arguments import PPOArguments

SMALL = dataclasses.replace(PPOArguments(), environments=4, rollout=32, batch_size=32)


def test_decisions_are_counted_after_the_first_update_and_the_share_is_one():
    found = training_speed.speed(SMALL, updates=2)
    assert found["decisions"] == 2 * 4 * 32
    assert found["decisions_per_s"] > 0.0
    assert 0.0 < found["environments_share"] < 1.0


def test_the_benchmark_reads_what_the_program_prints(tmp_path):
    (tmp_path / "small.py").write_text(
        f"import sys; sys.path.insert(0, {str(ROOT / 'scripts')!r})\n"
        "import json, dataclasses, training_speed\nfrom cutenv.learning.arguments import PPOArguments\n"
        "small = dataclasses.replace(PPOArguments(), environments=4, rollout=32, batch_size=32)\n"
        "print(json.dumps(training_speed.speed(small, 1)))\n"
    )
    found = ppo.training_speed(tmp_path / "small.py")
    assert found["decisions"] == 128
    assert set(found) == {"decisions", "decisions_per_s", "environments_share"}


def test_no_updates_are_refused():
    done = subprocess.run(
        [sys.executable, training_speed.__file__, "--updates", "0"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "--updates 0 is less than 1" in done.stderr
