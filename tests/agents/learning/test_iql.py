"""Implicit Q-learning: it prefers the better of what it is shown, exports what it learned, and goes on."""

from __future__ import annotations

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.arguments import BadArguments, IQLArguments  # noqa: E402
from cutenv.agents.learning.cloning import Transitions  # noqa: E402
from cutenv.agents.learning.iql import Agent, ImplicitQLearning, transition_data, transitions  # noqa: E402
from cutenv.agents.policy import TrainedPolicy  # noqa: E402
from cutenv.agents.policy.features import feature_count  # noqa: E402


def bandit() -> Transitions:
    """Cuts of two decisions; the reward, at the end, is the first decision's first number, which noise hides."""
    rng = np.random.default_rng(0)
    inputs, count = feature_count(0), 2000
    observations = np.zeros((count, inputs), np.float32)
    observations[1::2, 0] = 1.0
    actions = rng.uniform(-1.0, 1.0, (count, 2)).astype(np.float32)
    observations[1::2, 1] = actions[::2, 0]
    rewards = np.zeros(count, np.float32)
    rewards[1::2] = actions[::2, 0] + 0.1 * rng.standard_normal(count // 2)
    ends = np.arange(count) % 2 == 1
    return Transitions(observations, actions, rewards, np.roll(observations, -1, axis=0), ends)


@pytest.mark.parametrize(("temperature", "low", "high"), [(10.0, 0.6, 1.0), (0.0, -0.1, 0.1)])
def test_actions_with_better_ends_are_imitated_more_and_at_temperature_zero_all_alike(temperature, low, high):
    arguments = IQLArguments(
        history=0, hidden=32, epochs=30, batch_size=128, tau=0.05, temperature=temperature, learning_rate=3e-3
    )
    torch.manual_seed(0)
    data = bandit()
    agent = Agent(arguments, data.observations.shape[1])
    learning = ImplicitQLearning(agent, data, arguments)
    for _ in range(arguments.epochs):
        learning.run_epoch()
    (first, second), _ = agent.predict(data.observations[0], None, None, True)
    assert low < first < high
    assert abs(second) < 0.25  # of no consequence


def test_a_run_writes_a_policy_and_tells_its_teachers(trained):
    finished, _ = trained("iql")
    policy = TrainedPolicy.load(finished / "policy")
    assert policy.card.training["agent"] == "IQL"
    assert json.loads((finished / "run.json").read_text())["taught_by"]["script"] == "return stroke, probe and creep"


def test_the_exported_network_acts_as_the_fitted_one():
    arguments = IQLArguments(history=0, hidden=8)
    agent = Agent(arguments, feature_count(0) + 3)
    features = np.random.default_rng(0).uniform(-1.0, 1.0, (20, feature_count(0) + 3)).astype(np.float32)
    expected, _ = agent.predict(features, None, None, True)
    assert agent.network()(features[:, :-3]) == pytest.approx(expected, abs=1e-5)


def test_half_of_the_data_are_each_scripts():
    arguments = IQLArguments(environments=4, demonstrations=400, history=0, demonstration_noise=0.0)
    mixed, _ = transition_data(arguments)
    first, second = (
        transition_data(
            IQLArguments(
                environments=4, demonstrations=400, history=0, demonstration_noise=0.0, script=name, other_script=name
            )
        )[0]
        for name in (arguments.script, arguments.other_script)
    )
    middle = len(mixed.rewards) // 2
    assert (mixed.actions[:middle] == first.actions[:middle]).all()
    assert (mixed.actions[middle:] == second.actions[middle:]).all()
    assert (mixed.actions[middle:] != first.actions[middle:]).any()


def test_a_data_set_gives_the_same_transitions_as_its_cuts(tmp_path, monkeypatch):
    pytest.importorskip("minari", reason="data sets are an extra: pip install 'cutenv[data]'")
    from cutenv.agents.learning.minari_datasets import simulated_cuts, write

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    keywords, cuts = simulated_cuts("fast then slow", {"control_hz": 10, "angle_mode": "free"}, range(2))
    dataset = write("cutenv/test/iql-v0", "fast then slow", keywords, cuts)
    found = transitions(dataset, {"history": 0})
    lengths = [len(cut.rewards) for cut in cuts]
    assert np.flatnonzero(found.ends).tolist() == [lengths[0] - 1, sum(lengths) - 1]
    assert found.rewards.sum() == pytest.approx(sum(cut.rewards.sum() for cut in cuts), rel=1e-5)
    inside = ~found.ends[:-1]
    assert (found.next_observations[:-1][inside] == found.observations[1:][inside]).all()
    with pytest.raises(BadArguments, match="--other-script belongs to a script"):
        IQLArguments.completed({"dataset": "cutenv/test/iql-v0", "other_script": "return stroke"})
