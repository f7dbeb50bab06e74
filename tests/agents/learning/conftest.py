"""One small training of each learner, made once for all tests."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import pytest
from kept_policy import ABOUT, network
from program import SMALL, run

from cutenv.agents.policy import save_policy


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, str]]:
    """Train a learner as a user does; the folder of its run, which no test may change, and what was printed."""

    @functools.cache
    def made(learner: str) -> tuple[Path, str]:
        folder = tmp_path_factory.mktemp(learner)
        done = run(f"train --learner {learner}", folder, *SMALL[learner])
        assert done.returncode == 0, done.stderr
        return folder / "runs" / "small", done.stdout

    return made


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Save a small policy with random weights."""
    save_policy(tmp_path / "policy", network(), **ABOUT)
    return tmp_path / "policy"
