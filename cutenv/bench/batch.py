"""The native vector environment beside its own bare loop, beside Gymnasium's SyncVectorEnv, and beside the machine."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

import cutenv  # noqa: F401  registers the environment
from cutenv.compiled import compiled, compiled_for_cores
from cutenv.cores import cores, over_cores
from cutenv.cutting.drive import made_up
from cutenv.cutting.records import DRIVE, LAW, READING, STATE, TICK, Records
from cutenv.cutting.sensor import SENSOR
from cutenv.cutting.simulate import update
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.cuts import Cuts
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, SPEED_SCALE
from cutenv.task.records import PROGRESS, TASK
from cutenv.task.told import TOLD

SHARE_OF_BARE = 0.80
"""Of the bare loop's rate that the environment must reach at :data:`MANY`."""
TIMES_PENDULUM = 50.0
"""Required over SyncVectorEnv of Pendulum-v1 at :data:`SOME`."""
RESETS_IN_STEPS = 100.0
"""Steps of the batch that resetting all of it may cost."""
STRETCH = 2e6
"""Control steps a second aimed at on two cores."""
SOME, MANY = 1024, 4096
_ACTION = (0.4, -1.0)  # a steady cut at 1 cm/s and 45 degrees
_WARM_UP, _STEPS, _ROUNDS = 25, 25, 7


class Rates(NamedTuple):
    """Control steps per second; the best of interleaved rounds."""

    native: float
    bare: float
    resets: float
    """Environments begun per second."""


@compiled_for_cores
def _bare(first: int, last: int, cuts: Cuts, ticks: int, speed: float, angle: float) -> None:
    """Nothing but the updates: no assessment, no observation, no info, no ends."""
    readings = np.empty(ticks, READING)
    for n in range(first, last):
        state, sensor, drive, law, profile = (
            cuts.states[n],
            cuts.sensors[n],
            cuts.drives[n],
            cuts.laws[n],
            cuts.profiles[n],
        )
        share = made_up(drive, TICK)
        for i in range(ticks):
            update(state, profile, law, drive, sensor, share, speed, angle, TICK, readings[i])


def rates(count: int, rounds: int = _ROUNDS) -> Rates:
    """Measure ``count`` environments; each round begins them anew and cuts on from the same place."""
    env = GentleCutVectorEnv(count)
    actions = np.tile(np.array(_ACTION, np.float32), (count, 1))
    speed, angle = SPEED_SCALE * _ACTION[0], ANGLE_CENTRE + ANGLE_SCALE * _ACTION[1]
    best = [np.inf, np.inf, np.inf]
    for _ in range(rounds + 1):  # the first one warms up
        start = time.perf_counter()
        env.reset(seed=0)
        best[2] = min(best[2], time.perf_counter() - start)
        for _ in range(_WARM_UP):
            env.step(actions)
        alone = Cuts(*(part.copy() for part in env.cuts))
        best[0] = min(best[0], _seconds(lambda: env.step(actions)))
        best[1] = min(
            best[1],
            _seconds(lambda: over_cores(_bare, count, alone, env.single.ticks, speed, angle)),  # noqa: B023
        )
    return Rates(count / best[0], count / best[1], count / best[2])


def _seconds(step: Callable[[], Any]) -> float:
    start = time.perf_counter()
    for _ in range(_STEPS):
        step()
    return (time.perf_counter() - start) / _STEPS


def pendulum_rate(count: int = SOME, rounds: int = 3) -> float:
    """Environment steps per second of SyncVectorEnv of Pendulum-v1."""
    env = gymnasium.make_vec("Pendulum-v1", num_envs=count, vectorization_mode="sync")
    env.reset(seed=0)
    actions = np.zeros((count, 1), np.float32)
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(5):
            env.step(actions)
        best = min(best, (time.perf_counter() - start) / 5)
    env.close()
    return count / best


@compiled
def _chain(count: int, x: float) -> float:
    for _ in range(count):
        x = x * 0.999999 + 1e-6
    return x


@compiled
def _abreast(count: int, values: Records) -> None:
    a, b, c, d, e, f = values[0], values[1], values[2], values[3], values[4], values[5]
    for _ in range(count):
        a, b, c = a * 0.999999 + 1e-6, b * 0.999999 + 1e-6, c * 0.999999 + 1e-6
        d, e, f = d * 0.999999 + 1e-6, e * 0.999999 + 1e-6, f * 0.999999 + 1e-6
    values[0] = a + b + c + d + e + f


