"""What is kept of a training: the running average of the actor where it did best, and what it goes on from."""

from __future__ import annotations

import dataclasses

import pytest

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from stable_baselines3 import PPO  # noqa: E402
from stable_baselines3.common.logger import Logger  # noqa: E402
from tqdm import tqdm  # noqa: E402

from cutenv.agents.learning import on_policy, progress  # noqa: E402
from cutenv.agents.learning.arguments import LearnerArguments, PPOArguments  # noqa: E402

LEARNER = on_policy.ON_POLICY["ppo"]
SMALL = PPOArguments(
    environments=2, rollout=8, batch_size=16, demonstrations=0, averaging=0.25, timesteps=64, validations=2,
    validation_specimens=2,
)  # fmt: skip


def untrained(arguments):
    return LEARNER.new_model(arguments, arguments.training_environments())


@pytest.fixture
def watching(tmp_path):
    result = progress.Progress(tmp_path, SMALL, [])
    result.init_callback(untrained(SMALL))
    result.model.set_logger(Logger(None, []))
    return result


def first_weights(model):
    return model.policy.actor_parameters()[0].detach().clone()


def test_the_average_follows_the_actor_at_a_distance_and_the_actor_stays_as_it_is(watching):
    watching.average()
    start = first_weights(watching.model)
    with torch.no_grad():
        watching.model.policy.actor_parameters()[0].add_(1.0)
    watching.average()
    with watching.averaged():
        assert torch.allclose(first_weights(watching.model), start + 0.25)
    assert torch.equal(first_weights(watching.model), start + 1.0)


def test_the_actor_comes_back_even_if_validation_is_interrupted(watching):
    watching.average()
    with torch.no_grad():
        watching.model.policy.actor_parameters()[0].add_(1.0)
    present = first_weights(watching.model)
    with pytest.raises(KeyboardInterrupt), watching.averaged():
        raise KeyboardInterrupt
    assert torch.equal(first_weights(watching.model), present)


def test_only_a_better_validation_replaces_what_is_kept(watching, tmp_path, monkeypatch):
    kept = tmp_path / "policy.zip"
    for decisions, mean_return, replaces in ((10, 0.3, True), (20, 0.2, False), (30, 0.4, True)):
        kept.unlink(missing_ok=True)
        monkeypatch.setattr(progress, "validate", lambda *_, value=mean_return: (value, 0.5))
        watching.curve.append({"decisions": decisions, "return": 0.0, "success": 0.0})
        watching.validate()
        assert kept.is_file() == replaces


def test_exploration_falls_and_is_not_learned(watching):
    watching._on_rollout_start()
    log_std = watching.model.policy.log_std
    assert log_std.exp().tolist() == pytest.approx([SMALL.exploration] * 2)
    assert not log_std.requires_grad
    watching.num_timesteps = SMALL.timesteps
    watching._on_rollout_start()
    assert log_std.exp().tolist() == pytest.approx([SMALL.last_exploration] * 2)


def test_while_only_the_critic_learns_the_actor_does_not(tmp_path):
    taught = PPOArguments(environments=2, rollout=8, batch_size=16, demonstrations=100, critic_first=0.5, timesteps=64)
    watching = progress.Progress(tmp_path, taught, [])
    watching.init_callback(untrained(taught))
    for decisions, learns in ((0, False), (31, False), (32, True)):
        watching.num_timesteps = decisions
        watching._on_rollout_start()
        assert all(parameter.requires_grad == learns for parameter in watching.model.policy.actor_parameters())


def test_with_minutes_the_share_goes_by_the_clock_from_the_end_of_teaching_to_the_end_of_training(
    tmp_path, monkeypatch
):
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    arguments = PPOArguments(environments=2, rollout=8, batch_size=16, minutes=1.0, timesteps=10**9)
    watching = progress.Progress(tmp_path, arguments, [], begun=980.0)  # 20 s were spent on demonstrations
    watching.init_callback(untrained(arguments))
    for seconds, share, goes_on in ((0.0, 0.0, True), (10.0, 0.25, True), (30.0, 0.75, True), (40.0, 1.0, False)):
        now[0] = 1000.0 + seconds
        assert watching.share == pytest.approx(share, abs=1e-6)
        assert watching._on_step() == goes_on
    resumed = progress.Progress(tmp_path, arguments, [{"seconds": 20.0}, {"seconds": 45.0}])
    resumed.init_callback(watching.model)
    now[0] += 5.0
    assert resumed.share == pytest.approx(0.75)


