"""Batched assessment: :func:`cutenv.task.assessment.counted` for every cut of a row at every millisecond."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit_inline, njit_internal
from cutenv._engine.randomness import Integer
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import depth_at
from cutenv.cutting.row import ABREAST
from cutenv.task.assessment import Tally, counted, fresh
from cutenv.task.observation import fill
from cutenv.task.tip_estimation import estimated_tip

_WHOLE = ("touched", "end", "updates", "out_of_range")
_PASSING = ("speed", "felt_low", "felt_high", "felt_sum")


class Asked(NamedTuple):
    """Limits of the task that :func:`~cutenv.task.assessment.counted` reads, for one cut in a row."""

    target: float
    deadline: float
    force_limit_per_depth: float
    friction_per_depth: float
    speed_min: float
    speed_max: float


COUNT: np.dtype[Any] = np.dtype(
    (
        np.record,
        [(name, "i8" if name in _WHOLE else "f8", (ABREAST,)) for name in (*Tally._fields, *Asked._fields, *_PASSING)],
    )
)
"""Structured dtype of a row's assessment: for each lane its tally, limits, speed, and sums of the measured force."""


@njit_internal
def begin_count(count: Struct, task: Struct, progress: Struct, k: Integer) -> None:
    """Initialise lane ``k`` for a new step."""
    keep(count, k, fresh(progress))
    count.target[k], count.deadline[k] = task.target, task.deadline
    count.force_limit_per_depth[k], count.friction_per_depth[k] = task.force_limit_per_depth, task.friction_per_depth
    count.speed_min[k], count.speed_max[k] = task.speed_min, task.speed_max
    count.felt_low[k], count.felt_high[k], count.felt_sum[k] = math.inf, -math.inf, 0.0


@njit_inline
def tally_of(count: Struct, k: int) -> Tally:
    """Gather the tally of lane ``k``."""
    return Tally(
        count.position[k], count.touched[k], count.furthest[k], count.time[k], count.quiet[k], count.tip[k],
        count.end[k], count.updates[k], count.out_of_range[k], count.over_limit[k], count.uncontrolled[k],
        count.jumped[k], count.over_force[k], count.over_lag[k], count.backward[k], count.haste[k],
    )  # fmt: skip


@njit_inline
def asked_of(count: Struct, k: int) -> Asked:
    """Gather the task's limits of lane ``k``."""
    return Asked(
        count.target[k], count.deadline[k], count.force_limit_per_depth[k], count.friction_per_depth[k],
        count.speed_min[k], count.speed_max[k],
    )  # fmt: skip


@njit_inline
def keep(count: Struct, k: Integer, tally: Tally) -> None:
    """Store ``tally`` in lane ``k``."""
    count.position[k], count.touched[k], count.furthest[k] = tally.position, tally.touched, tally.furthest
    count.time[k], count.quiet[k], count.tip[k] = tally.time, tally.quiet, tally.tip
    count.end[k], count.updates[k], count.out_of_range[k] = tally.end, tally.updates, tally.out_of_range
    count.over_limit[k], count.uncontrolled[k], count.jumped[k] = tally.over_limit, tally.uncontrolled, tally.jumped
    count.over_force[k], count.over_lag[k] = tally.over_force, tally.over_lag
    count.backward[k], count.haste[k] = tally.backward, tally.haste


@njit_inline
def count_row(row: Struct, count: Struct) -> int:
    """Accumulate one millisecond of every lane from the true state; return how many active cuts end with it."""
    ended = 0
    for k in range(ABREAST):
        going, felt, low, high = row.going[k], row.felt[k], count.felt_low[k], count.felt_high[k]
        tally = counted(
            tally_of(count, k), asked_of(count, k), row.blade[k], row.speed[k], row.force[k], felt, row.tip[k],
            row.jump[k], row.depth[k],
        )  # fmt: skip
        keep(count, k, tally)
        count.speed[k] = row.speed[k]
        count.felt_low[k], count.felt_high[k] = min(low, felt), max(high, felt)
        count.felt_sum[k] += felt
        ended += 1 if going == 1 and tally.end != 0 else 0
    return ended


@njit_inline
def count_one(
    row: Struct, count: Struct, k: int, task: Struct, progress: Struct, known: Struct, from_truth: bool
) -> int:
    """Accumulate one lane from estimated tip or motor-side position (a rig's view); return 1 if it ends."""
    felt, x, speed = row.felt[k], row.blade[k], row.speed[k]
    if row.backlash[k] > 0.0:  # the encoder sits at the motor
        x, speed = row.hand[k], row.hand_speed[k]
    force, tip, jump = row.force[k], row.tip[k], row.jump[k]
    if not from_truth:
        force = felt
        tip, jump = estimated_tip(task, progress, known, count.tip[k], round(count.time[k] / TICK) + 1, x, speed, felt)
    tally = counted(tally_of(count, k), asked_of(count, k), x, speed, force, felt, tip, jump, depth_at(known, x))
    keep(count, k, tally)
    count.speed[k] = speed
    count.felt_low[k], count.felt_high[k] = min(count.felt_low[k], felt), max(count.felt_high[k], felt)
    count.felt_sum[k] += felt
    return 1 if row.going[k] == 1 and tally.end != 0 else 0


@njit_inline
def observe_counted(
    row: Struct,
    count: Struct,
    k: int,
    task: Struct,
    progress: Struct,
    nominal: Struct,
    action: StructArray,
    observation: StructArray,
) -> None:
    """Fill the observation of lane ``k`` like :func:`~cutenv.task.observation.observe`."""
    fill(
        task, nominal, row.felt[k], count.felt_sum[k] / progress.updates, count.felt_low[k], count.felt_high[k],
        count.position[k], count.speed[k], row.angle[k], progress.time, action[0], action[1], observation,
    )  # fmt: skip
