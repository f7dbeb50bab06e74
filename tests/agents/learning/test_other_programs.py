"""Learners as a user runs them, small: what every run writes, and how an interrupted one goes on."""

from __future__ import annotations

import itertools
import json
from unittest import mock

import gymnasium
import numpy as np
import pytest
from program import SMALL, assert_training_goes_on, interrupted_at, rows, run

from cutenv.agents.policy import Features, TrainedPolicy

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")
torch = pytest.importorskip("torch", reason="the learners are an extra: pip install 'cutenv[rl]'")

from safetensors.numpy import load_file  # noqa: E402
from sb3_contrib import TQC, CrossQ, RecurrentPPO  # noqa: E402
from stable_baselines3 import PPO, SAC  # noqa: E402

from cutenv.agents.learning import bc, on_policy  # noqa: E402
from cutenv.agents.learning.progress import Progress  # noqa: E402
from cutenv.commands.train import LEARNERS  # noqa: E402


@pytest.mark.parametrize("learner", ["ppo", "bc"])
def test_a_run_keeps_seeds_versions_commit_curve_and_events(trained, learner):
    folder, _ = trained(learner)
    facts = json.loads((folder / "run.json").read_text())
    assert list(facts["seeds"]) == ["training", "validation", *(["test"] if learner == "ppo" else [])]
    for earlier, later in itertools.pairwise(facts["seeds"].values()):
        assert max(earlier) < min(later)
    assert {"torch", "sb3-contrib", "numpy", "python"} <= facts["versions"].keys()
    assert {"commit", "uncommitted_changes", "training_minutes"} <= facts.keys()
    curve = rows(folder / "learning_curve.csv")
    assert any(row["validation_return"] for row in curve)
    seconds = [float(row["seconds"]) for row in curve]
    assert seconds == sorted(seconds)
    assert list(folder.glob("tensorboard/**/events.out.tfevents.*"))
    training = TrainedPolicy.load(folder / "policy").card.training
    assert training["agent"] == LEARNERS[learner][0]
    assert training["decisions"] > 0


@pytest.mark.parametrize(
    ("learner", "near"),
    [(PPO, 1e-5), (RecurrentPPO, 1e-4), (SAC, 2e-5), (TQC, 2e-5), (CrossQ, 2e-5)],
    ids=["ppo", "recurrent-ppo", "sac", "tqc", "crossq"],
)
def test_the_exported_policy_acts_as_the_trained_one(trained, request, learner, near):
    folder, _ = trained(request.node.callspec.id)
    model = learner.load(folder / "policy.zip", device="cpu")
    policy = TrainedPolicy.load(folder / "policy")
    features = Features(**policy.card.features)
    hidden = np.full(model.observation_space.shape[0] - features.size, 9.0, np.float32)  # the actor must not look at it
    env = gymnasium.make(policy.card.environment, **policy.environment_arguments)
    observation, _ = env.reset(seed=1)
    policy.reset(np.random.default_rng(0))
    memory, begun, acted = None, np.array([True]), []
    for _ in range(60):
        shown = np.concatenate((features(observation), hidden))
        expected, memory = model.predict(shown, state=memory, episode_start=begun, deterministic=True)
        begun = np.array([False])
        acted.append(policy(observation))
        assert acted[-1] == pytest.approx(np.clip(expected, -1.0, 1.0), abs=near)
        observation = env.step(acted[-1])[0]
    assert np.ptp(acted) > 0.1, "an agent that always does the same would prove nothing"
    assert policy.card.output == ("linear" if learner in (PPO, RecurrentPPO) else "tanh")


@pytest.mark.parametrize("learner", ["bc", "iql"])
def test_an_interrupted_fit_goes_on_as_if_it_had_not_been(trained, tmp_path, monkeypatch, learner):
    save = bc.save_checkpoint

    def interrupted(path, agent, fitting, seconds):
        save(path, agent, fitting, seconds)
        if fitting.epoch == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(bc, "save_checkpoint", interrupted)
        stopped = run(f"train --learner {learner}", tmp_path, *SMALL[learner])
    assert stopped.returncode == 130
    assert "--resume runs/small" in stopped.stdout
    done = run("train", tmp_path, "--resume", "runs/small")  # the run knows its learner
    assert done.returncode == 0, done.stderr
    assert "resuming after 2 epochs" in done.stdout
    one, two = (load_file(run / "checkpoint.safetensors") for run in (trained(learner)[0], tmp_path / "runs" / "small"))
    assert one.keys() == two.keys()
    for name in one:
        assert np.array_equal(one[name], two[name]), name


def test_an_interrupted_recurrent_run_goes_on_training_from_its_checkpoint(tmp_path, monkeypatch):
    """Ctrl-C itself is pressed in test_ppo_program.py."""
    save, saved = Progress.save_checkpoint, []

    def interrupted(self):
        save(self)
        saved.append(self.num_timesteps)
        if len(saved) == 1:
            raise KeyboardInterrupt

    endless = (*SMALL["recurrent-ppo"], "--timesteps", "100000000", "--checkpoint-seconds", "0")
    with monkeypatch.context() as patch:
        patch.setattr(Progress, "save_checkpoint", interrupted)
        stopped = run("train --learner recurrent-ppo", tmp_path, *endless)
    assert stopped.returncode == 130
    assert "checkpoint.zip is usable" in stopped.stdout
    assert_training_goes_on("train --learner recurrent-ppo", tmp_path, RecurrentPPO, rollout=4 * 64)
    assert (tmp_path / "runs" / "small" / "policy" / "card.json").is_file()


@pytest.mark.parametrize("learner", ["ppo", "bc"])
def test_interrupted_before_the_first_checkpoint_it_says_that_there_is_nothing_to_go_on_from(
    tmp_path, monkeypatch, learner
):
    if learner == "bc":  # Ctrl-C as a person presses it
        long = ("--name", "small", "--demonstrations", "100000000")
        # Once the bar moves: a press just as it came up was lost before, perhaps in code called back from C.
        status, printed, errors = interrupted_at(
            "train --learner bc", tmp_path, r"demonstrating.*\d[kM]?decision/s", *long
        )
    else:
        monkeypatch.setattr(on_policy, "script_demonstrations", mock.Mock(side_effect=KeyboardInterrupt))
        done = run("train", tmp_path, *SMALL["ppo"])
        status, printed, errors = done.returncode, done.stdout, done.stderr
    assert status == 130
    assert "there is nothing to resume. runs/small may be deleted." in printed
    assert "--resume" not in printed
    assert "Traceback" not in errors


def test_the_clock_ends_training(tmp_path):
    endless = (*SMALL["recurrent-ppo"], "--timesteps", "100000000", "--minutes", "0.01")
    done = run("train --learner recurrent-ppo", tmp_path, *endless)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "small" / "policy" / "card.json").is_file()
