"""A small policy with random weights, what its card says, and ways to spoil both."""

from __future__ import annotations

import hashlib
import itertools
import json
from pathlib import Path

import numpy as np

from cutenv.agents.policy.actor_network import Network
from cutenv.agents.policy.features import Features
from cutenv.agents.policy.trained import CARD, WEIGHTS, TrainedPolicy
from cutenv.task.observation import COMPONENTS

FEATURES = {"history": 2}
SIZE = Features(**FEATURES).size
ABOUT = {
    "environment": "cutenv/GentleCut-v1",
    "environment_arguments": {"control_hz": 10, "angle_mode": "free"},
    "features": FEATURES,
    "training": {"seed": 3, "decisions": 1_500_000, "versions": {"numpy": np.__version__}, "return": 0.1},
}


def network(seed: int = 0, sizes: tuple[int, ...] = (SIZE, 8, 6, 2), activation: str = "tanh") -> Network:
    rng = np.random.default_rng(seed)
    layers = tuple(
        (rng.normal(size=(after, before)).astype(np.float32), rng.normal(size=after).astype(np.float32))
        for before, after in itertools.pairwise(sizes)
    )
    return Network(layers, activation)


def observations(number: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (number, len(COMPONENTS))).astype(np.float32)


def actions(policy: TrainedPolicy, seen: np.ndarray) -> np.ndarray:
    policy.reset(np.random.default_rng(0))
    return np.stack([policy(observation) for observation in seen])


def change_card(folder: Path, **changes) -> None:
    """Change fields of a card behind the package's back; None removes one."""
    content = json.loads((folder / CARD).read_text()) | changes
    kept = {name: value for name, value in content.items() if value is not None}
    (folder / CARD).write_text(json.dumps(kept))


def swap_weights(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Put other weights there, with their hash in the card."""
    from safetensors.numpy import save

    content = save(arrays)
    (folder / WEIGHTS).write_bytes(content)
    change_card(folder, sha256=hashlib.sha256(content).hexdigest())
