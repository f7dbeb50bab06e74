"""PPO learns: from nothing, without demonstrations, the task in a one-minute version, whatever the training seed."""

from __future__ import annotations

import csv

import pytest
from program import run

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

ONE_MINUTE = (
    "--timesteps", "600000", "--demonstrations", "0", "--specimen-class", "uniform", "--angle-mode", "fixed",
    "--environments", "256", "--rollout", "32", "--batch-size", "2048", "--epochs", "6", "--learning-rate", "1e-3",
    "--exploration", "0.6", "--last-exploration", "0.1", "--averaging", "0.2", "--validations", "8",
    "--validation-specimens", "40", "--specimens", "0",
)  # fmt: skip
NOTHING = -0.1  # return of a blade that never moves


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_from_less_than_doing_nothing_to_cuts_that_mostly_succeed(tmp_path, seed):
    done = run("train", tmp_path, "--name", "learns", "--seed", str(seed), *ONE_MINUTE)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "runs" / "learns" / "learning_curve.csv").open() as file:
        validated = [row for row in csv.DictReader(file) if row["validation_return"]]
    assert float(validated[0]["validation_return"]) < NOTHING + 0.2
    best = max(validated, key=lambda row: float(row["validation_return"]))
    assert float(best["validation_return"]) > 0.35
    assert float(best["validation_success"]) > 0.4
