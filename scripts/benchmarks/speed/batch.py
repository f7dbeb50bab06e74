"""Speed of the native vector environment, compared with its own bare loop and Gymnasium's vector environments."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import cutenv  # noqa: F401  registers the environment
from cutenv._base.arrays import StructArray
from cutenv._engine.intrinsics import first_row
from cutenv._engine.jit import njit_nogil
from cutenv._engine.parallel import WorkQueue, cores, mark_done, next_chunk, parallel_for
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.sim.cutting.motion import STRAIGHT, Moving
from cutenv.sim.cutting.row import ONE, begin, lane_views, plain_views, put, take
from cutenv.sim.cutting.simulate import Physics, hold_some
from cutenv.sim.cutting.update import update_row
from cutenv.task.declare import Cuts
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, commanded_speed
from scripts.benchmarks.speed.gymnasium_vectors import ASYNC, NATIVE, SYNC, Other, step_rate
from scripts.benchmarks.speed.limits import limits
from scripts.benchmarks.speed.measured import Measured, Number, at_least, at_most

SHARE_OF_BARE = 0.80  # share of the bare loop's rate that the environment must reach at MANY
TIMES_PENDULUM = 50.0  # required speed-up over SyncVectorEnv of Pendulum-v1 at SOME
RESETS_IN_STEPS = 100.0  # largest acceptable time of resetting the whole batch, in steps of the batch
STRETCH = 2e6  # target on two cores [control steps/s]
SOME, MANY = 1024, 4096
COUNTS = (1, 16, 256, SOME, MANY, 65_536)
_ACTION = (0.4, -1.0)  # a steady cut at 1 cm/s and 45 degrees
_WARM_UP, _STEPS = 25, 25


class Rates(NamedTuple):
    """Control steps per second; the best of interleaved rounds."""

    native: float
    bare: float  # rate of the batched updates alone: no assessment, no observation, no info, no ends
    single_file: float  # rate of the updates alone, in rows of one cut
    resets: float  # number of environments reset per second


_update_row, _hold_some = update_row(STRAIGHT), hold_some(STRAIGHT)
_LANE, _SCALARS = STRAIGHT.lanes(1), STRAIGHT.scalars


@njit_nogil
def hold_in_single_file(
    passed: WorkQueue, core: int, cuts: Physics, commands: StructArray, ticks: int, felt: StructArray
) -> None:
    """Advance cuts like :func:`~cutenv.sim.cutting.simulate.hold_some`, but one by one, in a row of one lane."""
    rows, lanes = np.zeros(1, ONE), np.zeros(1, _LANE)
    row, plain = first_row(rows), plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    moving = Moving(first_row(lanes), lane_views(lanes, cuts.motions, 1, _SCALARS), cuts.motions, cuts.shared)
    n, end = next_chunk(passed, core, 1)
    while n < end:
        take(row, plain, cuts, 0, n)
        row.given[0], row.aim[0] = commands[n, 0], commands[n, 1]
        begin(row, plain, 1)
        for i in range(ticks):
            _update_row(row, moving, cuts.profiles, cuts.sensors, i == 0)
        put(row, plain, 0, n)
        felt[n, 0] = row.felt[0]
        mark_done(passed, core, 1)
        n, end = next_chunk(passed, core, 1)


def bare(cuts: Cuts) -> Physics:
    """Return copies of what the law needs of cuts along the cut alone."""
    return Physics(*(part.copy() for part in cuts[: len(Physics._fields)]))


def rates(count: int, rounds: int | None = None) -> Rates:
    """Measure ``count`` environments; each round resets them and cuts from the same place.

    Measurements of few environments are short and more easily disturbed: by default they take more rounds.
    """
    if rounds is None:
        rounds = 30 if count < SOME else 7 if count <= MANY else 2
    env = GentleCutVectorEnv(count)
    actions = np.tile(np.array(_ACTION, np.float32), (count, 1))
    command = commanded_speed(_ACTION[0]), ANGLE_CENTRE + ANGLE_SCALE * _ACTION[1], 0.0
    commands, felt = np.tile(command, (count, 1)), np.empty((count, 2))
    best = [np.inf, np.inf, np.inf, np.inf]
    for _ in range(rounds + 1):  # the first one warms up
        start = time.perf_counter()
        env.reset(seed=0)
        best[3] = min(best[3], time.perf_counter() - start)
        for _ in range(_WARM_UP):
            env.step(actions)
        rows, files = (bare(env.cuts) for _ in range(2))
        ways = (
            lambda: env.step(actions),
            lambda: parallel_for(_hold_some, count, rows, commands, env.single.ticks, felt),  # noqa: B023
            lambda: parallel_for(hold_in_single_file, count, files, commands, env.single.ticks, felt),  # noqa: B023
        )
        for k, way in enumerate(ways):
            best[k] = min(best[k], _seconds(way))
    return Rates(*(count / seconds for seconds in best))


def _seconds(step: Callable[[], Any]) -> float:
    start = time.perf_counter()
    for _ in range(_STEPS):
        step()
    return (time.perf_counter() - start) / _STEPS


def measure() -> Measured:
    """Measure rates, those of Gymnasium's vector environments, and limits; compare with the targets."""
    # These first: AsyncVectorEnv may fork, which is safest before this process has threads.
    others = {
        other: {count: step_rate(other, count) for count in COUNTS if count <= other.largest}
        for other in (ASYNC, SYNC, NATIVE)
    }
    found = {}
    for count in COUNTS:
        found[count] = rates(count)
        if count == SOME:  # again, next to ours: within minutes a shared machine changes its speed
            others[SYNC][count] = max(others[SYNC][count], step_rate(SYNC, count))
    limited = limits(found[MANY].native, found[MANY].bare)
    lines = [*_table(found, others), *_verdicts(found[SOME], found[MANY], others[SYNC][SOME]), *limited.lines]
    return Measured(_numbers(found, others) | dict(limited.numbers), lines)