def operations_per_ns() -> tuple[float, float]:
    """Floating-point operations a nanosecond on one core: each waiting for the last, and six abreast."""
    values: NDArray[np.float64] = np.ones(6)
    _chain(10, 1.0)
    _abreast(10, values)
    count, best = 1_000_000, [np.inf, np.inf]
    for _ in range(5):
        start = time.perf_counter()
        _chain(count, 1.0)
        middle = time.perf_counter()
        _abreast(count, values)
        best = [min(best[0], middle - start), min(best[1], time.perf_counter() - middle)]
    return 2 * count / best[0] / 1e9, 12 * count / best[1] / 1e9


def copy_rate() -> float:
    """Bytes a nanosecond read and written by a copy of 256 MB on one core."""
    source = np.ones(32 * 1024**2)
    target = np.empty_like(source)
    best = np.inf
    for _ in range(4):
        start = time.perf_counter()
        np.copyto(target, source)
        best = min(best, time.perf_counter() - start)
    return 2 * source.nbytes / best / 1e9


def bytes_per_step() -> int:
    """Of the memory that a control step of one cut reads or writes, in whole cache lines of 64 bytes."""
    records = sum(kind.itemsize for kind in (STATE, LAW, DRIVE, TASK, PROGRESS)) + 2 * SENSOR.itemsize
    answers = 8 * TOLD + 4 * len(COMPONENTS) + 8 * 4
    profiles = 64 * (3 * 2 + 3 + 2)  # at the tip and at the blade; as expected; as told
    return -(-(records + answers) // 64) * 64 + profiles


def operations_per_update() -> dict[str, float]:
    """Floating-point operations of one update of a steady cut; see :mod:`cutenv.bench.operations`."""
    done = subprocess.run(
        [sys.executable, "-m", "cutenv.bench.operations"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        check=True,
        capture_output=True,
        text=True,
    )
    return {name: float(value) for name, value in (line.split(": ") for line in done.stdout.splitlines())}


def print_report() -> None:
    """Print rates, what is required of them, and what limits them."""
    print(f"native vector environment on {cores()} cores, control steps of 20 force updates")
    found = {count: rates(count) for count in (SOME, MANY)}
    for count, rate in found.items():
        nanoseconds = 1e9 * cores() / rate.native / 20
        print(
            f"  {count:5d} environments: {rate.native / 1e6:.2f} million steps/s, {20 * rate.native / 1e6:.0f} million "
            f"updates/s, {nanoseconds:.0f} ns an update and core; {rate.native / rate.bare:.2f} of the bare loop"
        )
    many, some = found[MANY], found[SOME]
    _verdict(f"{many.native / many.bare:.2f} of the bare loop at {MANY}", many.native / many.bare, SHARE_OF_BARE)
    pendulum = pendulum_rate()
    _verdict(
        f"{some.native / pendulum:.0f} times SyncVectorEnv of Pendulum-v1 at {SOME} ({pendulum / 1e3:.0f} thousand/s)",
        some.native / pendulum,
        TIMES_PENDULUM,
    )
    _verdict(f"{many.native / 1e6:.2f} million steps/s", many.native / 1e6, STRETCH / 1e6)
    in_steps = many.native / many.resets
    print(
        f"  resetting {MANY}: {1e3 * MANY / many.resets:.0f} ms, as much as {in_steps:.1f} steps of the batch; "
        f"{'within' if in_steps <= RESETS_IN_STEPS else 'MISSED:'} the {RESETS_IN_STEPS:g} allowed"
    )
    _print_limit(many)


def _verdict(what: str, value: float, required: float) -> None:
    print(f"  {what}: {'at least' if value >= required else 'MISSED:'} {required:g} required")


def _print_limit(rate: Rates) -> None:
    operations = operations_per_update()
    total = sum(operations.values())
    bare = 1e9 * cores() / rate.bare / 20
    waiting, abreast = operations_per_ns()
    touched, copied = bytes_per_step(), copy_rate()
    print("what limits it, per update and core")
    listed = ", ".join(f"{value:.0f} {name}" for name, value in operations.items())
    print(
        f"  {total:.0f} floating-point operations ({listed}) in the bare loop's {bare:.0f} ns: {total / bare:.1f} a ns"
    )
    print(f"  the core does {waiting:.1f} a ns if each waits for the last, {abreast:.1f} a ns six abreast")
    nanoseconds = 1e9 * cores() / rate.native
    print(f"  a step touches {touched} bytes: {touched / nanoseconds:.1f} a ns; a large copy moves {copied:.1f} a ns")
