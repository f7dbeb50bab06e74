"""What is kept of a training: the running average of the actor where it did best."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

import progress  # noqa: E402
from ppo import Arguments, new_model  # noqa: E402
from stable_baselines3.common.logger import Logger  # noqa: E402

SMALL = Arguments(
    environments=2, rollout=8, batch_size=16, demonstrations=0, averaging=0.25, timesteps=64, validations=2,
    validation_specimens=2,
)  # fmt: skip


def untrained(arguments):
    return new_model(arguments, arguments.environments_at(arguments.training_seeds))


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
    taught = Arguments(environments=2, rollout=8, batch_size=16, demonstrations=100, critic_first=0.5, timesteps=64)
    watching = progress.Progress(tmp_path, taught, [])
    watching.init_callback(untrained(taught))
    for decisions, learns in ((0, False), (31, False), (32, True)):
        watching.num_timesteps = decisions
        watching._on_rollout_start()
        assert all(parameter.requires_grad == learns for parameter in watching.model.policy.actor_parameters())
