"""Stepping cuts: one compiled call advances, assesses and observes one cut, or many on all cores."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view, keep_alive, prefetch, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.randomness import Integer
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.dtypes import DRIVE, LAW, PROFILE, STATE, TICK
from cutenv.cutting.law import depth_at, grid_index
from cutenv.cutting.row import LANES, ROW, Plain, begin, note, plain_views, put, take
from cutenv.cutting.sensor import SENSOR, WRAP
from cutenv.cutting.update import update_row
from cutenv.task.assessment import (
    COUNT,
    COUNT_ONE,
    N_FIELDS,
    add_terms,
    begin_count,
    conclude,
    count_lane,
    observe_rest,
    reward_of,
    tell,
)
from cutenv.task.episode_dtypes import PROGRESS, SPECIMEN, TASK
from cutenv.task.info import INFO
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, commanded_speed
from cutenv.task.reward import TERMS
from cutenv.task.tip_estimation import estimated_tip
from cutenv.tissue.crack_tip import ASSESSED_TIP

# Sizes of records in numbers.  Numba compiles a kernel anew for each literal integer argument, but not for these.
_NONE = np.int64(0)
_STATE, _LAW, _DRIVE, _SENSOR, _TASK, _PROGRESS = (
    np.int64(kind.itemsize // 8) for kind in (STATE, LAW, DRIVE, SENSOR, TASK, PROGRESS)
)
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
    specimens: StructArray
    tips: StructArray
    """Memory of the tip on a rig; unused if the reward is assessed by hidden state."""

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
            specimens=np.zeros(count, SPECIMEN),
            tips=np.zeros(count, ASSESSED_TIP),
        )


EPISODE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("tasks", TASK, (1,)),
            ("progresses", PROGRESS, (1,)),
            ("nominals", PROFILE, (1,)),
            ("specimens", SPECIMEN, (1,)),
            ("tips", ASSESSED_TIP, (1,)),
            ("infos", INFO, (1,)),  # of the last step
            ("totals", "f8", (len(TERMS),)),  # sum of the reward's terms since reset
            ("counts", COUNT_ONE, (1,)),  # memory of the calls
        ],
    )
)
"""One episode in one record, beside :data:`~cutenv.cutting.simulate.CUT`; each part is an array of shape (1,)."""


@njit_inline
def batch_of_one(cut: Struct, episode: Struct) -> Cuts:
    """Return one cut, given as :data:`~cutenv.cutting.simulate.CUT` and :data:`EPISODE`, as a batch of one."""
    return Cuts(
        cut.states, cut.profiles, cut.laws, cut.drives, cut.sensors, episode.tasks, episode.progresses,
        episode.nominals, episode.specimens, episode.tips,
    )  # fmt: skip


@njit
def step_one(
    cuts: StructArray,
    episodes: StructArray,
    ticks: int,
    from_truth: bool,
    action: StructArray,
    observations: StructArray,
    readings: StructArray,
) -> tuple[float, int]:
    """Step one cut by one decision; return its reward and end.

    Parameters
    ----------
    cuts, episodes : Records, shape (1,)
        :data:`~cutenv.cutting.simulate.CUT` and :data:`EPISODE`, changed in place.
    ticks, from_truth
        See :func:`step_some`.
    action, observations, readings : array, shape (1, 2), (1, 12) float32, Records of shape (1, ticks)
        Action within [-1, 1]; observation and readings: filled.
    """
    c, e = cuts[0], episodes[0]
    one = batch_of_one(c, e)
    row, count = first_row(c.rows), first_row(e.counts)
    plain, numbers = plain_views(c.rows, c.states, c.laws, c.drives), as_float64_view(e.infos)
    take_cut(one, row, plain, count, action, 0, 0)
    begin(row, plain, 1)
    for i in range(ticks):
        _advance(one, row, count, from_truth, readings, i)
        if count.end[0] != 0:
            break
    put(row, plain, 0, 0)
    conclude_cut(one, 0, row, count, 0, from_truth, action[0], observations[0], e.infos[0])
    return add_terms(numbers, e.totals), count.end[0]


@njit
def rest_one(episodes: StructArray, angle: float, last_angle: float, observation: StructArray) -> None:
    """Fill the observation of one episode at its start, before any step: :func:`observe_rest`."""
    e = episodes[0]
    observe_rest(e.counts, e.tasks[0], e.progresses[0], e.nominals[0], angle, last_angle, observation)


@njit
def tell_one(cuts: StructArray, episodes: StructArray) -> None:
    """Fill the `info` of one cut at its start: no reward yet."""
    c, e = cuts[0], episodes[0]
    tell(c.states[0], c.profiles[0], c.laws[0], e.tasks[0], e.specimens[0], e.infos[0])


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
    ends: StructArray,
    infos: StructArray,
    readings: StructArray,
) -> None:
    """Step n cuts by one decision.

    Parameters
    ----------
    passed, core : WorkQueue, int
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
    observations, rewards, ends, infos : array, shape (n, 12) float32, (n,), (n,) int64, Records of shape (n,)
        Filled: ``ends`` with indices in :data:`~cutenv.task.reward.ENDS`, ``infos`` as
        :data:`~cutenv.task.info.INFO`.
    readings : Records, shape (n, ticks) or (0, 0)
        Filled with :data:`~cutenv.cutting.dtypes.READING` up to the end of a cut, unless it has no rows.
    """
    cuts = without_refcount(cuts)
    waiting, actions, observations, rewards, ends, infos, readings = without_refcount(
        (waiting, actions, observations, rewards, ends, infos, readings)
    )
    # One buffer for all rows: it stays in the first-level cache.
    rows, counts = np.zeros(1, ROW), np.zeros(1, COUNT)
    row, count = first_row(rows), first_row(counts)
    plain = plain_views(rows, cuts.states, cuts.laws, cuts.drives)
    fetched = flat_views(cuts, plain, infos)
    first, last = next_chunk(passed, core, LANES)
    while first < last:
        following = next_chunk(passed, core, LANES)
        step_row(
            cuts, row, count, plain, first, last, ticks, from_truth, waiting, actions, observations, rewards, ends,
            infos, readings, fetched, following,
        )  # fmt: skip
        mark_done(passed, core, last - first)
        first, last = following
    keep_alive(rows)
    keep_alive(counts)


@njit_inline
def step_row(
    cuts: Cuts,
    row: Struct,
    count: Struct,
    plain: Plain,
    first: Integer,
    last: Integer,
    ticks: int,
    from_truth: bool,
    waiting: StructArray,
    actions: StructArray,
    observations: StructArray,
    rewards: StructArray,
    ends: StructArray,
    infos: StructArray,
    readings: StructArray,
    fetched: tuple[StructArray, ...],
    following: tuple[int, int],
) -> None:
    """Step the cuts from number ``first`` to before ``last``, at most a row, by one decision; see :func:`step_some`.

    ``fetched`` are flat views of the records, of which those of the ``following`` row are prefetched meanwhile.
    """
    taken: Integer = _NONE
    for n in range(first, last):
        if waiting[n]:
            rewards[n], ends[n] = 0.0, 0
        else:
            take_cut(cuts, row, plain, count, actions, taken, n)
            taken += 1
    if taken > 0:
        begin(row, plain, taken)
    for i in range(ticks + 1 if taken > 0 else 0):
        fetch_some(cuts, fetched, i, following[0], following[1])
        over = taken  # after the last millisecond, all of them
        if i < ticks:
            over = _advance(cuts, row, count, from_truth, readings, i)
        for k in range(taken if over > 0 else 0):
            if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                c = row.cut[k]
                row.going[k] = 0
                put(row, plain, k, c)
                conclude_cut(cuts, c, row, count, k, from_truth, actions[c], observations[c], infos[c])
                rewards[c], ends[c] = reward_of(fetched[-1], c), count.end[k]


@njit_inline
def flat_views(cuts: Cuts, plain: Plain, infos: StructArray) -> tuple[StructArray, ...]:
    """Return flat views of the records that :func:`step_row` prefetches, those of ``infos`` last."""
    return (
        plain.states, plain.laws, plain.drives, as_float64_view(cuts.sensors), as_float64_view(cuts.tasks),
        as_float64_view(cuts.progresses), as_float64_view(infos),
    )  # fmt: skip


@njit_inline
def take_cut(
    cuts: Cuts, row: Struct, plain: Plain, count: Struct, actions: StructArray, k: Integer, n: Integer
) -> None:
    """Load cut number ``n`` and its action into lane ``k``."""
    take(row, plain, cuts.profiles[n], cuts.drives[n], cuts.sensors[n], k, n)
    begin_count(count, k, cuts.tasks[n], cuts.progresses[n])
    row.given[k] = commanded_speed(actions[n, 0])
    row.aim[k] = ANGLE_CENTRE + ANGLE_SCALE * actions[n, 1]


@njit_inline
def _advance(cuts: Cuts, row: Struct, count: Struct, from_truth: bool, readings: StructArray, i: int) -> int:
    """Advance and count millisecond ``i`` of a row; return how many of its cuts end with it."""
    update_row(row, cuts.profiles, cuts.sensors, TICK, i == 0)
    return count_row(cuts, row, count, row.force, from_truth, readings, i)


@njit_inline
def count_row(
    cuts: Cuts, row: Struct, count: Struct, force: Array, from_truth: bool, readings: StructArray, i: int
) -> int:
    """Count millisecond ``i`` of a row with a true ``force`` [N] of each lane; return how many of its cuts end."""
    over = 0
    if from_truth and row.slack == 0:
        for k in range(len(row.blade)):
            count_lane(
                count, k, row.blade[k], row.speed[k], force[k], row.felt[k], row.tip[k], row.jump[k], row.depth[k]
            )
            over += 1 if row.going[k] == 1 and count.end[k] != 0 else 0
    else:
        for k in range(row.taken):
            count_as_seen(cuts, row, count, k, force[k], from_truth)
            over += 1 if row.going[k] == 1 and count.end[k] != 0 else 0
    for k in range(row.taken if len(readings) > 0 else 0):
        if row.going[k] == 1:
            note(row, k, readings[row.cut[k], i], TICK)
    return over


@njit_inline
def count_as_seen(cuts: Cuts, row: Struct, count: Struct, k: int, force: float, from_truth: bool) -> None:
    """Count a millisecond of lane ``k`` as a rig sees it: the motor's position, and the tip estimated unless known."""
    c, felt, position, speed = row.cut[k], row.felt[k], row.blade[k], row.speed[k]
    if row.backlash[k] > 0.0:  # the encoder sits at the motor
        position, speed = row.hand[k], row.hand_speed[k]
    tip, jump, known = row.tip[k], row.jump[k], cuts.profiles[c]
    if not from_truth:
        force, known = felt, cuts.nominals[c]
        tick = round(count.time[k] / TICK) + 1
        tip, jump = estimated_tip(cuts.tips[c], cuts.tasks[c], known, tick, position, speed, felt)
    count_lane(count, k, position, speed, force, felt, tip, jump, depth_at(known, position))


