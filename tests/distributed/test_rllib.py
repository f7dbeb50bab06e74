"""Ray is tested in a virtual environment of its own, for it wants another Gymnasium than the other learners."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / (".venv-ray/Scripts/python.exe" if os.name == "nt" else ".venv-ray/bin/python")
HERE = Path(__file__).parent


@pytest.mark.skipif(not PYTHON.exists(), reason="'python3 scripts/start.py test' makes .venv-ray, which has Ray")
def test_rllib_passes_the_tests_of_its_environment() -> None:
    command = [PYTHON, "-m", "pytest", "-q", "--noconftest", "-o", "addopts=", "-p", "no:cacheprovider"]
    fair = os.environ | {"RAY_worker_niceness": "0"}  # the other tests that run beside it would starve Ray's workers
    ran = subprocess.run([*command, HERE / "in_ray.py"], cwd=ROOT, env=fair, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "skipped" not in ran.stdout


def test_ray_is_not_in_the_environment_of_the_other_learners() -> None:
    assert "venv-ray" not in sys.prefix
    assert importlib.util.find_spec("ray") is None
