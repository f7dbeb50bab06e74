"""Files of a run: arguments, seeds, versions, commit; and the trained actor as a folder that needs no torch."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
from arguments import AgentArguments
from evaluate import ENVIRONMENT, TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from provenance import origin, write_facts

from cutenv.policy import Network, RecurrentNetwork, save_policy

PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "stable-baselines3", "sb3-contrib", "torch")


def record_run(arguments: AgentArguments, run: Path, agent: str) -> dict[str, Any]:
    """Create the run's folder and store its arguments; for a resumed run, also where it resumed."""
    gymnasium.make(ENVIRONMENT, **arguments.environment).close()  # raises for invalid arguments before anything is made
    ranges = {"training": TRAINING_SEEDS, "validation": VALIDATION_SEEDS, "test": TEST_SEEDS}
    used = {
        "training": arguments.training_seeds,
        "validation": arguments.validation_seeds,
        "test": TEST_SEEDS[: arguments.specimens],
    }
    for name, seeds in used.items():
        assert all(seed in ranges[name] for seed in (*seeds[:1], *seeds[-1:])), f"seeds of {name} leave their range"
    assert TRAINING_SEEDS.stop <= VALIDATION_SEEDS.start < VALIDATION_SEEDS.stop <= TEST_SEEDS.start
    run.mkdir(parents=True, exist_ok=True)
    content = {
        "agent": agent,
        "arguments": dataclasses.asdict(arguments),
        "environment": ENVIRONMENT,
        "seeds": {name: [min(seeds), max(seeds)] for name, seeds in used.items() if seeds},
        **origin(run, PACKAGES),
    }
    write_facts(run, content)
    return content


def export(
    arguments: AgentArguments, folder: Path, network: Network | RecurrentNetwork, facts: Mapping[str, Any]
) -> None:
    """Write an actor as a folder that needs no torch: policy.safetensors and card.json, with ``facts``."""
    save_policy(
        folder,
        network,
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": arguments.control_hz, **arguments.angle},
        features=arguments.features,
        dead_zone=arguments.dead_zone,
        training=facts,
        replace=True,
    )
