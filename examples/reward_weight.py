"""Change the weight of a reward term, and see what the same cut is worth then."""

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.policy import ConstantFeed


def cut(**weights: float) -> tuple[float, float]:
    """Cut one specimen; return the sum of the rewards, and the part of it that is charged for jumps."""
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08, **weights)
    policy = ConstantFeed(speed=0.0127, angle=1.31)
    observation, _ = env.reset(seed=7)
    policy.reset(np.random.default_rng(0))
    total, jumps, terminated = 0.0, 0.0, False
    while not terminated:
        observation, reward, terminated, _, info = env.step(policy(observation))
        total += reward
        jumps += info["reward_terms"]["jump"]
    return total, jumps


usual, usual_jumps = cut()
strict, strict_jumps = cut(weight_jump=0.12)  # 0.03 by default
print(f"weight_jump 0.03: return {usual:.3f}, of which {usual_jumps:.3f} for jumps")
print(f"weight_jump 0.12: return {strict:.3f}, of which {strict_jumps:.3f} for jumps")

assert abs(strict_jumps - 4 * usual_jumps) < 1e-12
assert abs((strict - usual) - (strict_jumps - usual_jumps)) < 1e-12

try:
    gymnasium.make("cutenv/GentleCut-v1", weight_jmup=0.2)
except TypeError as error:  # a misspelt name is never ignored
    print(f"{error}".partition(" help(")[0])
else:
    raise AssertionError("a misspelt weight was taken")
