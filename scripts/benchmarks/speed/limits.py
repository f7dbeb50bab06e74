"""Limits of the batch: floating-point operations and memory of an update, compared with the abilities of a core."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._engine.jit import njit
from cutenv._engine.parallel import cores
from cutenv.sim.cutting.dtypes import DRIVE, LAW, STATE
from cutenv.sim.cutting.row import LANES
from cutenv.sim.cutting.sensor import SENSOR
from cutenv.task.info import INFO
from cutenv.task.observation import COMPONENTS
from cutenv.task.reward import PROGRESS, TASK
from scripts.benchmarks.speed.measured import Measured, Number, fastest


@njit
def _chain(count: int, x: float) -> float:
    for _ in range(count):
        x = x * 0.999999 + 1e-6
    return x


@njit
def _in_turn(count: int, values: StructArray) -> None:
    a, b, c, d, e, f = values[0], values[1], values[2], values[3], values[4], values[5]
    for _ in range(count):
        a, b, c = a * 0.999999 + 1e-6, b * 0.999999 + 1e-6, c * 0.999999 + 1e-6
        d, e, f = d * 0.999999 + 1e-6, e * 0.999999 + 1e-6, f * 0.999999 + 1e-6
    values[0] = a + b + c + d + e + f


@njit
def _row(count: int, values: StructArray) -> None:
    for _ in range(count):
        for n in range(LANES):
            values[n] = values[n] * 0.999999 + 1e-6


def operations_per_ns() -> tuple[float, float, float]:
    """Measure floating-point operations per nanosecond on one core: each waiting for the last, six in turn, in rows."""
    six: NDArray[np.float64] = np.ones(6)
    row: NDArray[np.float64] = np.ones(LANES)
    ways: list[tuple[int, int, Callable[[int], object]]] = [
        (2, 1_000_000, lambda count: _chain(count, 1.0)),
        (12, 1_000_000, lambda count: _in_turn(count, six)),
        (2 * LANES, 200_000, lambda count: _row(count, row)),
    ]
    rates = []
    for operations, count, way in ways:
        way(10)
        best = fastest({0: partial(way, count)}, 5)[0]
        rates.append(operations * count / best / 1e9)
    return rates[0], rates[1], rates[2]


def copy_rate() -> float:
    """Measure bytes per nanosecond read and written by a copy of 256 MB on one core."""
    source = np.ones(32 * 1024**2)
    target = np.empty_like(source)
    return 2 * source.nbytes / fastest({0: lambda: np.copyto(target, source)}, 4)[0] / 1e9


def bytes_per_step() -> int:
    """Return the number of bytes that a control step of one cut reads or writes, in whole cache lines of 64."""
    records = sum(kind.itemsize for kind in (STATE, LAW, DRIVE, TASK, PROGRESS)) + 2 * SENSOR.itemsize
    answers = INFO.itemsize + 4 * len(COMPONENTS) + 8 * 4
    profiles = 64 * (3 * 2 + 3 + 2)  # at the tip and at the blade; as expected; as told
    return -(-(records + answers) // 64) * 64 + profiles


def operations_per_update() -> dict[str, float]:
    """Count the floating-point operations of one update of a steady cut; see ``operations.py``."""
    done = subprocess.run(
        [sys.executable, "-P", str(Path(__file__).with_name("operations.py"))],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        check=True,
        capture_output=True,
        text=True,
    )
    return {name: float(value) for name, value in (line.split(": ") for line in done.stdout.splitlines())}


def limits(native: float, bare: float) -> Measured:
    """Compare the work per update, at ``native`` and ``bare`` control steps/s, with the abilities of a core."""
    operations = operations_per_update()
    total = sum(operations.values())
    update = 1e9 * cores() / bare / 20
    waiting, in_turn, in_rows = operations_per_ns()
    touched, copied = bytes_per_step(), copy_rate()
    listed = ", ".join(f"{value:.0f} {name}" for name, value in operations.items())
    nanoseconds = 1e9 * cores() / native
    lines = [
        "what limits it, per update and core",
        f"  {total:.0f} floating-point operations ({listed}) in the bare loop's {update:.0f} ns: "
        f"{total / update:.1f} a ns",
        f"  the core does {waiting:.1f} a ns if each waits for the last, {in_turn:.1f} a ns six in turn, "
        f"{in_rows:.1f} a ns in a row of {LANES}",
        f"  a step touches {touched} bytes: {touched / nanoseconds:.1f} a ns; a large copy moves {copied:.1f} a ns",
    ]
    numbers = {
        "operations of an update": Number(total, "1"),
        "operations of the core, each waiting": Number(waiting, "1/ns"),
        "operations of the core, six in turn": Number(in_turn, "1/ns"),
        "operations of the core, in a row": Number(in_rows, "1/ns"),
        "bytes of a step": Number(touched, "byte"),
        "bytes of a large copy": Number(copied, "byte/ns"),
    }
    return Measured(numbers, lines)
