"""Folder of a run: arguments, seeds, versions and commit in run.json, and the trained actor, which needs no torch."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium

from cutenv.learning.arguments import LearnerArguments
from cutenv.learning.run_provenance import origin, write_facts
from cutenv.learning.seeds import TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.policy import Network, RecurrentNetwork, save_policy

PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "stable-baselines3", "sb3-contrib", "torch")


def record_run(arguments: LearnerArguments, run: Path, agent: str) -> dict[str, Any]:
    """Make the run's folder and write run.json with everything that the run depends on; return its content.

    A run that is resumed keeps the versions and the commit of its start.
    """
    gymnasium.make(
        arguments.learned_task.id, **arguments.environment
    ).close()  # refuses nonsense before anything is made
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
        "environment": arguments.learned_task.id,
        "simulated_rig": arguments.simulated,
        "seeds": {name: [min(seeds), max(seeds)] for name, seeds in used.items() if seeds},
        **origin(run, PACKAGES),
    }
    write_facts(run, content)
    return content


def export(
    arguments: LearnerArguments, folder: Path, network: Network | RecurrentNetwork, facts: Mapping[str, Any]
) -> None:
    """Write an actor as policy.safetensors and card.json, which holds ``facts``."""
    save_policy(
        folder,
        network,
        environment=arguments.learned_task.id,
        environment_arguments={"control_hz": arguments.control_hz, **arguments.angle},
        features=arguments.features,
        **arguments.correction,
        training=facts,
        replace=True,
    )
