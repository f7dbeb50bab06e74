"""Jitter of a 1 kHz loop whose plant is solved again, in a second thread, as the cut opens."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cutenv.sim.plant import FreehandPlant, SteeredPlant
from cutenv.sim.tissue import Specimen, SteeredModel
from cutenv.sim.tissue.lines import straight
from scripts.benchmarks.speed.measured import Measured, Number, at_most

EMPTY, THREADED = "empty", "model in a second thread"  # names of loops
UPDATES = 8000  # milliseconds of each loop
ALLOWED = 20e-6  # largest delay of an update by the second thread, at the 99.9th percentile [s]
SWITCH_INTERVAL = 1e-5  # time after which Python lets the other thread go on [s]; its own default is 5 ms
_SPIN = 2e-4  # of each millisecond that is waited for awake [s]
_UPRIGHT = math.radians(90.0)


def _loop(update: Callable[[int], object], updates: int) -> NDArray[np.float64]:
    """Run an update every millisecond; return when each ended, after it was due [s]."""
    ended = np.zeros(updates)
    due = time.perf_counter()
    for k in range(updates):
        due = max(due + 1e-3, time.perf_counter())  # an update that came late delays no other
        time.sleep(max(due - time.perf_counter() - _SPIN, 0.0))
        while time.perf_counter() < due:
            pass
        update(k)
        ended[k] = time.perf_counter() - due
    return ended


def node_times(divisions: tuple[int, int]) -> NDArray[np.float64]:
    """Return the time of every node of a cut along the slab [s], with its stiffness."""
    model, times = SteeredModel(divisions), []
    model.begin()
    for k in range(1, divisions[1]):
        start = time.perf_counter()
        model.cut_to((0.15 * k / divisions[1], 0.01 * math.sin(3.0 * k / divisions[1])))
        _ = model.stiffness
        times.append(time.perf_counter() - start)
    return np.array(times)


def loops(updates: int = UPDATES) -> dict[str, NDArray[np.float64]]:
    """Return how long after it was due each update ended [s]: in an empty loop, on a table, and beside a model."""

    def of(plant: SteeredPlant) -> Callable[[int], object]:
        plant.advance(0.012, _UPRIGHT, 20)
        return lambda k: plant.advance(0.012, _UPRIGHT, 1, 0.3 * math.sin(k / 800))

    specimen, before = Specimen.drawn(3), sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        return {
            EMPTY: _loop(lambda k: None, updates),
            "stiffness from a table": _loop(of(SteeredPlant(specimen, straight())), updates),
            THREADED: _loop(of(FreehandPlant(specimen, background=True)), updates),
        }
    finally:
        sys.setswitchinterval(before)


def measure() -> Measured:
    """Measure a node of the model, and three loops of 1 kHz."""
    numbers: dict[str, Number] = {}
    lines = ["a node that the crack passes: solves, dense system and stiffness"]
    for divisions in ((16, 30), (32, 60)):
        times = 1e3 * node_times(divisions)
        size = f"{150 / divisions[1]:g} mm"
        numbers |= {f"freehand.node.{size}": Number(float(np.median(times)), "ms")}
        lines.append(f"  elements of {size}: {np.median(times):.1f} ms, at most {times.max():.1f} ms")
    lines += ["end of an update after it was due, in a loop of 1 kHz [us]", f"{'':26}{'p50':>8}{'p99':>8}{'p99.9':>8}"]
    late = {}
    for name, ended in loops().items():
        shown = 1e6 * np.percentile(ended, (50.0, 99.0, 99.9))
        lines.append(f"  {name:24}" + "".join(f"{value:8.0f}" for value in shown))
        late[name] = float(shown[2])
        numbers[f"freehand.{name}.p99.9"] = Number(late[name], "us")
    later = late[THREADED] - late[EMPTY]
    lines.append(at_most(f"{later:.0f} us later than an empty loop at p99.9", later, 1e6 * ALLOWED, "20 us"))
    if late[EMPTY] > 1e6 * ALLOWED:
        lines.append(f"  this machine cannot tell: its empty loop is {late[EMPTY]:.0f} us late at p99.9")
    return Measured(numbers, lines)
