"""Time to read records, compared with numpy.loadtxt of the same file, which only converts text to numbers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.records import load, save
from cutenv.sim.trace import Trace
from scripts.benchmarks.speed.measured import Measured, Number, at_most, fastest

TIMES_LOADTXT = 3.0  # largest acceptable time of reading, in times of numpy.loadtxt
READINGS, CUTS = 30_000, 4  # readings of one cut, 30 s at 1 kHz; and number of cuts in the file
_ROUNDS = 5


def cuts(readings: int = READINGS, count: int = CUTS) -> list[Trace]:
    """Make cuts with every field, of numbers that need all their digits."""
    rng = np.random.default_rng(0)
    time_s = np.arange(readings, dtype=np.float64) * 1e-3
    return [
        Trace(
            time=time_s,
            force=rng.normal(3.0, 1.0, readings),
            position=3e-3 * time_s + rng.normal(0.0, 1e-5, readings),
            speed=rng.normal(3e-3, 1e-4, readings),
            angle=rng.uniform(0.8, 1.5, readings),
            depth=rng.uniform(0.01, 0.02, readings),
            metadata={"rig": "bench 2", "trial": number},
        )
        for number in range(count)
    ]


def reading_times(traces: list[Trace], rounds: int = _ROUNDS) -> dict[str, float]:
    """Measure the time to read cuts [s]: each format, and CSV by numpy.loadtxt; the best of interleaved rounds."""
    with tempfile.TemporaryDirectory() as folder:
        paths = {suffix: Path(folder) / f"cuts{suffix}" for suffix in (".csv", ".parquet", ".h5")}
        for path in paths.values():
            save(traces, path)
        text = paths[".csv"].read_text(encoding="ascii").splitlines()
        headers = next(number for number, line in enumerate(text) if not line.startswith("#"))
        readers: dict[str, Callable[[], Any]] = {
            "numpy.loadtxt": lambda: np.loadtxt(paths[".csv"], delimiter=",", skiprows=headers + 1)
        }
        for suffix, path in paths.items():
            readers[suffix] = lambda path=path: load(path)  # type: ignore[misc]
        return fastest(readers, rounds)


def measure() -> Measured:
    """Measure the times, and compare them with the largest acceptable one."""
    traces = cuts()
    seconds = reading_times(traces)
    least = seconds["numpy.loadtxt"]
    lines = [
        f"reading {len(traces)} cuts of {len(traces[0])} readings, 6 numbers each",
        f"  numpy.loadtxt of the CSV file: {1e3 * least:.0f} ms",
    ]
    numbers = {"loadtxt": Number(1e3 * least, "ms")}
    for suffix in (".csv", ".parquet", ".h5"):
        ratio = seconds[suffix] / least
        numbers[f"over_loadtxt_{suffix[1:]}"] = Number(ratio, "1")
        what = f"{suffix}: {1e3 * seconds[suffix]:.0f} ms, {ratio:.2f} of it"
        lines.append(at_most(what, ratio, TIMES_LOADTXT, f"{TIMES_LOADTXT:g}"))
    return Measured(numbers, lines)