@njit_inline
def conclude_cut(
    cuts: Cuts,
    c: int,
    row: Struct,
    count: Struct,
    k: int,
    from_truth: bool,
    action: StructArray,
    observation: StructArray,
    info: Struct,
) -> None:
    """Compute reward terms, observation and info for the step of cut number ``c``, in lane ``k`` of a row."""
    profile, nominal = cuts.profiles[c], cuts.nominals[c]
    conclude(
        count, k, cuts.tasks[c], cuts.progresses[c], profile if from_truth else nominal, nominal, row.felt[k],
        row.angle[k], action, info, observation,
    )  # fmt: skip
    tell(cuts.states[c], profile, cuts.laws[c], cuts.tasks[c], cuts.specimens[c], info)


@njit_inline
def fetch_some(cuts: Cuts, fetched: tuple[StructArray, ...], i: int, first: int, last: int) -> None:
    """Prefetch part of the next row, cuts ``first`` to before ``last``, during millisecond ``i`` of this row.

    Thousands of cuts do not fit into the first-level cache.  Their records come first, because these contain the grid
    indices of tip and blade, and then the profiles there.
    """
    for c in range(first + _AT_A_TIME * i, min(first + _AT_A_TIME * (i + 1), last)):
        _fetch_records(fetched, c)
    later = first + _AT_A_TIME * i - LANES
    for c in range(max(later, first), min(later + _AT_A_TIME, last)):
        _fetch_places(cuts.states[c], cuts.profiles[c], cuts.nominals[c], cuts.specimens[c], cuts.sensors[c])


@njit_inline
def _fetch_records(records: tuple[StructArray, ...], n: Integer) -> None:
    """Prefetch the records of cut ``n``, given as flat views."""
    states, laws, drives, sensors, tasks, progresses, infos = records
    _fetch_lines(states, _STATE, n)
    _fetch_lines(laws, _LAW, n)
    _fetch_lines(drives, _DRIVE, n)
    _fetch_lines(tasks, _TASK, n)
    _fetch_lines(progresses, _PROGRESS, n)
    _fetch_lines(infos, N_FIELDS, n)
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


@njit
def tell_of_all(cuts: Cuts, which: StructArray, infos: StructArray) -> None:
    """Fill ``infos`` for the cuts with indices ``which`` at their start: no reward yet."""
    for n in which:
        tell(cuts.states[n], cuts.profiles[n], cuts.laws[n], cuts.tasks[n], cuts.specimens[n], infos[n])
