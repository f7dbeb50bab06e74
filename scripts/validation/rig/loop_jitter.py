"""Jitter of a rig's loop beside a program that is busy: within its process, and in a spine of its own.

    python -m scripts.validation.rig.loop_jitter                  a minute each
    python -m scripts.validation.rig.loop_jitter --seconds 5

A driver in memory has the loop call it every millisecond; the jitter is the time from one call to the next beyond that.
An empty loop with the same priority runs beside it in a third process: what it shows is the machine's.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cutenv.rig.config.settings import Axis, RigSettings, SensorCalibration, SensorSettings
from cutenv.rig.devices import DriveState, ForceSample, Latch, MotionSample, Mounting, SystemClock, rig_driver
from cutenv.rig.devices.loop import prefer, preferred, undisturbed
from cutenv.rig.plant import rig_plant

PERIOD = 0.001  # period of the loop [s]
PERCENTILES = (50.0, 99.0, 99.9, 100.0)
ALLOWED = 0.3e-3  # greatest jitter that a spine should have at the 99.9th percentile, beyond the empty loop's [s]


class InMemory:
    """Device in memory that has the loop call it."""

    rate, rate_error, axes, latch = 1000.0, 0.2, "xyz", Latch()

    def __init__(self, mounting: Mounting) -> None:
        self.name, self.clock, self.number = mounting.role, mounting.clock, 0

    def open(self, listener: Any) -> None:
        """Report every millisecond."""
        self.timer = self.clock.every(PERIOD, lambda now: self.report(listener, now), self.name)

    def report(self, listener: Any, now: float) -> None:
        """Report what stands still."""

    def about(self) -> dict[str, float | str]:
        """Return nothing."""
        return {}

    def close(self) -> None:
        """End the reports."""
        self.timer.stop()


@rig_driver(emulated=lambda rig, role: True)
class Stage(InMemory):
    """Axis that stands."""

    def report(self, listener: Any, now: float) -> None:
        """Report a sample and a heartbeat."""
        listener.motion(self.name, MotionSample(now, 0.0, 0.0, 0.0, DriveState.DISABLED))
        listener.alive(self.name, now)

    def command(self, speed: float) -> None:
        """Take no command."""

    quick_stop = disable = lambda self, **named: None


@rig_driver(emulated=lambda rig, role: True)
class Balance(InMemory):
    """Sensor that nothing touches."""

    def report(self, listener: Any, now: float) -> None:
        """Report a reading."""
        self.number += 1
        listener.force(ForceSample(now, (0.0, 0.0, 0.0), (self.number % 2,) * 6, 0, self.number, 0))


class Calls:
    """Witness of the times at which the loop called."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Note the time of a sample."""
        self.times.append(sample.time)

    force = alive = lambda self, *what: None


def nothing(seconds: float) -> None:
    """Wait."""
    time.sleep(seconds)


def learning(seconds: float) -> None:
    """Learn: a network of three layers by gradient, forward and back, one batch after the other."""
    random, ends = np.random.default_rng(0), time.monotonic() + seconds
    weights = [random.normal(0.0, 0.05, (256, 256)) for _ in range(3)]
    while time.monotonic() < ends:
        layers = [random.normal(size=(256, 256))]
        for weight in weights:
            layers.append(np.tanh(layers[-1] @ weight))
        back = layers[-1] - 0.5
        for number in (2, 1, 0):
            back = back * (1.0 - layers[number + 1] ** 2)
            weights[number] -= 1e-6 * layers[number].T @ back
            back = back @ weights[number].T
        sum(float(x) for row in layers[-1][:32] for x in row)  # a reward in Python


def collecting(seconds: float) -> None:
    """Collect garbage among a million objects, again and again."""
    kept, ends = [[number] for number in range(1_000_000)], time.monotonic() + seconds
    while time.monotonic() < ends:
        gc.collect()
        time.sleep(0.02)
    del kept


