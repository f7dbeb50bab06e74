"""Train PPO of Stable-Baselines3 on the native vector environment for a few seconds, and see the return rise."""

import sys

import numpy as np

try:
    import torch
    from stable_baselines3 import PPO

    from cutenv.agents.sb3 import NativeVecEnv
except ModuleNotFoundError as error:
    sys.exit(f"{error.name} is not installed: pip install 'cutenv[rl]'")

from cutenv.agents.sb3 import NativeVecEnv

torch.set_num_threads(1)  # two pools of threads get in each other's way
envs = NativeVecEnv(range(64), specimen_class="uniform", target_length=0.08, control_hz=10)


def mean_return(model: PPO) -> float:
    """Cut one specimen in each environment; return the mean sum of rewards."""
    observations, total, going_on = envs.reset(), np.zeros(64), np.ones(64, bool)
    while going_on.any():
        actions, _ = model.predict(observations, deterministic=True)
        observations, rewards, ended, _ = envs.step(actions)
        total += np.where(going_on, rewards, 0.0)
        going_on &= ~ended
    return float(total.mean())


model = PPO("MlpPolicy", envs, n_steps=64, batch_size=1024, n_epochs=10, gamma=1.0, learning_rate=1e-3, seed=0)
before = mean_return(model)
model.learn(100_000)
after = mean_return(model)
print(f"mean return before training {before:.2f}, after 100,000 decisions {after:.2f}")
assert after > before + 0.3
