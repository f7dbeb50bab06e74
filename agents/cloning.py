"""Behaviour cloning: teach a policy network what a script does, as the start of learning by trial.

The script acts with some noise, so that the clone learns how to come back from small mistakes; what it is taught is
what the script would have done.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from tqdm import tqdm
from vectorised import CutVecEnv

from cutenv.policy import Policy
from cutenv.task.observation import SPEED_SCALE

_REST = 1e-6 / SPEED_SCALE  # of an action's speed, below which it means rest


def before_dead_zone(actions: np.ndarray, width: float) -> np.ndarray:
    """The actions, shape (n, 2), that :func:`cutenv.policy.past_dead_zone` maps to ``actions``."""
    result = np.array(actions, np.float32)
    speed = result[:, 0]
    moved = np.copysign(np.abs(speed) * (1.0 - width) + width, speed)
    result[:, 0] = np.where(np.abs(speed) < _REST, 0.0, moved)
    return result


def demonstrations(
    environments: CutVecEnv, make_script: Callable[[], Policy], *, decisions: int, noise: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """What environments showed, shape (n, size), and what the script would do about it, shape (n, 2).

    ``decisions`` in all; ``noise`` is the standard deviation of what is added to half of the environments' actions.
    """
    rng = np.random.default_rng(seed)
    count = environments.num_envs
    scripts = [make_script() for _ in range(count)]
    for script in scripts:
        script.reset(rng)
    amount = np.where(np.arange(count) % 2, noise, 0.0)[:, None]
    seen = environments.reset()
    shown, taught = [], []
    for _ in tqdm(range(-(-decisions // count)), desc="demonstrating", unit="decision", unit_scale=count):
        wanted = np.stack([script(o) for script, o in zip(scripts, environments.observations, strict=True)])
        label = before_dead_zone(wanted, environments.dead_zone)
        shown.append(seen)
        taught.append(label)
        seen, _, dones, _ = environments.step(label + amount * rng.standard_normal(label.shape).astype(np.float32))
        for n in np.flatnonzero(dones):
            scripts[n].reset(rng)
    return np.concatenate(shown), np.concatenate(taught)


def clone(
    network: Callable[[torch.Tensor], torch.Tensor],
    parameters: list[torch.nn.Parameter],
    shown: np.ndarray,
    taught: np.ndarray,
    *,
    epochs: int = 30,
    batch_size: int = 1024,
    learning_rate: float = 2e-3,
    seed: int = 0,
) -> float:
    """Fit ``network`` to what was taught by least squares; return the root of the mean squared error."""
    generator = torch.Generator().manual_seed(seed)
    inputs, targets = torch.as_tensor(shown), torch.as_tensor(taught)
    steps = epochs * -(-len(inputs) // batch_size)
    optimizer = torch.optim.Adam(parameters, lr=learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in tqdm(range(epochs), desc="cloning", unit="epoch"):
        for batch in torch.randperm(len(inputs), generator=generator).split(batch_size):
            loss = ((network(inputs[batch]) - targets[batch]) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
    with torch.no_grad():
        return float(((network(inputs) - targets) ** 2).mean().sqrt())
