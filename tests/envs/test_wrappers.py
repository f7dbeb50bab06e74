"""Wrappers and a learner with default settings take the environment as it is."""

from __future__ import annotations

import numpy as np
import pytest
from whole_cut import cut, make

from cutenv.agents.policy import ConstantFeed, NoAction


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
