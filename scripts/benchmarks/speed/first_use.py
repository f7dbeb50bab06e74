"""Time from import to a step: at the first use on a machine, which compiles, and at the next, which loads the cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from scripts.benchmarks.speed.measured import Measured, Number, at_most

ALLOWED_S = 5.0  # largest acceptable time of the first use [s]: a few seconds
BATCH = 64
_MADE = {
    "one environment": "gymnasium.make('cutenv/GentleCut-v1')",
    f"a batch of {BATCH}": f"gymnasium.make_vec('cutenv/GentleCut-v1', num_envs={BATCH})",
}
_USE = """
import time
start = time.perf_counter()
import gymnasium, cutenv
env = {made}
env.reset(seed=0)
env.step(env.action_space.sample())
print(time.perf_counter() - start)
"""
_TRIFLE = """
import time
import numba
start = time.perf_counter()
numba.njit(lambda number: number + 1.0)(1.0)
print(time.perf_counter() - start)
"""
_LIMIT_S = 600.0


class FirstUse(NamedTuple):
    """Times from import to the end of the first step [s]."""

    first: float  # time with an empty cache on disk
    next: float  # time in the next process


def seconds(program: str, kept: Path) -> float:
    """Return the number on the last line that a program prints, run in a process with its kernel cache in ``kept``."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_CACHE_DIR": str(kept)},
        capture_output=True,
        text=True,
        timeout=_LIMIT_S,
        check=True,
    )
    return float(done.stdout.splitlines()[-1])


def first_uses() -> dict[str, FirstUse]:
    """Measure the first use of one environment and of a batch, each with an empty cache."""
    found = {}
    for name, made in _MADE.items():
        with tempfile.TemporaryDirectory() as kept:
            program = _USE.format(made=made)
            found[name] = FirstUse(seconds(program, Path(kept)), seconds(program, Path(kept)))
    return found


def trifle() -> float:
    """Measure the time that Numba takes to compile a function of one line [s]."""
    with tempfile.TemporaryDirectory() as kept:
        return seconds(_TRIFLE, Path(kept))


def measure() -> Measured:
    """Measure both, and compare with the time that Numba takes for a function of one line."""
    found, beside = first_uses(), trifle()
    lines = ["first use with nothing compiled yet, from import to the end of the first step, and the next process's"]
    numbers = {"a function of one line": Number(beside, "s")}
    for name, uses in found.items():
        said = f"{name}: {uses.first:.1f} s, {uses.first / beside:.0f} x a function of one line; next {uses.next:.1f} s"
        lines.append(at_most(said, uses.first, ALLOWED_S, f"{ALLOWED_S:g} s"))
        numbers[f"first use of {name}"] = Number(uses.first, "s")
        numbers[f"next use of {name}"] = Number(uses.next, "s")
    return Measured(numbers, lines)
