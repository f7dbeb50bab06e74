"""Time of one 1 kHz update through the plant interface, compared with an empty loop that calls the clock as often."""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from numpy.typing import NDArray

from cutenv.sim.plant import Plant, SimulatedPlant
from cutenv.sim.tissue import Specimen
from scripts.benchmarks.speed.measured import Measured, Number, at_most

ALLOWED_NS = 20_000.0  # largest acceptable delay of 99.9 % of the updates over the empty loop [ns]
_UPDATES = 20_000
_EDGES = np.array([0, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, np.inf])
_PERCENTILES = (50.0, 99.0, 99.9, 100.0)

Nanoseconds = NDArray[np.int64]


def durations(updates: int = _UPDATES) -> tuple[Nanoseconds, Nanoseconds, int]:
    """Measure an update and an empty loop [ns], shape (updates,) each, and the memory blocks left at the end.

    The two take turns, so that other load on the machine affects both.
    """
    plant: Plant = SimulatedPlant(Specimen.mean())
    clock, angle = time.perf_counter_ns, math.radians(45.0)
    own, empty = np.zeros(updates, np.int64), np.zeros(updates, np.int64)
    for _ in range(100):
        plant.advance(0.005, angle, 1)
    blocks = sys.getallocatedblocks()
    for i in range(updates):
        start = clock()
        plant.advance(0.005, angle, 1)
        end = clock()
        own[i] = end - start
        start = clock()
        end = clock()
        empty[i] = end - start
    return own, empty, sys.getallocatedblocks() - blocks


def measure() -> Measured:
    """Measure both; return histograms, percentiles and the verdict."""
    own, empty, blocks = durations()
    numbers: dict[str, Number] = {}
    lines = [f"one 1 kHz update through the plant interface, {len(own)} of them, beside an empty loop; counts"]
    lines.append("  from [us]    update     empty")
    for low, a, b in zip(_EDGES, _histogram(own), _histogram(empty), strict=False):
        lines.append(f"  {low / 1e3:9.1f} {a:9d} {b:9d}")
    for percent in _PERCENTILES:
        a, b = np.percentile(own, percent) / 1e3, np.percentile(empty, percent) / 1e3
        name = "slowest" if percent == 100.0 else f"p{percent:g}"
        lines.append(f"  {name:>9s} {a:9.2f} {b:9.2f} us")
        numbers |= {f"update, {name}": Number(float(a), "us"), f"empty, {name}": Number(float(b), "us")}
    apart = float(np.percentile(own, 99.9) - np.percentile(empty, 99.9))
    numbers["99.9 % apart"] = Number(apart / 1e3, "us")
    numbers["memory blocks left behind"] = Number(blocks, "1")
    within = f"99.9 % are within {apart / 1e3:.1f} us of the empty loop's"
    lines.append(at_most(within, apart, ALLOWED_NS, f"{ALLOWED_NS / 1e3:g} us"))
    lines.append(f"  memory blocks left behind by {len(own)} updates: {blocks}")
    return Measured(numbers, lines)


def _histogram(values: Nanoseconds) -> NDArray[np.int64]:
    return np.histogram(values, _EDGES)[0]
