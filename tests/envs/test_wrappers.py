"""Wrappers and a learner with default settings take the environment as it is."""

from __future__ import annotations

import itertools

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics
from whole_cut import cut, make

from cutenv.agents.policy import ConstantFeed, NoAction

CUTTING = np.float32([0.8, 1.0])


def test_episode_statistics_are_recorded():
    env = RecordEpisodeStatistics(make())
    total = 0.0
    env.reset(seed=0)
    ended, steps = False, 0
    while not ended:
        _, reward, ended, _, info = env.step(CUTTING)
        total, steps = total + reward, steps + 1
    assert info["episode"]["r"] == pytest.approx(total)
    assert info["episode"]["l"] == steps


def test_observations_are_stacked():
    env = FrameStackObservation(make(), 4)
    first = env.reset(seed=0)[0]
    assert first.shape == (4, 12)
    stacked = [env.step(CUTTING)[0] for _ in range(6)]
    for earlier, later in itertools.pairwise(stacked):
        np.testing.assert_array_equal(earlier[1:], later[:-1])
    assert env.observation_space.contains(stacked[-1])


def test_a_rescaled_action_and_a_time_limit_wrap_without_surprise():
    env = gymnasium.wrappers.RescaleAction(gymnasium.wrappers.TimeLimit(make(), 10), np.float32(0.0), np.float32(1.0))
    env.reset(seed=0)
    results = [env.step(np.float32([0.9, 1.0])) for _ in range(10)]
    assert [entry[3] for entry in results] == [False] * 9 + [True]


@pytest.mark.filterwarnings("error::UserWarning:gymnasium")
@pytest.mark.filterwarnings("error::UserWarning:stable_baselines3")
def test_ppo_with_default_settings_runs_and_its_policy_acts():
    sb3 = pytest.importorskip("stable_baselines3")
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        agent = sb3.PPO("MlpPolicy", make(), seed=0)
        agent.learn(agent.n_steps)
    finally:
        torch.set_num_threads(threads)
    assert agent.num_timesteps == 2048

    class Agent(NoAction):
        def __call__(self, observation):
            return agent.predict(observation)[0]

    record = cut(make(), Agent())
    assert record.end in ("finished", "force_limit", "overshoot", "deadline")
    assert np.isfinite(record.total)


def test_sb3_sees_success_and_return_of_an_episode():
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    monitor = pytest.importorskip("stable_baselines3.common.monitor")

    class Predictor:
        def __init__(self):
            self.policy = ConstantFeed(speed=0.02)
            self.policy.reset(np.random.default_rng(0))

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            if episode_start is not None and episode_start.any():
                self.policy.reset(np.random.default_rng(0))
            return self.policy(observation[0])[None], None

    env = monitor.Monitor(make(specimen_class="uniform"), info_keywords=("is_success", "end"))
    returns, lengths = evaluation.evaluate_policy(Predictor(), env, n_eval_episodes=2, return_episode_rewards=True)
    assert len(returns) == 2
    assert min(lengths) > 50
