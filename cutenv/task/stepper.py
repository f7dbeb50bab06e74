"""Steps of a task, compiled for each from its declaration: one cut, many cuts on all cores, readings of a rig.

Every loop is the same for all tasks: advance a millisecond, count it, conclude the step where the cut ends or the
decision is over.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.declared import compiled_for
from cutenv._engine.intrinsics import as_float64_view, keep_alive, prefetch, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.randomness import Integer
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.dtypes import DRIVE, LAW, STATE, TICK
from cutenv.cutting.lanes import gather, lane_views, pad, scatter
from cutenv.cutting.law import depth_at, grid_index
from cutenv.cutting.motion import Moving
from cutenv.cutting.row import LANES, ROW, Plain, begin, note, plain_views, put, take
from cutenv.cutting.sensor import SENSOR, WRAP
from cutenv.cutting.update import update_row
from cutenv.task.assessment import (
    COUNT,
    N_FIELDS,
    add_terms,
    begin_count,
    charge_stored,
    conclude,
    count_lane,
    observe_rest,
    reward_of,
    succeeded,
    tell,
)
from cutenv.task.declare import WAYS, Cuts, Stepping, Task, charge, command_of, terms
from cutenv.task.episode_dtypes import PROGRESS, TASK
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, commanded_speed
from cutenv.task.reward import ENDS, SAFETY_ENDS
from cutenv.task.tip_estimation import estimated_tip

# Sizes of records in numbers.  Numba compiles a kernel anew for each literal integer argument, but not for these.
_NONE = np.int64(0)
_STATE, _LAW, _DRIVE, _SENSOR, _TASK, _PROGRESS = (
    np.int64(kind.itemsize // 8) for kind in (STATE, LAW, DRIVE, SENSOR, TASK, PROGRESS)
)
_LINE = 8  # 64-bit numbers in a cache line
_AT_A_TIME = 4  # cuts of the next row that are prefetched during one millisecond of this one
_SAFETY = ENDS.index("force_limit")  # whose charges a further end for safety shares
_SAFETY_CODES = max(ENDS.index(name) for name in SAFETY_ENDS)  # the ends for safety are the first ones
_FURTHER_END = len(ENDS)  # code of the end that a task adds


@njit_inline
def batch_of_one(cut: Struct, shared: StructArray, episode: Struct) -> Cuts:
    """Return one cut and its episode as a batch of one."""
    return Cuts(
        cut.states, cut.profiles, cut.laws, cut.drives, cut.sensors, cut.motions, shared, episode.tasks,
        episode.progresses, episode.nominals, episode.specimens, episode.known, episode.wholes,
    )  # fmt: skip


@compiled_for(njit)
def step_one(task: Task) -> Callable[..., tuple[float, int]]:
    """Return the function that steps one cut by one decision."""
    begin_one, advance, finish, total = begin_lane(task), advance_row(task), conclude_lane(task), terms(task)
    scalars, force, from_truth, last = task.motion.scalars, task.motion.force, task.from_truth, WAYS - 1

    def step_one(
        cuts: StructArray,
        shared: StructArray,
        episodes: StructArray,
        ticks: int,
        action: StructArray,
        observations: StructArray,
        readings: StructArray,
        across: Array,
    ) -> tuple[float, int]:
        """Step one cut by one decision; return its reward and end.

        Parameters
        ----------
        cuts, shared, episodes : Records, shape (1,)
            :attr:`~cutenv.cutting.motion.Motion.cut`, what all cuts share, and
            :attr:`~cutenv.task.declare.Task.episode`; but for what is shared, changed in place.
        ticks : int
            Milliseconds until the next decision.
        action, observations, readings : array, shape (1, m), (1, components) float32, Records of shape (1, ticks)
            Action within [-1, 1]; observation and readings: filled.
        across : array, shape (ticks,) or (0,)
            Filled with the force across the cut [N], true or as it is measured, if it is not empty.
        """
        c, e = cuts[0], episodes[0]
        one = batch_of_one(c, shared, e)
        row, plain = first_row(c.rows), plain_views(c.rows, c.states, c.laws, c.drives)
        moving = Moving(first_row(c.lanes), lane_views(c.lanes, c.motions, 1, scalars), c.motions, shared)
        stepping = Stepping(one, row, moving, first_row(e.counts), first_row(e.steps))
        begin_one(stepping, plain, action, 0, 0)
        begin(row, plain, 1)
        for i in range(ticks):
            advance(stepping, readings, i)
            if len(across) > 0:
                across[i] = force(moving.lanes, 0)
                if not from_truth:
                    across[i] = e.known[0].ways[last]
            if stepping.count.end[0] != 0:
                break
        put(row, plain, 0, 0)
        scatter(moving.views, 0, 0)
        end = finish(stepping, 0, action[0], observations[0], e.infos[0])
        return add_terms(as_float64_view(e.infos), e.totals) + total(e.wholes[0]), end

    return step_one


class Decision(NamedTuple):
    """One decision for n cuts."""

    waiting: StructArray
    """Mask of cuts to skip because they have ended, array of bool, shape (n,)."""
    actions: StructArray
    """Actions within [-1, 1], shape (n, m)."""
    observations: StructArray
    """Filled, float32 of shape (n, components)."""
    rewards: StructArray
    """Filled, shape (n,)."""
    ends: StructArray
    """Filled with indices in :attr:`~cutenv.task.declare.Task.ends`, int64 of shape (n,)."""
    infos: StructArray
    """Filled, :data:`~cutenv.task.info.INFO` of shape (n,)."""
    readings: StructArray
    """Filled up to the end of a cut, :data:`~cutenv.cutting.dtypes.READING` of shape (n, ticks), or (0, 0) for none."""


@compiled_for(njit_nogil)
def step_some(task: Task) -> Callable[..., None]:
    """Return the function that steps many cuts by one decision."""
    step, scalars = step_row(task), task.motion.scalars
    lanes_of_row, counts_of_row = task.motion.lanes(LANES), task.counts(LANES)

    def step_some(passed: WorkQueue, core: int, cuts: Cuts, ticks: int, decision: Decision) -> None:
        """Step n cuts by one decision.

        Parameters
        ----------
        passed, core : WorkQueue, int
            Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
        cuts : Cuts
            The cuts, changed in place.
        ticks : int
            Milliseconds until the next decision.
        decision : Decision
            Actions, and what is filled.
        """
        cuts, decision = without_refcount(cuts), without_refcount(decision)
        # One buffer for all rows: it stays in the first-level cache.
        rows, counts = np.zeros(1, ROW), np.zeros(1, COUNT)
        lanes, steps = np.zeros(1, lanes_of_row), np.zeros(1, counts_of_row)
        row, plain = first_row(rows), plain_views(rows, cuts.states, cuts.laws, cuts.drives)
        moving = Moving(first_row(lanes), lane_views(lanes, cuts.motions, LANES, scalars), cuts.motions, cuts.shared)
        stepping = Stepping(cuts, row, moving, first_row(counts), first_row(steps))
        fetched = flat_views(cuts, plain, decision.infos)
        span = next_chunk(passed, core, LANES)
        while span[0] < span[1]:
            following = next_chunk(passed, core, LANES)
            step(stepping, plain, span, ticks, decision, fetched, following)
            mark_done(passed, core, span[1] - span[0])
            span = following
        keep_alive(rows)
        keep_alive(counts)
        keep_alive(lanes)
        keep_alive(steps)

    return step_some


@compiled_for(njit_inline)
def step_row(task: Task) -> Callable[..., None]:
    """Return the function that steps a row of cuts by one decision."""
    begin_one, advance, finish, total = begin_lane(task), advance_row(task), conclude_lane(task), terms(task)
    fetch = task.fetch

    def step_row(
        stepping: Stepping,
        plain: Plain,
        span: tuple[int, int],
        ticks: int,
        decision: Decision,
        fetched: tuple[StructArray, ...],
        following: tuple[int, int],
    ) -> None:
        """Step the cuts from the first number of ``span`` to before the second, at most a row; see :func:`step_some`.

        ``fetched`` are flat views of the records, of which those of the ``following`` row are prefetched meanwhile.
        """
        cuts, row, count, infos = stepping.cuts, stepping.row, stepping.count, decision.infos
        taken: Integer = _NONE
        for n in range(span[0], span[1]):
            if decision.waiting[n]:
                decision.rewards[n], decision.ends[n] = 0.0, 0
            else:
                begin_one(stepping, plain, decision.actions, taken, n)
                taken += 1
        if taken > 0:
            begin(row, plain, taken)
            pad(stepping.moving.views, taken)
        for i in range(ticks + 1 if taken > 0 else 0):
            fetch_some(cuts, fetched, i, following[0], following[1])
            fetch(cuts, i, following[0], following[1])
            over = taken  # after the last millisecond, all of them
            if i < ticks:
                over = advance(stepping, decision.readings, i)
            for k in range(taken if over > 0 else 0):
                if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                    c = row.cut[k]
                    row.going[k] = 0
                    put(row, plain, k, c)
                    scatter(stepping.moving.views, k, c)
                    decision.ends[c] = finish(stepping, k, decision.actions[c], decision.observations[c], infos[c])
                    decision.rewards[c] = reward_of(fetched[-1], c) + total(cuts.wholes[c])

    return step_row


@compiled_for(njit_inline)
def begin_lane(task: Task) -> Callable[..., None]:
    """Return the function that loads a cut and its action into a lane."""
    give, commanded, begin_step, further = task.motion.command, command_of(task), task.begin_step, task.axis is not None

    def begin_lane(stepping: Stepping, plain: Plain, actions: StructArray, k: Integer, n: Integer) -> None:
        """Load cut number ``n`` and its action into lane ``k``."""
        cuts, row = stepping.cuts, stepping.row
        take(row, plain, cuts.profiles[n], cuts.drives[n], cuts.sensors[n], k, n)
        gather(stepping.moving.views, k, n)
        begin_count(stepping.count, k, cuts.tasks[n], cuts.progresses[n])
        row.given[k] = commanded_speed(actions[n, 0])
        row.aim[k] = ANGLE_CENTRE + ANGLE_SCALE * actions[n, 1]
        if further:
            give(stepping.moving.lanes, k, commanded(actions[n, 2]))
        begin_step(stepping.step, k, cuts.states[n].tip)

    return begin_lane


@compiled_for(njit_inline)
def advance_row(task: Task) -> Callable[..., int]:
    """Return the function that advances and counts a millisecond of a row of cuts."""
    update, count, size, force = update_row(task.motion), task.count, task.size, task.motion.force
    from_truth, measure = task.from_truth, task.measure
    see: Any = None if from_truth else count_seen(task)

    def advance_row(stepping: Stepping, readings: StructArray, i: int) -> int:
        """Advance and count millisecond ``i`` of a row; return how many of its cuts end with it."""
        row, cuts, counts, lanes = stepping.row, stepping.cuts, stepping.count, stepping.moving.lanes
        update(row, stepping.moving, cuts.profiles, cuts.sensors, TICK, i == 0)
        over = 0
        if from_truth and row.slack == 0:
            for k in range(len(row.blade)):
                count_lane(
                    counts, k, row.blade[k], row.speed[k], size(row.force[k], force(lanes, k)), row.felt[k],
                    row.tip[k], row.jump[k], row.depth[k],
                )  # fmt: skip
                over += 1 if row.going[k] == 1 and counts.end[k] != 0 else 0
        else:
            for k in range(row.taken):
                c, position, speed = row.cut[k], row.blade[k], row.speed[k]
                if row.backlash[k] > 0.0:  # the encoder sits at the motor
                    position, speed = row.hand[k], row.hand_speed[k]
                if from_truth:
                    count_lane(
                        counts, k, position, speed, size(row.force[k], force(lanes, k)), row.felt[k], row.tip[k],
                        row.jump[k], depth_at(cuts.profiles[c], position),
                    )  # fmt: skip
                elif row.going[k] == 1:
                    measure(stepping, k)
                    see(stepping, k, position, speed, row.felt[k], i == 0)
                over += 1 if row.going[k] == 1 and counts.end[k] != 0 else 0
        if from_truth:
            for k in range(len(row.blade)):
                count(stepping.step, k, row.blade[k] - row.creep[k], row.tip[k], force(lanes, k))
        for k in range(row.taken if len(readings) > 0 else 0):
            if row.going[k] == 1:
                note(row, k, readings[row.cut[k], i], TICK)
        return over

    return advance_row


@compiled_for(njit_internal)
def count_seen(task: Task) -> Callable[..., None]:
    """Return the function that counts a reading, whose further measurements are in what is known of the cut."""
    expect, learn, count, size, across = task.expect_at, task.learn, task.count, task.size, WAYS - 1

    def count_seen(
        seen: Stepping | Seeing, k: Integer, position: float, speed: float, felt: float, first: bool
    ) -> None:
        """Count a reading of the cut in lane ``k``: tip and runs are estimated from the force [N] that is ``felt``.

        ``position`` [m] and ``speed`` [m/s] are those of the motor; ``first`` is True for the first of a step.
        """
        cuts, c, counts = seen.cuts, seen.row.cut[k], seen.count
        known, nominal = cuts.known[c], cuts.nominals[c]
        tick = round(counts.time[k] / TICK) + 1
        expect(cuts, c, first, tick, position)
        tip, jump = estimated_tip(known.tip[0], cuts.tasks[c], nominal, tick, position, speed, felt)
        learn(known, tick, position, tip)
        force = size(felt, known.ways[across])
        count_lane(counts, k, position, speed, force, felt, tip, jump, depth_at(nominal, position))
        count(seen.step, k, position, tip, known.ways[across])

    return count_seen


@compiled_for(njit_internal)
def conclude_lane(task: Task) -> Callable[..., int]:
    """Return the function that concludes the step of a cut."""
    conclude_cut, stored = assess_step(task), task.motion.stored

    def conclude_lane(
        stepping: Stepping, k: Integer, action: StructArray, observation: StructArray, info: Struct
    ) -> int:
        """Compute reward terms, observation and info for the step of the cut in lane ``k``; return its end."""
        cuts, row, c = stepping.cuts, stepping.row, stepping.row.cut[k]
        end: int = conclude_cut(stepping, k, (row.felt[k], row.angle[k]), action, observation, info)
        tell(cuts.states[c], cuts.profiles[c], cuts.laws[c], cuts.tasks[c], cuts.specimens[c], info)
        further = stored(cuts.motions[c])
        info.energy_stored += further
        info.energy_residual -= further
        return end

    return conclude_lane


@compiled_for(njit_inline)
def assess_step(task: Task) -> Callable[..., int]:
    """Return the function that assesses and observes a step, all of whose milliseconds are counted."""
    survey, charge_whole, breached, achieved = task.survey, charge(task), task.breached, task.achieved
    from_truth = task.from_truth
    left = task.left_loaded if from_truth else task.left_loaded_seen
    observe = task.observe if from_truth else task.observe_seen

    def assess_step(
        seen: Stepping | Seeing,
        k: Integer,
        felt: tuple[float, float],
        action: StructArray,
        observation: StructArray,
        info: Struct,
    ) -> int:
        """Compute reward terms and observation for the step of the cut in lane ``k``; return its end.

        ``felt`` are the measured force [N] and the angle of the blade [rad] at the end of the step.
        """
        cuts, count, c = seen.cuts, seen.count, seen.row.cut[k]
        whole, wanted, nominal, progress = cuts.wholes[c], cuts.tasks[c], cuts.nominals[c], cuts.progresses[c]
        if from_truth:
            survey(whole, cuts.motions[c], seen.step, k, count.tip[k])
        else:
            survey(whole, cuts.known[c].motion[0], seen.step, k, count.tip[k])
        charge_whole(whole, wanted.target)
        # A further end for safety is charged as one at the limit of force: for all that stopping could still have cost.
        breach = breached(whole) and (count.end[k] == 0 or count.end[k] > _SAFETY_CODES)
        if breach:
            count.end[k] = _SAFETY
        if from_truth:
            profile = cuts.profiles[c]
            conclude(count, k, wanted, progress, profile, nominal, felt[0], felt[1], action, info, observation)
        else:
            conclude(count, k, wanted, progress, nominal, nominal, felt[0], felt[1], action, info, observation)
        energy, toughness = left(cuts, c)
        if progress.end != 0 and energy >= 0.0:
            charge_stored(wanted, energy, toughness, info)
        whole.success = 1 if succeeded(wanted, progress) and achieved(whole, wanted.target) else 0
        if whole.success == 0:
            info.reward_terms_success = 0.0
        progress.end = _FURTHER_END if breach else progress.end
        observe(cuts, c, seen.step, k, action, observation)
        return progress.end  # type: ignore[no-any-return]

    return assess_step


class Seeing(NamedTuple):
    """One cut on a rig within a step: what is assessed of it, and its number in place of a row."""

    cuts: Cuts
    row: Struct
    count: Struct
    step: Struct


@compiled_for(njit)
def assess_readings(task: Task) -> Callable[..., tuple[float, int]]:
    """Return the function that assesses and observes a rig's readings since the last decision."""
    see, begin_step, finish, total = count_seen(task), task.begin_step, assess_step(task), terms(task)

    def assess_readings(
        cuts: StructArray,
        shared: StructArray,
        episodes: StructArray,
        readings: StructArray,
        ways: Array,
        action: StructArray,
        observation: StructArray,
    ) -> tuple[float, int]:
        """Assess and observe readings, with tip, runs and the whole cut estimated from what was measured.

        Parameters
        ----------
        cuts, shared, episodes : Records, shape (1,)
            :attr:`~cutenv.cutting.motion.Motion.cut`, as memory alone, what all cuts share, and
            :attr:`~cutenv.task.declare.Task.episode`, changed in place.
        readings : Records, shape (n,)
            :data:`~cutenv.cutting.dtypes.READING`; those after an end do not count.
        ways : array, shape (n, WAYS)
            Further measurements at each reading, the force across the cut [N] last.
        action, observation : array, shape (m,), (components,) float32
            The step's action; the observation, filled.

        Returns
        -------
        reward, end : float, int
            The latter an index in :attr:`~cutenv.task.declare.Task.ends`.
        """
        c, e = cuts[0], episodes[0]
        seen = Seeing(batch_of_one(c, shared, e), first_row(c.rows), first_row(e.counts), first_row(e.steps))
        progress, known = e.progresses[0], e.known[0]
        seen.row.cut[0] = 0
        begin_count(seen.count, 0, e.tasks[0], progress)
        begin_step(seen.step, 0, min(progress.position, known.tip[0].tip))
        felt = angle = 0.0
        for i in range(len(readings)):
            reading = readings[i]
            felt, angle = reading.force, reading.angle
            for m in range(WAYS):
                known.ways[m] = ways[i, m]
            see(seen, 0, reading.position, reading.speed, felt, i == 0)
            if seen.count.end[0] != 0:
                break
        end = finish(seen, 0, (felt, angle), action, observation, e.infos[0])
        return add_terms(as_float64_view(e.infos), e.totals) + total(e.wholes[0]), end

    return assess_readings


