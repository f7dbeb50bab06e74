"""The measurement of training speed trains as ``cutenv train`` does, or with a memory; the benchmark reads it."""

from __future__ import annotations

import dataclasses

import pytest

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

import ppo_gru

from cutenv.agents.learning.arguments import PPOArguments
from scripts.benchmarks.speed import ppo, training_speed

SMALL = dataclasses.replace(PPOArguments(), environments=4, rollout=32, batch_size=32)


@pytest.fixture(scope="module")
def found():
    return training_speed.speed(SMALL, updates=2)


def test_decisions_are_counted_after_the_first_update_and_the_share_is_one(found):
    assert found["decisions"] == 2 * 4 * 32
    assert found["decisions_per_s"] > 0.0
    assert 0.0 < found["environments_share"] < 1.0


def test_the_benchmark_reads_what_the_program_prints(found, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(training_speed, "speed", lambda *_: found)
    monkeypatch.setattr("sys.argv", ["training_speed.py"])
    training_speed.main()
    (tmp_path / "small.py").write_text(f"print({capsys.readouterr().out!r}, end='')")
    assert ppo.training_speed([str(tmp_path / "small.py")]) == found


def test_learners_with_a_memory_make_the_same_decisions_and_the_ratio_is_that_of_their_rates(monkeypatch):
    pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")
    monkeypatch.setattr(training_speed, "set_cores", lambda count: None)  # for the tests after this one
    small = ppo_gru.Args(num_envs=4, num_steps=32, hidden_size=8, num_minibatches=2, update_epochs=1)
    found = training_speed.memory_speed(small, updates=2)
    assert found["decisions"] == 2 * 4 * 32
    rates = found["gru_decisions_per_s"], found["recurrent_ppo_decisions_per_s"]
    assert min(rates) > 0.0
    assert found["ratio"] == pytest.approx(rates[0] / rates[1])
