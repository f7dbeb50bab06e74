"""Provenance of a run: git commit and package versions at its start, and at each resume, in run.json."""

from __future__ import annotations

import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv.atomic import replacing


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Return the versions of these packages and of Python."""
    return {name: importlib.metadata.version(name) for name in packages} | {"python": platform.python_version()}


def git(*arguments: str) -> str | None:
    """Return the output of git about the checkout that contains the agents; None if there is none."""
    done = subprocess.run(
        ["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, check=False
    )  # fmt: skip
    return done.stdout.strip() if done.returncode == 0 else None


def origin(run: Path, packages: Sequence[str]) -> dict[str, Any]:
    """Return versions and commit for ``run.json``; for a resumed run, the first ones.

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
    """Return the commit of a run; it is marked if the checkout had uncommitted changes."""
    return f"{facts['commit']}{'+changes' if facts.get('uncommitted_changes') else ''}"


def write_facts(run: Path, facts: Mapping[str, Any]) -> None:
    """Write ``run.json`` atomically."""
    with replacing(run / "run.json") as part:
        part.write_text(json.dumps(facts, indent=1) + "\n")
