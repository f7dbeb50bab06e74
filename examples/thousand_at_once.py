"""Step 1024 environments in one call, and find that each is what a single environment would be."""

import time

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.task.observation import to_action

envs = gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=1024, autoreset_mode="SameStep")
env = gymnasium.make("cutenv/GentleCut-v1")
observations, _ = envs.reset(seed=0)  # environment i has seed i
single, _ = env.reset(seed=7)
assert np.array_equal(observations[7], single)

action = to_action(0.01, np.radians(45.0))
actions = np.tile(action, (1024, 1))
envs.step(actions)  # compiles at the first use
env.step(action)
start = time.perf_counter()
for _ in range(100):  # two seconds of cutting
    observations, rewards, terminated, truncated, infos = envs.step(actions)
elapsed = time.perf_counter() - start
for _ in range(100):
    single, reward, *_ = env.step(action)

print(f"{102_400 / elapsed / 1e6:.1f} million steps a second")
print(
    f"blades at {infos['truth']['blade_m'].mean() * 1e3:.1f} mm, tips at {infos['truth']['tip_m'].mean() * 1e3:.1f} mm"
)
assert np.array_equal(observations[7], single)  # bit for bit
assert rewards[7] == reward
assert np.all(infos["truth"]["tip_m"] <= infos["truth"]["blade_m"])
