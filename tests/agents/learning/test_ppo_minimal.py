"""Agents learn: those in one file, which import little and are short, and that of cutenv train."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from program import rows, run

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

import ppo_gru  # noqa: E402
import ppo_minimal  # noqa: E402

MARGIN = 0.2
"""Rise of the mean return on 100 held-out specimens; seeds 0 to 2 rose by 0.32, 0.30 and 0.22."""


@pytest.mark.parametrize(("agent", "lines"), [(ppo_minimal, 300), (ppo_gru, 380)])
def test_it_is_one_file_over_the_public_environment(agent, lines):
    text = Path(agent.__file__).read_text()
    assert len(text.splitlines()) < lines
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
    ours = {name for name in imported if name.partition(".")[0] not in ("torch", "numpy", "gymnasium")}
    assert ours - {"typing", "collections.abc"} == {"__future__", "argparse", "dataclasses", "time", "cutenv"}


def test_it_trains_on_the_native_environment():
    from cutenv.envs.vector import GentleCutVectorEnv

    assert isinstance(ppo_minimal.make_env(2).unwrapped, GentleCutVectorEnv)


def untrained(args):
    torch.manual_seed(args.seed)
    return ppo_minimal.Agent(12, 2, args.log_std)


def test_it_learns_and_does_not_without_a_learning_rate():
    args = ppo_minimal.Args(total_decisions=200_000, num_steps=128, num_minibatches=8, learning_rate=5e-4, seed=1)
    before, _ = ppo_minimal.evaluate(untrained(args), 100)
    agent, curve = ppo_minimal.train(args, verbose=False)
    after, _ = ppo_minimal.evaluate(agent, 100)
    assert after > before + MARGIN
    assert max(curve[2:]) > curve[1]  # before, only short cuts have ended
    idle = ppo_minimal.Args(total_decisions=4_000, num_steps=64, seed=1, learning_rate=0.0)
    same, _ = ppo_minimal.evaluate(ppo_minimal.train(idle, verbose=False)[0], 100)
    assert abs(same - before) < MARGIN / 4


def test_two_trainings_of_one_seed_are_the_same():
    args = ppo_minimal.Args(total_decisions=4_000, num_steps=64, num_envs=8, update_epochs=2, seed=3)
    (one, curve), (other, again) = (ppo_minimal.train(args, verbose=False) for _ in range(2))
    assert curve == again
    assert all(torch.equal(a, b) for a, b in zip(one.parameters(), other.parameters(), strict=True))


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
    """PPO learns from nothing, without demonstrations, the task in a one-minute version, whatever the seed."""
    pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
    done = run("train", tmp_path, "--name", "learns", "--seed", str(seed), *ONE_MINUTE)
    assert done.returncode == 0, done.stderr
    curve = rows(tmp_path / "runs" / "learns" / "learning_curve.csv")
    validated = [row for row in curve if row["validation_return"]]
    assert float(validated[0]["validation_return"]) < NOTHING + 0.2
    best = max(validated, key=lambda row: float(row["validation_return"]))
    assert float(best["validation_return"]) > 0.35
    assert float(best["validation_success"]) > 0.4
