"""Write a policy of your own, and compare it with a script on the same specimens."""

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.policy import ConstantFeed, StopAndUnload
from cutenv.task.observation import to_action


class SlowDown:
    """Slow down evenly toward the target, at 45 degrees; then stop, turn upright and unload."""

    def __init__(self) -> None:
        self.ending = StopAndUnload()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self.ending.reset()

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the action for an observation."""
        action = self.ending(observation)  # None as long as the cut is to go on
        if action is None:
            action = to_action(np.clip(0.5 * self.ending.left, 0.008, 0.02), np.pi / 4)
        return action


def cut(env: gymnasium.Env, policy: SlowDown | ConstantFeed, seed: int) -> float:
    """Cut one specimen; return the sum of the rewards."""
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    total, terminated = 0.0, False
    while not terminated:
        observation, reward, terminated, _, _ = env.step(policy(observation))
        total += reward
    return total


env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver")
seeds = TEST_SEEDS[:40]
mine = np.array([cut(env, SlowDown(), seed) for seed in seeds])
other = np.array([cut(env, ConstantFeed(speed=0.0127), seed) for seed in seeds])  # upright
difference = mine - other  # of the same specimens: easy and hard ones cancel
error = difference.std(ddof=1) / np.sqrt(len(seeds))
print(f"mine {mine.mean():.2f}, upright at 1.27 cm/s {other.mean():.2f}")
print(f"difference {difference.mean():.2f} +- {2 * error:.2f}")
assert difference.mean() > 2 * error
