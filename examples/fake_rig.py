"""Cut on a rig in memory, and see why some cuts do not finish."""

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.policy import ConstantFeed

env = gymnasium.make("cutenv/RigCut-v1", rig="fake", target_length=0.08)  # or "emulator", or "my_rig.toml"
policy = ConstantFeed(speed=0.0127, angle=1.31)
ends, toughest = {}, {}

for seed in range(1, 7):
    observation, info = env.reset(seed=seed)
    policy.reset(np.random.default_rng(0))
    terminated = False
    while not terminated:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
    ends[seed] = info["end"]
    toughest[seed] = env.unwrapped.specimen.fracture_resistance[120:190].max()  # 60 to 95 mm [J/m2]; hidden
    force, blade = 5.0 * observation[0], 100.0 * observation[4]  # their scales are 5 N and 0.1 m
    print(f"specimen {seed}: {info['end']:10} {blade:.1f} mm, {force:+.2f} N, up to {toughest[seed]:.0f} J/m2")
env.close()

# Specimens 1 and 2 have a tough inclusion just before the target.  The force rises until the crack runs through it,
# and the run ends more than 5 mm beyond the target: an end of the task.  The rig itself was never stopped.
assert [seed for seed, end in ends.items() if end == "overshoot"] == [1, 2]
assert all(end == "finished" for seed, end in ends.items() if seed > 2)
assert min(toughest[1], toughest[2]) > 700 > max(toughest[seed] for seed in (3, 4, 5, 6))
assert info["rig"]["overruns"] == 0  # commands that came late: never, on a clock of its own