def _numbers(found: dict[int, Rates], others: dict[Other, dict[int, float]]) -> dict[str, Number]:
    numbers = {}
    for count, rate in found.items():
        numbers[f"steps of cutenv/GentleCut-v1, {count}"] = Number(rate.native, "1/s")
        numbers[f"bare loop, {count}"] = Number(rate.bare, "1/s")
        numbers[f"of the bare loop, {count}"] = Number(rate.native / rate.bare, "1")
        numbers[f"over the bare loop in single file, {count}"] = Number(rate.native / rate.single_file, "1")
        numbers[f"resets of cutenv/GentleCut-v1, {count}"] = Number(rate.resets, "1/s")
    for other, rate_of in others.items():
        for count, per_second in rate_of.items():
            numbers[f"steps of {other.name} in {other.way}, {count}"] = Number(per_second, "1/s")
            over = found[count].native / per_second
            numbers[f"over {other.name} in {other.way}, {count}"] = Number(over, "1")
    return numbers


def _table(found: dict[int, Rates], others: dict[Other, dict[int, float]]) -> list[str]:
    lines = [
        f"native vector environment on {cores()} cores, control steps of 20 force updates",
        f"  compared with {SYNC.name} in {SYNC.way}, to {SYNC.largest} of them, and in {ASYNC.way}, a process "
        f"for each, to {ASYNC.largest};",
        f"  compared with {NATIVE.name} in {NATIVE.way}",
        "             thousand environment steps a second         of the bare loop  ns an update  ms to reset",
        "   number    cutenv      Sync     Async  CartPole   batched      one by one     of cutenv          all",
    ]
    for count, rate in found.items():
        beside = "".join(
            f"{others[other][count] / 1e3:10.1f}" if count in others[other] else f"{'-':>10s}"
            for other in (SYNC, ASYNC, NATIVE)
        )
        lines.append(
            f"  {count:7d}{rate.native / 1e3:10.1f}{beside}{rate.native / rate.bare:10.2f}"
            f"{rate.native / rate.single_file:16.2f}{1e9 / rate.native / 20:14.0f}{1e3 * count / rate.resets:13.1f}"
        )
    return lines


def _verdicts(some: Rates, many: Rates, pendulum: float) -> list[str]:
    of_bare, times, in_steps = many.native / many.bare, some.native / pendulum, many.native / many.resets
    beside = (
        f"{times:.0f} times SyncVectorEnv of Pendulum-v1 at {SOME} ({pendulum / 1e3:.0f} thousand/s; the bare loop "
        f"alone {some.bare / pendulum:.0f} times)"
    )
    reset = f"resetting {MANY}: {1e3 * MANY / many.resets:.0f} ms, as much as {in_steps:.1f} steps of the batch"
    return [
        at_least(f"{of_bare:.2f} of the bare loop at {MANY}", of_bare, SHARE_OF_BARE),
        at_least(beside, times, TIMES_PENDULUM),
        at_least(f"{many.native / 1e6:.2f} million steps/s at {MANY}", many.native / 1e6, STRETCH / 1e6),
        at_most(reset, in_steps, RESETS_IN_STEPS, f"{RESETS_IN_STEPS:g}"),
    ]
