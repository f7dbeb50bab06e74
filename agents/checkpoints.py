"""What an interrupted run goes on from, if there is anything."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

NAMES = ("checkpoint.zip", "checkpoint.safetensors")


def checkpoint_of(run: Path) -> Path | None:
    """The checkpoint of a run, if there is one; an unfinished one, which a kill leaves beside it, is none."""
    return next((run / name for name in NAMES if (run / name).is_file()), None)


def end_interrupted(run: Path, again: str) -> NoReturn:
    """Say how an interrupted run goes on, or that it does not, and end as programs do on Ctrl-C."""
    checkpoint = checkpoint_of(run)
    if checkpoint is not None:
        print(f"\ninterrupted; {checkpoint} is usable.\nGo on with: {again}")
    else:
        print(f"\ninterrupted before the first checkpoint: there is nothing to go on from. {run} may be deleted.")
    raise SystemExit(130)
