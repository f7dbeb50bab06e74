"""Behaviour cloning and recurrent PPO as a user runs them, small: they write what PPO writes, and go on."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from program import assert_training_goes_on, interrupted, interrupted_at, run

from cutenv.agents.policy import Features, TrainedPolicy

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")
torch = pytest.importorskip("torch", reason="the learners are an extra: pip install 'cutenv[rl]'")

COMMON = (
    "--name", "small", "--environments", "4", "--demonstrations", "1000", "--validations", "2",
    "--validation-specimens", "4", "--specimens", "0",
)  # fmt: skip
TRIAL = ("--rollout", "64", "--batch-size", "64", "--timesteps", "2048", "--epochs", "2")
PROGRAMS = {
    "train --learner bc": (*COMMON, "--epochs", "4"),
    "train --learner recurrent-ppo": (*COMMON, *TRIAL, "--cloning-epochs", "1", "--critic", "features"),
}


@pytest.fixture(scope="module", params=list(PROGRAMS))
def finished(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("training")
    done = run(request.param, folder, *PROGRAMS[request.param], "--tensorboard")
    assert done.returncode == 0, done.stderr
    return request.param, folder / "runs" / "small"


def test_a_run_keeps_seeds_versions_commit_curve_and_events(finished):
    _, folder = finished
    facts = json.loads((folder / "run.json").read_text())
    assert max(facts["seeds"]["training"]) < min(facts["seeds"]["validation"])
    assert {"torch", "sb3-contrib", "numpy", "python"} <= facts["versions"].keys()
    assert {"commit", "uncommitted_changes", "training_minutes"} <= facts.keys()
    with (folder / "learning_curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert any(row["validation_return"] for row in rows)
    seconds = [float(row["seconds"]) for row in rows]
    assert seconds == sorted(seconds)
    assert list(folder.glob("tensorboard/**/events.out.tfevents.*"))


def test_the_policy_runs_without_torch_and_is_that_of_the_run(finished):
    _, folder = finished
    policy = TrainedPolicy.load(folder / "policy")
    env = gymnasium.make(policy.card.environment, **policy.environment_arguments)
    observation, _ = env.reset(seed=1)
    policy.reset(np.random.default_rng(0))
    for _ in range(20):
        observation = env.step(policy(observation))[0]
    assert policy.card.training["agent"] in ("behaviour cloning", "recurrent PPO")
    assert policy.card.training["decisions"] > 0


def test_a_run_is_never_overwritten(finished):
    program, folder = finished
    again = run(program, folder.parents[1], *PROGRAMS[program])
    assert again.returncode != 0
    assert "--resume" in again.stderr


@pytest.mark.parametrize("finished", ["train --learner recurrent-ppo"], indirect=True)
def test_the_exported_memory_acts_as_the_trained_one(finished):
    _, folder = finished
    from sb3_contrib import RecurrentPPO

    model = RecurrentPPO.load(folder / "policy.zip", device="cpu")
    policy = TrainedPolicy.load(folder / "policy")
    features = Features(**policy.card.features)
    hidden = np.zeros(model.observation_space.shape[0] - features.size, np.float32)
    env = gymnasium.make(policy.card.environment, **policy.environment_arguments)
    observation, _ = env.reset(seed=1)
    policy.reset(np.random.default_rng(0))
    memory, begun = None, np.array([True])
    for _ in range(60):
        shown = np.concatenate((features(observation), hidden))
        expected, memory = model.predict(shown, state=memory, episode_start=begun, deterministic=True)
        begun = np.array([False])
        action = policy(observation)
        assert action == pytest.approx(np.clip(expected, -1.0, 1.0), abs=1e-4)
        observation = env.step(action)[0]


def test_an_interrupted_cloning_goes_on_as_if_it_had_not_been(tmp_path):
    small = ("--name", "small", *COMMON[2:], "--checkpoint-seconds", "0")
    status, printed = interrupted("train --learner bc", tmp_path, "checkpoint.safetensors", *small, "--epochs", "200")
    assert status == 130
    assert "--resume runs/small" in printed
    done = run("train", tmp_path, "--resume", "runs/small")  # the run knows its learner
    assert done.returncode == 0, done.stderr
    assert "resuming after" in done.stdout
    other = tmp_path / "straight"
    other.mkdir()
    straight = run("train --learner bc", other, *small, "--epochs", "200")
    assert straight.returncode == 0, straight.stderr
    from safetensors.numpy import load_file

    one, two = (load_file(folder / "runs" / "small" / "checkpoint.safetensors") for folder in (tmp_path, other))
    assert one.keys() == two.keys()
    for name in one:
        assert np.array_equal(one[name], two[name]), name


def test_an_interrupted_recurrent_run_goes_on_training_from_its_checkpoint(tmp_path):
    from sb3_contrib import RecurrentPPO

    endless = (*PROGRAMS["train --learner recurrent-ppo"], "--timesteps", "100000000", "--checkpoint-seconds", "0")
    status, printed = interrupted("train --learner recurrent-ppo", tmp_path, "checkpoint.zip", *endless)
    assert status == 130
    assert "checkpoint.zip is usable" in printed
    assert_training_goes_on("train --learner recurrent-ppo", tmp_path, RecurrentPPO, rollout=4 * 64)
    assert (tmp_path / "runs" / "small" / "policy" / "card.json").is_file()


@pytest.mark.parametrize("program", ["train", "train --learner bc"])
def test_interrupted_before_the_first_checkpoint_it_says_that_there_is_nothing_to_go_on_from(tmp_path, program):
    long = ("--name", "small", "--demonstrations", "100000000")
    # Once the bar moves: a press just as it came up was lost before, perhaps in code called back from C.
    status, printed, errors = interrupted_at(program, tmp_path, r"demonstrating.*\d[kM]?decision/s", *long)
    assert status == 130
    assert "there is nothing to resume. runs/small may be deleted." in printed
    assert "--resume" not in printed
    assert "Traceback" not in errors


def test_the_clock_ends_training(tmp_path):
    endless = (*PROGRAMS["train --learner recurrent-ppo"], "--timesteps", "100000000", "--minutes", "0.01")
    done = run("train --learner recurrent-ppo", tmp_path, *endless)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "small" / "policy" / "card.json").is_file()
