"""A command of cutenv, or a program of the checkout, as a user runs it."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import re
import runpy
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any
from unittest import mock

from cutenv.commands import cli

ROOT = Path(__file__).parents[3]
COMMON = ("--name", "small", "--environments", "4", "--validations", "2", "--validation-specimens", "4")
TRIAL = (*COMMON, "--rollout", "64", "--batch-size", "64")
OFF_POLICY = (
    *COMMON, "--demonstrations", "800", "--timesteps", "600", "--gradient-steps", "4", "--batch-size", "32",
    "--specimens", "0", "--critic-first", "0", "--hidden", "16", "--critic-hidden", "16",
)  # fmt: skip
SMALL = {
    "ppo": (*TRIAL, "--specimens", "2", "--demonstrations", "2000", "--timesteps", "1024", "--tensorboard"),
    "recurrent-ppo": (
        *TRIAL, "--specimens", "0", "--demonstrations", "1000", "--timesteps", "2048", "--epochs", "2",
        "--cloning-epochs", "1", "--critic", "features", "--tensorboard",
    ),
    **dict.fromkeys(("sac", "tqc", "crossq"), OFF_POLICY),
    "bc": (*COMMON, "--specimens", "0", "--demonstrations", "1000", "--epochs", "4", "--tensorboard"),
    "iql": (*COMMON, "--specimens", "0", "--demonstrations", "800", "--epochs", "4", "--hidden", "8", "--history", "0"),
}  # fmt: skip
"""Options of a small run of each learner."""


def command(program: str) -> list[str]:
    """``train --learner bc`` is a command of cutenv; ``agents/ppo.py`` a program of the checkout."""
    called = [str(ROOT / program)] if program.endswith(".py") else ["-m", "cutenv", *program.split()]
    return [sys.executable, *called]


def run_afresh(program: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run to its end in a process of its own, as a user's shell does."""
    line = [*command(program), *arguments]
    return subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False, timeout=300)


def run(program: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run to its end in this process, which has the learners loaded."""
    out, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(errors),
        mock.patch.object(sys, "argv", [program, *arguments]),
    ):
        try:
            if program.endswith(".py"):
                runpy.run_path(str(ROOT / program), run_name="__main__")
                status: Any = 0
            else:
                status = cli.main([*program.split(), *arguments])
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int | None) else 1
            print("" if isinstance(ended.code, int | None) else ended.code, file=errors)
        except Exception:
            traceback.print_exc()
            status = 1
    return subprocess.CompletedProcess([*command(program), *arguments], status or 0, out.getvalue(), errors.getvalue())


def interrupted_at(program: str, folder: Path, pattern: str, *arguments: str) -> tuple[int, str, str]:
    """Run until its progress bar shows a pattern, press Ctrl-C; its status, what it printed, and its errors."""
    process = subprocess.Popen(
        [*command(program), *arguments],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert process.stderr is not None
    shown = ""
    deadline = time.monotonic() + 600.0  # on a busy machine the first checkpoint may take minutes
    while not re.search(pattern, shown[-200:]) and process.poll() is None and time.monotonic() < deadline:
        shown += process.stderr.read(1)
    printed, errors = ctrl_c(process)
    return process.returncode, printed, shown + errors


def ctrl_c(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Press Ctrl-C as a person does, again if nothing comes of it; what was printed, and errors."""
    for _ in range(4):
        process.send_signal(signal.SIGINT)
        try:
            return process.communicate(timeout=30)
        except subprocess.TimeoutExpired:  # the press met a place from which no exception gets out
            continue
    process.kill()
    raise AssertionError(f"{process.args} does not end on Ctrl-C: {process.communicate()}")


def assert_training_goes_on(program: str, folder: Path, algorithm: Any, rollout: int) -> None:
    """Resume ``runs/small`` for six rollouts: decisions, seconds and curve go on, and the actor learns.

    Six of 64 decisions of each environment: a cut ends after 300 at the latest, and then the curve has a point.
    """
    run_folder = folder / "runs" / "small"
    before = algorithm.load(run_folder / "checkpoint.zip", device="cpu")
    curve = _points(run_folder)
    wanted = before.num_timesteps + 6 * rollout
    done = run(program, folder, "--resume", "runs/small", "--timesteps", str(wanted))
    assert done.returncode == 0, done.stderr
    assert f"resuming after {before.num_timesteps} decisions" in done.stdout
    after = algorithm.load(run_folder / "checkpoint.zip", device="cpu")
    assert after.num_timesteps >= wanted
    assert any(
        (one != other).any()
        for one, other in zip(before.policy.actor_parameters(), after.policy.actor_parameters(), strict=True)
    )
    kept = [point for point in curve if point["decisions"] <= before.num_timesteps]
    longer = _points(run_folder)
    assert len(longer) > len(kept)
    assert [point["seconds"] for point in longer[: len(kept)]] == [point["seconds"] for point in kept]
    for name in ("decisions", "seconds"):
        values = [point[name] for point in longer]
        assert values == sorted(values), name
    assert longer[len(kept)]["decisions"] > before.num_timesteps
    assert longer[len(kept)]["seconds"] >= before.checkpoint_extras["seconds"] - 0.1  # rounded


def rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file; none where there is no file."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def _points(run_folder: Path) -> list[dict[str, float]]:
    curve = rows(run_folder / "learning_curve.csv")
    return [{name: float(row[name]) for name in ("decisions", "seconds")} for row in curve]
