"""What is kept of a run: arguments, seeds, versions, commit; and the trained actor as a folder that needs no torch."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
from arguments import AgentArguments
from evaluate import ENVIRONMENT, TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS

from cutenv.atomic import replacing
from cutenv.policy import Network, RecurrentNetwork, save_policy

PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "stable-baselines3", "sb3-contrib", "torch")


def versions() -> dict[str, str]:
    """Of Python and of every package that results depend on."""
    return {name: importlib.metadata.version(name) for name in PACKAGES} | {"python": platform.python_version()}


def git(*arguments: str) -> str | None:
    """What git says about the checkout that the agents lie in; None where there is none."""
    done = subprocess.run(
        ["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, check=False
    )  # fmt: skip
    return done.stdout.strip() if done.returncode == 0 else None


def record_run(arguments: AgentArguments, run: Path, agent: str) -> dict[str, Any]:
    """Make the run's folder and keep there what the run depends on."""
    gymnasium.make(ENVIRONMENT, **arguments.environment).close()  # refuses nonsense before anything is made
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
        "versions": versions(),
        "commit": git("rev-parse", "HEAD"),
        "uncommitted_changes": bool(git("status", "--porcelain", "--untracked-files=no")),
    }
    write_facts(run, content)
    return content


def write_facts(run: Path, facts: Mapping[str, Any]) -> None:
    """Write ``run.json``, all at once."""
    with replacing(run / "run.json") as part:
        part.write_text(json.dumps(facts, indent=1) + "\n")


def export(
    arguments: AgentArguments, folder: Path, network: Network | RecurrentNetwork, facts: Mapping[str, Any]
) -> None:
    """Write an actor as a folder that needs no torch: policy.safetensors and card.json, with ``facts``."""
    save_policy(
        folder,
        network,
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": arguments.control_hz, "angle_mode": arguments.angle_mode},
        features=arguments.features,
        dead_zone=arguments.dead_zone,
        training=facts,
        replace=True,
    )
