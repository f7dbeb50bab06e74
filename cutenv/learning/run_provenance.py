"""Provenance of a run, kept in run.json: commit and versions at its start, and the commits it was resumed at."""

from __future__ import annotations

import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cutenv
from cutenv._base.atomic_file import atomic_write

_CHECKOUT = Path(cutenv.__file__).parents[1]


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
