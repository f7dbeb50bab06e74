"""Checkpoints of training runs, from which an interrupted run is resumed."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

NAMES = ("checkpoint.zip", "checkpoint.safetensors")
"""File names of checkpoints, of Stable-Baselines3 and of behaviour cloning."""


def checkpoint_of(run: Path) -> Path | None:
    """Return the checkpoint of a run, or None; the unfinished file that a killed program leaves is no checkpoint."""
    return next((run / name for name in NAMES if (run / name).is_file()), None)


def end_interrupted(run: Path, resume_command: str) -> NoReturn:
    """Print how to resume an interrupted run, or that it has no checkpoint, and exit with the status of Ctrl-C."""
    checkpoint = checkpoint_of(run)
    if checkpoint is not None:
        print(f"\ninterrupted; {checkpoint} is usable.\nResume with: {resume_command}")
    else:
        print(f"\ninterrupted before the first checkpoint: there is nothing to resume. {run} may be deleted.")
    raise SystemExit(130)
