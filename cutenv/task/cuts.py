"""Batch state and batch step: one compiled call advances, assesses and observes many cuts, on all cores."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view, prefetch, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil
from cutenv._engine.randomness import Integer
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.abreast import update_row
from cutenv.cutting.dtypes import DRIVE, LAW, PROFILE, STATE, TICK
from cutenv.cutting.law import grid_index
from cutenv.cutting.row import ABREAST, ROW, begin, put, take
from cutenv.cutting.sensor import SENSOR, WRAP
from cutenv.task.assessment import charge
from cutenv.task.counting import COUNT, begin_count, count_one, count_row, observe_counted, tally_of
from cutenv.task.episode_dtypes import PROGRESS, TASK, TERMS
from cutenv.task.info import INFO_SIZE, INT_FIELDS, fill_info
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE
from cutenv.tissue.grid import N_POINTS
from cutenv.tissue.nominal import NOMINAL

SPECIMEN: np.dtype[Any] = np.dtype(
    (np.record, [("modulus", "f8", (N_POINTS,)), ("fracture_resistance", "f8", (N_POINTS,))])
)
"""Properties of a specimen reported in `info` beyond its profile: modulus [Pa], fracture resistance [J/m2]."""


# Sizes of records in numbers.  Numba compiles a kernel anew for each literal integer argument, but not for these.
_NONE = np.int64(0)
_STATE, _LAW, _DRIVE, _SENSOR, _TASK, _PROGRESS, _TOLD = (
    np.int64(size)
    for size in (*(kind.itemsize // 8 for kind in (STATE, LAW, DRIVE, SENSOR, TASK, PROGRESS)), INFO_SIZE)
)
_END, _UNITS, _OUT_OF_RANGE = range(len(INT_FIELDS))
_LINE = 8  # 64-bit numbers in a cache line
_AT_A_TIME = 4  # cuts of the next row that are prefetched during one millisecond of this one


class Cuts(NamedTuple):
    """Everything about n cuts, as structured arrays of shape (n,)."""

    states: StructArray
    profiles: StructArray
    laws: StructArray
    drives: StructArray
    sensors: StructArray
    tasks: StructArray
    progresses: StructArray
    nominals: StructArray
    """Profiles that a rig expects."""
    expected: StructArray
    """Mean tissue that the nominal profiles are made from; shape (1,), the same for all cuts."""
    specimens: StructArray

    @classmethod
    def empty(cls, count: int) -> Cuts:
        """Return arrays for ``count`` cuts, not yet reset."""
        return cls(
            states=np.zeros(count, STATE),
            profiles=np.zeros(count, PROFILE),
            laws=np.zeros(count, LAW),
            drives=np.zeros(count, DRIVE),
            sensors=np.zeros(count, SENSOR),
            tasks=np.zeros(count, TASK),
            progresses=np.zeros(count, PROGRESS),
            nominals=np.zeros(count, PROFILE),
            expected=np.zeros(1, NOMINAL),
            specimens=np.zeros(count, SPECIMEN),
        )


@njit_nogil
def step_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    ticks: int,
    from_truth: bool,
    waiting: StructArray,
    actions: StructArray,
    observations: StructArray,
    rewards: StructArray,
    codes: StructArray,
    told: StructArray,
    readings: StructArray,
) -> None:
    """Step n cuts by one decision.

    Parameters
    ----------
    passed, core : Portions, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts : Cuts
        The cuts, changed in place.
    ticks : int
        Milliseconds until the next decision.
    from_truth : bool
        True: the reward is assessed by hidden state. False: by a rig's estimates.
    waiting : array of bool, shape (n,)
        Mask of cuts to skip because they have ended.
    actions : array, shape (n, 2)
        Actions within [-1, 1].
    observations, rewards, codes, told : array, shape (n, 12) float32, (n,), (3, n) int64, (n, 30)
        Filled: ``codes`` as :data:`~cutenv.task.info.INT_FIELDS`, ``told`` by :func:`~cutenv.task.info.fill_info`.
    readings : Records, shape (n, ticks) or (0, 0)
        Filled with :data:`~cutenv.cutting.dtypes.READING` up to the end of a cut, unless it has no rows.
    """
    cuts = without_refcount(cuts)
    waiting, actions, observations, rewards, codes, told = without_refcount(
        (waiting, actions, observations, rewards, codes, told)
    )
    # One buffer for all rows: it stays in the first-level cache.
    rows, counts, terms = np.zeros(1, ROW), np.zeros(1, COUNT), np.empty(len(TERMS))
    row, count, numbers = rows[0], counts[0], as_float64_view(rows)
    plain = (
        as_float64_view(cuts.states), as_float64_view(cuts.laws), as_float64_view(cuts.drives),
        as_float64_view(cuts.sensors),
        as_float64_view(cuts.tasks), as_float64_view(cuts.progresses), as_float64_view(told),
    )  # fmt: skip
    first, last = next_chunk(passed, core, ABREAST)
    while first < last:
        following = next_chunk(passed, core, ABREAST)
        taken: Integer = _NONE
        for n in range(first, last):
            if waiting[n]:
                rewards[n] = 0.0
                codes[:, n] = 0
            else:
                take(
                    row, numbers, plain[0], plain[1], plain[2], cuts.drives[n], cuts.sensors[n], cuts.profiles[n],
                    taken, n,
                )  # fmt: skip
                begin_count(count, cuts.tasks[n], cuts.progresses[n], taken)
                row.given[taken] = SPEED_SCALE * actions[n, 0]
                row.aim[taken] = ANGLE_CENTRE + ANGLE_SCALE * actions[n, 1]
                taken += 1
        if taken > 0:
            begin(row, numbers, taken)
        for i in range(ticks + 1 if taken > 0 else 0):
            _fetch_some(cuts, plain, i, following[0], following[1])
            over = taken  # after the last millisecond, all of them
            if i < ticks:
                update_row(row, cuts.profiles, cuts.sensors, i == 0)
                if len(readings) > 0:
                    _note(row, readings, i)
                over = _count(cuts, row, count, from_truth)
            for k in range(taken if over > 0 else 0):
                if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                    c = row.cut[k]
                    row.going[k] = 0
                    put(numbers, plain[0], k, c)
                    _conclude(cuts, c, row, count, k, from_truth, actions[c], terms, observations[c], told[c])
                    rewards[c], codes[_END, c] = total(terms), cuts.progresses[c].end
                    codes[_UNITS, c], codes[_OUT_OF_RANGE, c] = row.units[k], cuts.progresses[c].out_of_range
        mark_done(passed, core, last - first)
        first, last = following


@njit_internal
def _note(row: Struct, readings: StructArray, i: int) -> None:
    """Record millisecond ``i`` of the cuts of a row that have not ended."""
    for k in range(row.taken):
        if row.going[k] == 1:
            reading = readings[row.cut[k], i]
            moved = row.backlash[k] > 0.0  # the encoder sits at the motor
            reading.time = row.tick[k] * TICK
            reading.force = row.felt[k]
            reading.position = row.hand[k] if moved else row.blade[k]
            reading.speed = row.hand_speed[k] if moved else row.speed[k]
            reading.angle = row.angle[k]
            reading.true_force = row.force[k]
            reading.elastic_force = row.elastic[k]
            reading.tip = row.tip[k]
            reading.jump = row.jump[k]


@njit_inline
def _count(cuts: Cuts, row: Struct, count: Struct, from_truth: bool) -> int:
    """Accumulate one millisecond of a row; return how many of its cuts end with it."""
    if from_truth and row.slack == 0:
        return count_row(row, count)
    over = 0
    for k in range(row.taken):
        c = row.cut[k]
        known = cuts.profiles[c] if from_truth else cuts.nominals[c]
        over += count_one(row, count, k, cuts.tasks[c], cuts.progresses[c], known, from_truth)
    return over


@njit_inline
def _conclude(
    cuts: Cuts,
    c: int,
    row: Struct,
    count: Struct,
    k: int,
    from_truth: bool,
    action: StructArray,
    terms: StructArray,
    observation: StructArray,
    told: StructArray,
) -> None:
    """Compute reward terms, observation and info for the step of cut number ``c``, in lane ``k`` of a row."""
    task, progress, profile, nominal = cuts.tasks[c], cuts.progresses[c], cuts.profiles[c], cuts.nominals[c]
    charge(task, progress, profile if from_truth else nominal, tally_of(count, k), row.angle[k], terms)
    observe_counted(row, count, k, task, progress, nominal, action, observation)
    specimen = cuts.specimens[c]
    fill_info(
        cuts.states[c], profile, cuts.laws[c], task, progress, specimen.modulus, specimen.fracture_resistance, terms,
        told,
    )  # fmt: skip


@njit_inline
def _fetch_some(cuts: Cuts, plain: tuple[StructArray, ...], i: int, first: int, last: int) -> None:
    """Prefetch part of the next row, cuts ``first`` to before ``last``, during millisecond ``i`` of this row.

    Thousands of cuts do not fit into the first-level cache.  Their records come first, because these contain the grid
    indices of tip and blade, and then the profiles there.
    """
    for c in range(first + _AT_A_TIME * i, min(first + _AT_A_TIME * (i + 1), last)):
        _fetch_records(plain, c)
    later = first + _AT_A_TIME * i - ABREAST
    for c in range(max(later, first), min(later + _AT_A_TIME, last)):
        _fetch_places(cuts.states[c], cuts.profiles[c], cuts.nominals[c], cuts.specimens[c], cuts.sensors[c])


@njit_inline
def _fetch_records(records: tuple[StructArray, ...], n: Integer) -> None:
    """Prefetch the records of cut ``n``, given as flat views."""
    states, laws, drives, sensors, tasks, progresses, told = records
    _fetch_lines(states, _STATE, n)
    _fetch_lines(laws, _LAW, n)
    _fetch_lines(drives, _DRIVE, n)
    _fetch_lines(tasks, _TASK, n)
    _fetch_lines(progresses, _PROGRESS, n)
    _fetch_lines(told, _TOLD, n)
    prefetch(sensors, _SENSOR * n)


@njit_inline
def _fetch_lines(numbers: StructArray, size: Integer, n: Integer) -> None:
    """Prefetch ``size`` numbers of cut ``n``; they need not begin on a cache line."""
    for k in range(0, size - 1, _LINE):
        prefetch(numbers, size * n + k)
    prefetch(numbers, size * n + size - 1)


@njit_inline
def _fetch_places(state: Struct, profile: Struct, nominal: Struct, specimen: Struct, sensor: Struct) -> None:
    """Prefetch the profiles at a cut's tip and blade, and its sensor's delay line."""
    tip, blade = grid_index(state.tip)[0], grid_index(state.blade)[0]
    prefetch(profile.stiffness, tip)
    prefetch(profile.toughness, tip)
    prefetch(profile.depth, blade)
    prefetch(nominal.depth, blade)
    prefetch(specimen.modulus, tip)
    prefetch(specimen.fracture_resistance, tip)
    for k in range(-2 * _LINE, 3 * _LINE, _LINE):
        prefetch(sensor.line, (state.tick + k) & WRAP)


@njit_internal
def total(terms: StructArray) -> float:
    """Return the reward: the sum of its terms, in order."""
    reward = 0.0
    for k in range(len(terms)):
        reward += terms[k]
    return reward


@njit
def tell_of_all(cuts: Cuts, which: StructArray, told: StructArray) -> None:
    """Fill ``told`` for the cuts with indices ``which`` at their start: no reward yet."""
    terms = np.zeros(len(TERMS))
    for n in which:
        specimen = cuts.specimens[n]
        fill_info(
            cuts.states[n], cuts.profiles[n], cuts.laws[n], cuts.tasks[n], cuts.progresses[n],
            specimen.modulus, specimen.fracture_resistance, terms, told[n],
        )  # fmt: skip