def filming(seconds: float) -> None:
    """Wait beside a process that reads and filters pictures as fast as it can."""
    film = "np.random.default_rng(0).random((480, 640, 3))"
    code = f"import numpy as np\nwhile True:\n    film = {film}\n    (film[1:] - film[:-1]).std()"
    camera = subprocess.Popen([sys.executable, "-c", code])
    try:
        time.sleep(seconds)
    finally:
        camera.kill()
        camera.wait()


LOADS: dict[str, Callable[[float], None]] = {
    "nothing": nothing,
    "a policy that learns": learning,
    "collections of garbage": collecting,
    "a busy camera process": filming,
}


def settings() -> RigSettings:
    """Return the settings of a rig in memory."""
    return RigSettings(
        name="in memory",
        armed_by="nobody",
        angle_mode="fixed",
        blade=Axis(driver="scripts.validation.rig.loop_jitter:Stage"),
        angle=None,
        sensor=SensorSettings(driver="scripts.validation.rig.loop_jitter:Balance", rate=InMemory.rate),
        calibration=SensorCalibration(date="2026-01-01"),
        emulated=True,
    )


def beyond_period(times: list[float]) -> list[float]:
    """Return the percentiles of the time from call to call beyond the period, in us."""
    late = 1e6 * (np.diff(times) - PERIOD)
    return [float(value) for value in np.percentile(late, PERCENTILES)]


def measured(load: Callable[[float], None], seconds: float, *, apart: bool) -> tuple[list[float], list[float]]:
    """Return the percentiles of the rig's loop and of the empty one beside it, in us."""
    plant, calls = rig_plant(settings(), None if apart else SystemClock()), Calls()
    with undisturbed() if apart else preferred():
        plant.open()
        plant.witness = calls
        empty = subprocess.Popen(
            [sys.executable, "-m", "scripts.validation.rig.loop_jitter", "--empty", str(seconds)],
            stdout=subprocess.PIPE,
        )
        try:
            ends = time.monotonic() + seconds
            while (left := ends - time.monotonic()) > 0.0:
                load(min(left, 2.0))
                plant.clock.sleep_until(plant.clock.now())  # takes in what has come
        finally:
            plant.close()
            told, _ = empty.communicate(timeout=60.0)
    return beyond_period(calls.times), json.loads(told)


def empty_loop(seconds: float) -> None:
    """Print the percentiles of a loop that does nothing."""
    gc.disable()
    prefer(first_in=True)
    clock, times = SystemClock(), list[float]()
    turns = clock.every(PERIOD, times.append, "empty")
    time.sleep(seconds)
    turns.stop()
    print(json.dumps(beyond_period(times)))


def _may_prefer() -> bool:
    with preferred() as allowed:
        return allowed


def main() -> None:
    """Measure each load in both places, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, metavar="S", help="duration of each row; default 60")
    parser.add_argument("--empty", type=float, metavar="S", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.empty is not None:
        return empty_loop(arguments.empty)
    allowed = "yes" if _may_prefer() else "no"
    print(
        f"time from call to call of a loop of 1 ms, beyond that; {arguments.seconds:g} s each; {platform.machine()}, "
        f"{os.cpu_count()} cores, real-time priority: {allowed}\n"
    )
    heads = "p50", "p99", "p99.9", "max"
    units = " | ".join(f"{head} [us]" for head in heads)
    print(f"| beside the loop | where it runs | {units} | empty loop, p99.9 [us] |\n| {'--- | ' * 7}".rstrip())
    for name, load in LOADS.items():
        for where in ("in the program", "in the spine"):
            found, empty = measured(load, arguments.seconds, apart=where == "in the spine")
            shown = " | ".join(f"{value:.0f}" for value in found)
            print(f"| {name} | {where} | {shown} | {empty[2]:.0f} |", flush=True)


if __name__ == "__main__":
    main()
