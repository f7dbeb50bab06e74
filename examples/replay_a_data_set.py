"""Record cuts as a Minari data set, read it back, and earn the recorded rewards again."""

import os
import sys
import warnings

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.policy import FastThenSlow

os.environ["MINARI_DATASETS_PATH"] = os.path.abspath("datasets")  # instead of ~/.minari/datasets
try:
    import minari
    from minari.data_collector import EpisodeBuffer
except ModuleNotFoundError as error:
    sys.exit(f"{error.name} is not installed: pip install 'cutenv[data]'")
warnings.simplefilter("ignore")  # Minari warns of every field that is left out

env, policy, recorded = gymnasium.make("cutenv/GentleCut-v1", control_hz=10), FastThenSlow(), []
for seed in range(3):
    observation, info = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    cut = EpisodeBuffer(seed=seed, observations=[observation], actions=[])
    while not (cut.terminations and cut.terminations[-1]):
        action = policy(observation)
        observation, reward, terminated, truncated, info = env.step(action)
        cut.observations.append(observation)
        cut.actions.append(action)
        cut.rewards.append(reward)
        cut.terminations.append(terminated)
        cut.truncations.append(truncated)
    recorded.append(cut)
minari.create_dataset_from_buffers("example/fast-then-slow-v0", recorded, env=env, algorithm_name="fast then slow")

data = minari.load_dataset("example/fast-then-slow-v0")
env = data.recover_environment()
for seed, cut in enumerate(data.iterate_episodes()):
    env.reset(seed=seed)
    rewards = [env.step(action)[1] for action in cut.actions]
    print(f"episode {seed}: {len(rewards)} decisions, return {sum(rewards):.3f}, recorded {cut.rewards.sum():.3f}")
    assert np.array_equal(rewards, cut.rewards)  # bit for bit