@compiled_for(njit)
def observe_one(task: Task) -> Callable[..., None]:
    """Return the function that observes one cut at its start."""
    observe, from_truth = task.observe_start, task.from_truth

    def observe_one(
        cuts: StructArray,
        shared: StructArray,
        episodes: StructArray,
        angle: float,
        last_angle: float,
        observation: StructArray,
    ) -> None:
        """Fill the observation of one cut at its start, before any step: angle of the blade [rad], and as an action."""
        c, e = cuts[0], episodes[0]
        observe_rest(e.counts, e.tasks[0], e.progresses[0], e.nominals[0], angle, last_angle, observation)
        one = batch_of_one(c, shared, e)
        if from_truth:
            observe(one, 0, c.motions[0], observation)
        else:
            observe(one, 0, e.known[0].motion[0], observation)

    return observe_one


@njit
def tell_one(cuts: StructArray, episodes: StructArray) -> None:
    """Fill the `info` of one cut at its start: no reward yet."""
    c, e = cuts[0], episodes[0]
    tell(c.states[0], c.profiles[0], c.laws[0], e.tasks[0], e.specimens[0], e.infos[0])


@njit
def tell_of_all(cuts: Cuts, which: StructArray, infos: StructArray) -> None:
    """Fill ``infos`` for the cuts with indices ``which`` at their start: no reward yet."""
    for n in which:
        tell(cuts.states[n], cuts.profiles[n], cuts.laws[n], cuts.tasks[n], cuts.specimens[n], infos[n])


@njit_inline
def flat_views(cuts: Cuts, plain: Plain, infos: StructArray) -> tuple[StructArray, ...]:
    """Return flat views of the records that are prefetched, those of ``infos`` last."""
    return (
        plain.states, plain.laws, plain.drives, as_float64_view(cuts.sensors), as_float64_view(cuts.tasks),
        as_float64_view(cuts.progresses), as_float64_view(infos),
    )  # fmt: skip


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