def test_the_rate_of_learning_falls_to_a_twentieth_by_that_share(watching):
    rate = watching.model.learning_rate
    assert rate(1.0) == pytest.approx(SMALL.learning_rate)
    watching._bar = tqdm(total=SMALL.timesteps, disable=True)
    watching._validated = SMALL.validations
    watching.num_timesteps = SMALL.timesteps
    watching._on_rollout_end()
    assert watching.model.lr_schedule(0.5) == pytest.approx(SMALL.learning_rate / 20.0)


@pytest.fixture
def trained(tmp_path, monkeypatch):
    """Train in a run's folder, or go on; gives environments, progress, and its averages and seconds at first."""
    made = []
    make = LearnerArguments.environments_at

    def environments_at(self, seeds):
        made.append(make(self, seeds))
        return made[-1]

    class Watched(progress.Progress):
        def __init__(self, *given):
            super().__init__(*given)
            made.append((self, [values.clone() for values in self.averages], self.seconds))

    monkeypatch.setattr(LearnerArguments, "environments_at", environments_at)
    monkeypatch.setattr(on_policy, "Progress", Watched)

    def train(timesteps, resume, **changed):
        made.clear()
        on_policy.train(LEARNER, dataclasses.replace(SMALL, timesteps=timesteps, **changed), tmp_path, resume)
        environments, watched, *_ = made
        return environments, *watched

    return train


def test_what_is_averaged_goes_on_from_where_it_was(trained):
    _, first, begins_with, _ = trained(64, resume=False)
    assert begins_with == []
    last = [values.clone() for values in first.averages]
    assert not torch.equal(last[0], first_weights(first.model))
    _, _, begins_with, _ = trained(128, resume=True)
    assert len(begins_with) == len(last)
    assert all(torch.equal(one, other) for one, other in zip(begins_with, last, strict=True))


def test_a_resumed_training_cuts_no_specimen_again(trained):
    environments, *_ = trained(64, resume=False)
    begun = environments.native.batch.episodes.max()  # as many of each seed, from the first on
    assert begun >= 1
    environments, *_ = trained(128, resume=True)
    assert environments.first_episode >= begun
    assert environments.native.batch.episodes.min() > begun


def test_cuts_are_counted_from_the_first_demonstration_on_and_across_an_interruption(trained, tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "validate", lambda *_: (0.0, 0.0))
    taught = {"demonstrations": 400, "demonstration_noise": 0.0, "rollout": 40, "batch_size": 80}
    environments, *_ = trained(1200, resume=False, **taught)
    first = environments.cuts
    assert first >= 2 + 2 + 2  # begun by the demonstrations, by an end among them, and by the trial
    environments, watched, *_ = trained(2400, resume=True, **taught)
    assert environments.cuts >= first + 2
    counts = [point["cuts"] for point in watched.curve]
    assert counts == sorted(counts)
    assert first - 2 <= counts[-1] <= environments.cuts


def test_its_clock_goes_on_from_the_checkpoint_even_where_no_cut_has_ended(trained, tmp_path):
    _, first, _, begun = trained(64, resume=False)
    assert first.curve == []
    kept = PPO.load(tmp_path / "checkpoint.zip").checkpoint_extras["seconds"]
    assert begun < kept
    _, again, _, begun = trained(128, resume=True)
    assert begun >= kept
    assert again._pretraining == first._pretraining


def test_a_curve_that_is_ahead_of_its_checkpoint_is_cut_off(trained, tmp_path):
    trained(64, resume=False)
    (tmp_path / "learning_curve.csv").write_text("decisions,seconds\n32,1.0\n1000000,2.0\n")
    _, again, _, _ = trained(128, resume=True)
    assert [point["decisions"] for point in again.curve][:1] == [32.0]
    assert all(point["decisions"] <= 128 for point in again.curve)
    assert "1000000" not in (tmp_path / "learning_curve.csv").read_text()


def test_a_checkpoint_of_an_earlier_version_loads_and_says_what_it_lacks(trained, tmp_path, capsys):
    trained(64, resume=False)
    model = PPO.load(tmp_path / "checkpoint.zip")
    del model.checkpoint_extras
    progress.save_model(model, tmp_path / "checkpoint.zip")
    _, _, begins_with, _ = trained(128, resume=True)
    assert begins_with == []
    assert "contains no running average of the actor: the average starts again" in capsys.readouterr().out
    assert PPO.load(tmp_path / "checkpoint.zip").num_timesteps == 128
