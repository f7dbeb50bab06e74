"""Cut one specimen at a constant speed and angle, then stop and unload."""

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.policy import ConstantFeed

env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08)
policy = ConstantFeed(speed=0.0127, angle=1.31)  # 1.27 cm/s, 75 degrees
observation, info = env.reset(seed=7)
policy.reset(np.random.default_rng(0))  # before every cut
terminated = truncated = False
while not (terminated or truncated):
    observation, reward, terminated, truncated, info = env.step(policy(observation))

tip = info["truth"]["tip_m"]
print(f"end: {info['end']}, success: {info['is_success']}, tip at {1e3 * tip:.1f} mm for a target of 80 mm")
print(f"energy that is not accounted for: {info['energy']['residual']:.1e} J")

assert info["is_success"]
assert abs(tip - 0.0783) < 1e-4
assert abs(info["energy"]["residual"]) < 1e-14
