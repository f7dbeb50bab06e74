"""Wrappers, vector environments and a learner with default settings take the environment as it is."""

from __future__ import annotations

import itertools

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics
from whole_cut import ENVIRONMENT, cut, make

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


def single_episodes(seed: int, steps: int, **keywords):
    """What one environment returns for ``steps`` decisions, and where it ends."""
    env = make(**keywords)
    start = env.reset(seed=seed)
    return start, [env.step(CUTTING) for _ in range(steps)], env


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_vector_of_environments_equals_single_ones_and_restarts_by_itself(mode):
    vector = SyncVectorEnv([lambda: make(deadline_s=1.0)] * 3, autoreset_mode=mode)
    start, _ = vector.reset(seed=[5, 6, 7])
    singles = [single_episodes(seed, 50, deadline_s=1.0) for seed in (5, 6, 7)]
    np.testing.assert_array_equal(start, [single[0][0] for single in singles])
    for step in range(50):
        observation, reward, terminated, truncated, info = vector.step(np.tile(CUTTING, (3, 1)))
        alone = [single[1][step] for single in singles]
        np.testing.assert_array_equal(reward, [entry[1] for entry in alone])
        np.testing.assert_array_equal(terminated, [entry[2] for entry in alone])
        assert not truncated.any()
        last = mode is AutoresetMode.SAME_STEP and step == 49
        seen = info["final_obs"] if last else observation
        np.testing.assert_array_equal(np.stack(seen), [entry[0] for entry in alone])
    assert terminated.all()
    final = info["final_info"] if mode is AutoresetMode.SAME_STEP else info
    assert list(final["end"]) == ["deadline"] * 3
    fresh = [single[2].reset()[0] for single in singles]
    if mode is AutoresetMode.NEXT_STEP:
        observation, reward, terminated, _, _ = vector.step(np.tile(CUTTING, (3, 1)))
        assert not reward.any()
        assert not terminated.any()
    np.testing.assert_array_equal(observation, fresh)
    vector.close()


def test_a_vector_that_never_restarts_says_so():
    vector = SyncVectorEnv([lambda: make(deadline_s=1.0)] * 2, autoreset_mode=AutoresetMode.DISABLED)
    vector.reset(seed=0)
    for _ in range(50):
        terminated = vector.step(np.tile(CUTTING, (2, 1)))[2]
    assert terminated.all()
    vector.reset(options={"reset_mask": np.array([True, True])})
    assert not vector.step(np.tile(CUTTING, (2, 1)))[2].any()
    vector.close()


def test_make_vec_makes_a_vector_of_different_cuts():
    vector = gymnasium.make_vec(ENVIRONMENT, num_envs=3, vectorization_mode="sync", specimen_class="liver")
    _, info = vector.reset(seed=0)
    assert len(set(info["truth"]["target_length_m"])) == 3
    vector.close()


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
