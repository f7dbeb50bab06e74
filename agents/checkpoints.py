"""Checkpoint from which an interrupted run resumes, if there is one."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

NAMES = ("checkpoint.zip", "checkpoint.safetensors")


def checkpoint_of(run: Path) -> Path | None:
    """Return the checkpoint of a run, if there is one; an unfinished file beside it, left by a kill, does not count."""
    return next((run / name for name in NAMES if (run / name).is_file()), None)


def end_interrupted(run: Path, again: str) -> NoReturn:
    """Print how an interrupted run is resumed, or that it cannot be, and exit like a program on Ctrl-C."""
    checkpoint = checkpoint_of(run)
    if checkpoint is not None:
        print(f"\ninterrupted; {checkpoint} is usable.\nGo on with: {again}")
    else:
        print(f"\ninterrupted before the first checkpoint: there is nothing to go on from. {run} may be deleted.")
    raise SystemExit(130)
