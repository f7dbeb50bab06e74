"""Folder of a run: arguments, seeds, versions and commits in run.json, and the trained actor, which needs no torch."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium

import cutenv
from cutenv._base.atomic_file import atomic_write
from cutenv.learning.arguments import LearnerArguments
from cutenv.learning.seeds import TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.policy import Network, RecurrentNetwork, save_policy

_CHECKOUT = Path(cutenv.__file__).parents[1]
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


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Return the versions of these packages and of Python."""
    return {name: importlib.metadata.version(name) for name in packages} | {"python": platform.python_version()}


def git(*arguments: str) -> str | None:
    """Return what git prints about the checkout that this package is part of; None if it is installed elsewhere."""
    if not (_CHECKOUT / "pyproject.toml").is_file():  # in site-packages: a repository around it is somebody else's
        return None
    done = subprocess.run(["git", *arguments], cwd=_CHECKOUT, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def origin(run: Path, packages: Sequence[str]) -> dict[str, Any]:
    """Return versions and commit for ``run.json``: those at its start, where the run is resumed.

    Commits that differ from the first are listed as ``resumed_at_commits``, each formatted by :func:`marked`.
    """
    present = {
        "versions": versions(packages),
        "commit": git("rev-parse", "HEAD"),
        "uncommitted_changes": bool(git("status", "--porcelain", "--untracked-files=no")),
    }
    path = run / "run.json"
    if not path.is_file():
        return present
    kept = json.loads(path.read_text())
    first = {name: kept.get(name, value) for name, value in present.items()}
    later = list(kept.get("resumed_at_commits", ()))
    if marked(present) not in (marked(first), *later):
        later.append(marked(present))
    return first | ({"resumed_at_commits": later} if later else {})


def marked(facts: Mapping[str, Any]) -> str:
    """Return the commit of a run, with a mark if there were uncommitted changes."""
    return f"{facts['commit']}{'+changes' if facts.get('uncommitted_changes') else ''}"


def write_facts(run: Path, facts: Mapping[str, Any]) -> None:
    """Write ``run.json`` atomically."""
    with atomic_write(run / "run.json") as part:
        part.write_text(json.dumps(facts, indent=1) + "\n")
