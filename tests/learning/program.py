"""An agent's program as a user runs it, small."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

AGENTS = Path(__file__).parents[2] / "agents"


def run(program: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run to its end."""
    command = [sys.executable, str(AGENTS / program), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)


def interrupted(program: str, folder: Path, checkpoint: str, *arguments: str) -> tuple[int, str]:
    """Run until there is a checkpoint, press Ctrl-C; its status and what it printed."""
    process = subprocess.Popen(
        [sys.executable, str(AGENTS / program), *arguments],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    deadline = time.monotonic() + 120.0
    while not list(folder.glob(f"runs/*/{checkpoint}")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=120)
    return process.returncode, printed
