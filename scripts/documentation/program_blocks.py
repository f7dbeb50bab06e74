"""Blocks of pages that are what a program prints, in a process of its own: no threads yet, nothing loaded."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from scripts import ROOT


def printed(program: str, *arguments: str) -> str:
    """Return what a module of the checkout prints."""
    command = [sys.executable, "-m", program, *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout.strip()


def fenced(program: str, *arguments: str) -> str:
    """Return what a program prints, as a block of code."""
    return f"```\n{printed(program, *arguments)}\n```"


def agreement() -> str:
    """Return the thesis's numbers and those of independent calculations next to ours."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "agreement.md"
        printed("scripts.validation.thesis.reproduce_thesis", "--out", folder, "--markdown", str(table))
        return table.read_text(encoding="utf-8").strip()


def calibration() -> str:
    """Return the comparison of calibrated values and true values that the virtual rig's calibration ends with."""
    compared = printed("scripts.validation.measurement.calibrate_virtual_rig").partition(
        "4. Compared with the true values:\n"
    )[2]
    return "```\n" + compared.strip("\n") + "\n```"
