"""Steps of a task, compiled for each from its declaration.

One cut, many cuts on all cores, readings of a rig.

Every loop is the same for all tasks: advance a millisecond, count it, conclude the step where the cut ends or the
decision is over.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.declared import compiled_for
from cutenv._engine.intrinsics import as_float64_view, first_row, keep_alive, prefetch, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil
from cutenv._engine.parallel import WorkQueue, mark_done, next_chunk
from cutenv._engine.randomness import Integer
from cutenv.sim.cutting.dtypes import DRIVE, LAW, STATE, TICK
from cutenv.sim.cutting.law import depth_at, grid_index
from cutenv.sim.cutting.motion import Moving
from cutenv.sim.cutting.row import (
    LANES,
    ROW,
    Plain,
    begin,
    gather,
    lane_views,
    note,
    pad,
    plain_views,
    put,
    scatter,
    take,
)
from cutenv.sim.cutting.sensor import SENSOR, WRAP
from cutenv.sim.cutting.update import update_row
from cutenv.sim.quantities import SHALLOWEST, SMALLEST_RUN
from cutenv.sim.tissue.crack_tip import ESTIMATED_EVERY, BladeReading, MeanTissue, assess_tip
from cutenv.task.assessment import (
    COUNT,
    N_FIELDS,
    Millisecond,
    add_terms,
    begin_count,
    charge_end,
    charge_stored,
    conclude,
    count_lane,
    norm_held,
    observe_rest,
    reward_of,
    succeeded,
    tell,
)
from cutenv.task.declare import WAYS, Cuts, OneCut, Stepping, Task, charge, command_of, terms
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, commanded_speed
from cutenv.task.reward import ENDS, PROGRESS, SAFETY_ENDS, TASK

_UPDATES = round(ESTIMATED_EVERY / TICK)  # whatever the decision rate


@njit_internal
def estimated_tip(
    memory: Struct, task: Struct, nominal: Struct, tick: int, reading: BladeReading
) -> tuple[float, float]:
    """Return tip and unstable growth [m], estimated every 20 ms.

    ``tick`` counts from 1 at reset.  The tip's advance beyond the blade's counts as an unstable run.  ``memory`` is
    :data:`~cutenv.sim.tissue.crack_tip.ASSESSED_TIP`, changed in place.
    """
    if tick % _UPDATES != 0:
        return memory.tip, 0.0
    advance = max(reading.position - memory.position, 0.0)
    mean = MeanTissue(nominal.stiffness, len(nominal.stiffness), task.friction_per_depth)
    run = assess_tip(memory, mean, reading) - advance
    return memory.tip, run if run > SMALLEST_RUN else 0.0


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
def batch_of_one(one: OneCut) -> Cuts:
    """Return one cut and its episode as a batch of one."""
    cut, episode = one.cut[0], one.episode[0]
    return Cuts(
        cut.states, cut.profiles, cut.laws, cut.drives, cut.sensors, cut.motions, one.shared, episode.tasks,
        episode.progresses, episode.nominals, episode.specimens, episode.known, episode.wholes,
    )  # fmt: skip


@compiled_for(njit)
def step_one(task: Task) -> Callable[..., tuple[float, int]]:
    """Return the function that steps one cut by one decision."""
    begin_one, advance, finish = begin_lane(task), advance_row(task), conclude_lane(task)
    scalars, force, from_truth, last = task.motion.scalars, task.motion.force, task.from_truth, WAYS - 1
    total = terms(task) if task.costs else None

    def step_one(
        cut: StructArray,
        shared: StructArray,
        episode: StructArray,
        ticks: int,
        action: StructArray,
        observation: StructArray,
        readings: StructArray,
        across: Array,
    ) -> tuple[float, int]:
        """Step one cut by one decision of ``ticks`` [ms]; return its reward and end.

        Its arguments are those of :class:`~cutenv.task.declare.OneCut`, one by one: a call from Python takes a
        microsecond longer with tuples of arrays.  The observation is filled, and, if they are not empty, ``readings``
        and ``across``, (ticks,), with the force across the cut [N], true or as it is measured.
        """
        c, e = cut[0], episode[0]
        row, plain = first_row(c.rows), plain_views(c.rows, c.states, c.laws, c.drives)
        moving = Moving(first_row(c.lanes), lane_views(c.lanes, c.motions, 1, scalars), c.motions, shared)
        cuts = batch_of_one(OneCut(cut, shared, episode))
        stepping = Stepping(cuts, row, plain, moving, first_row(e.counts), first_row(e.steps))
        begin_one(stepping, action, 0, 0)
        begin(row, plain, 1)
        for i in range(ticks):
            advance(stepping, readings, i)
            if force is not None and len(across) > 0:
                across[i] = force(moving.lanes, 0) if from_truth else e.known[0].ways[last]
            if stepping.count.end[0] != 0:
                break
        put(row, plain, 0, 0)
        scatter(moving.views, 0, 0)
        end = finish(stepping, 0, action, observation, e.infos[0])
        reward = add_terms(as_float64_view(e.infos), e.totals)
        if total is not None:
            reward += total(e.wholes[0])
        return reward, end

    return step_one


class Decision(NamedTuple):
    """One decision for n cuts."""

    ticks: int  # milliseconds until the next one
    waiting: StructArray  # mask of cuts to skip because they have ended, array of bool, shape (n,)
    actions: StructArray  # actions within [-1, 1], shape (n, m)
    observations: StructArray  # filled, float32 of shape (n, components)
    rewards: StructArray  # filled, shape (n,)
    ends: StructArray  # filled with indices in ends, int64 of shape (n,)
    infos: StructArray  # filled, INFO of shape (n,)
    readings: StructArray  # filled up to a cut's end, READING of shape (n, ticks); (0, 0) for none


class Ahead(NamedTuple):
    """Cuts that are stepped next, whose records are prefetched meanwhile."""

    records: tuple[StructArray, ...]  # flat views of the records of all cuts, flat_views
    first: int  # number of the first of them, and that after the last
    last: int


@compiled_for(njit_nogil)
def step_some(task: Task) -> Callable[..., None]:
    """Return the function that steps many cuts by one decision."""
    step, scalars = step_row(task), task.motion.scalars
    lanes_of_row, counts_of_row = task.motion.lanes(LANES), task.counts(LANES)

    def step_some(passed: WorkQueue, core: int, cuts: Cuts, decision: Decision) -> None:
        """Step n cuts by one decision, changing ``cuts`` and ``decision`` in place.

        ``passed`` and ``core`` are those of :func:`cutenv._engine.parallel.parallel_for`.
        """
        cuts, decision = without_refcount(cuts), without_refcount(decision)
        # One buffer for all rows: it stays in the first-level cache.
        rows, counts = np.zeros(1, ROW), np.zeros(1, COUNT)
        lanes, steps = np.zeros(1, lanes_of_row), np.zeros(1, counts_of_row)
        row, plain = first_row(rows), plain_views(rows, cuts.states, cuts.laws, cuts.drives)
        moving = Moving(first_row(lanes), lane_views(lanes, cuts.motions, LANES, scalars), cuts.motions, cuts.shared)
        stepping = Stepping(cuts, row, plain, moving, first_row(counts), first_row(steps))
        fetched = flat_views(cuts, plain, decision.infos)
        span = next_chunk(passed, core, LANES)
        while span[0] < span[1]:
            following = next_chunk(passed, core, LANES)
            step(stepping, span, decision, Ahead(fetched, following[0], following[1]))
            mark_done(passed, core, span[1] - span[0])
            span = following
        keep_alive(rows)
        keep_alive(counts)
        keep_alive(lanes)
        keep_alive(steps)

    return step_some


@compiled_for(njit_inline)
def step_row(task: Task) -> Callable[..., None]:
    """Return the function that steps a row by one decision."""
    begin_one, advance, finish = begin_lane(task), advance_row(task), conclude_lane(task)
    fetch, total = task.fetch, terms(task) if task.costs else None

    def step_row(stepping: Stepping, span: tuple[int, int], decision: Decision, ahead: Ahead) -> None:
        """Step at most a row of cuts in ``span``, prefetching those ``ahead``."""
        cuts, row, count, infos, ticks = stepping.cuts, stepping.row, stepping.count, decision.infos, decision.ticks
        taken: Integer = _NONE
        for n in range(span[0], span[1]):
            if decision.waiting[n]:
                decision.rewards[n], decision.ends[n] = 0.0, 0
            else:
                begin_one(stepping, decision.actions[n], taken, n)
                taken += 1
        if taken > 0:
            begin(row, stepping.plain, taken)
            pad(stepping.moving.views, taken)
        for i in range(ticks + 1 if taken > 0 else 0):
            fetch_some(cuts, ahead, i)
            if fetch is not None:
                fetch(cuts, i, ahead.first, ahead.last)
            over = taken  # after the last millisecond, all of them
            if i < ticks:
                over = advance(stepping, decision.readings, i)
            for k in range(taken if over > 0 else 0):
                if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                    c = row.cut[k]
                    row.going[k] = 0
                    put(row, stepping.plain, k, c)
                    scatter(stepping.moving.views, k, c)
                    decision.ends[c] = finish(stepping, k, decision.actions[c], decision.observations[c], infos[c])
                    decision.rewards[c] = reward_of(ahead.records[-1], c)
                    if total is not None:
                        decision.rewards[c] += total(cuts.wholes[c])

    return step_row


@compiled_for(njit_inline)
def begin_lane(task: Task) -> Callable[..., None]:
    """Return the function that loads a cut and action into a lane."""
    give, commanded, begin_step = task.motion.command, command_of(task), task.begin_step

    def begin_lane(stepping: Stepping, action: StructArray, k: Integer, n: Integer) -> None:
        """Load cut number ``n`` and its action into lane ``k``."""
        cuts, row = stepping.cuts, stepping.row
        take(row, stepping.plain, cuts, k, n)
        gather(stepping.moving.views, k, n)
        begin_count(stepping.count, k, cuts.tasks[n], cuts.progresses[n])
        row.given[k] = commanded_speed(action[0])
        row.aim[k] = ANGLE_CENTRE + ANGLE_SCALE * action[1]
        if give is not None:
            give(stepping.moving.lanes, k, commanded(action[2]))
        if begin_step is not None:
            begin_step(stepping.step, k, cuts.states[n].tip)

    return begin_lane


@compiled_for(njit_inline)
def advance_row(task: Task) -> Callable[..., int]:
    """Return the function that advances and counts a row's millisecond."""
    update, count, size, force = update_row(task.motion), task.count, task.size, task.motion.force
    from_truth, measure, pull = task.from_truth, task.measure, task.motion.pull
    see: Any = None if from_truth else count_seen(task)

    def advance_row(stepping: Stepping, readings: StructArray, i: int) -> int:
        """Advance and count millisecond ``i``; return how many cuts end."""
        row, cuts, counts, lanes = stepping.row, stepping.cuts, stepping.count, stepping.moving.lanes
        update(row, stepping.moving, cuts.profiles, cuts.sensors, i == 0)
        over = 0
        if from_truth and row.slack == 0:
            for k in range(len(row.blade)):
                across = 0.0 if force is None else force(lanes, k)
                charged = row.force[k] if size is None else size(row.force[k], across)
                along = row.felt[k] if pull is None else pull(lanes, k, row.felt[k])
                held = row.felt[k] if force is None else norm_held(row.felt[k], across, along)
                now = Millisecond(
                    row.blade[k], row.speed[k], charged, row.felt[k], held, row.tip[k], row.jump[k], row.depth[k]
                )
                count_lane(counts, k, now)
                over += 1 if row.going[k] == 1 and counts.end[k] != 0 else 0
        else:
            for k in range(row.taken):
                position, speed = row.blade[k], row.speed[k]
                if row.backlash[k] > 0.0:  # the encoder sits at the motor
                    position, speed = row.hand[k], row.hand_speed[k]
                if from_truth:
                    across = 0.0 if force is None else force(lanes, k)
                    charged = row.force[k] if size is None else size(row.force[k], across)
                    along = row.felt[k] if pull is None else pull(lanes, k, row.felt[k])
                    held = row.felt[k] if force is None else norm_held(row.felt[k], across, along)
                    depth = depth_at(cuts.profiles[row.cut[k]], position)
                    now = Millisecond(position, speed, charged, row.felt[k], held, row.tip[k], row.jump[k], depth)
                    count_lane(counts, k, now)
                elif row.going[k] == 1:
                    if measure is not None:
                        measure(stepping, k)
                    see(stepping, k, position, speed)
                over += 1 if row.going[k] == 1 and counts.end[k] != 0 else 0
        if from_truth and count is not None:
            for k in range(len(row.blade)):
                across = 0.0 if force is None else force(lanes, k)
                count(stepping.step, k, row.blade[k] - row.creep[k], row.tip[k], across)
        for k in range(row.taken if len(readings) > 0 else 0):
            if row.going[k] == 1:
                note(row, k, readings[row.cut[k], i], TICK)
        return over

    return advance_row


@compiled_for(njit_internal)
def count_seen(task: Task) -> Callable[..., None]:
    """Return the function that counts readings with a rig's knowledge."""
    expect, learn, count, size, across = task.expect_at, task.learn, task.count, task.size, WAYS - 1
    sideways, felt_along = task.motion.force is not None, task.felt_along

    def count_seen(stepping: Stepping, k: Integer, position: float, speed: float) -> None:
        """Count lane ``k``'s reading of the motor [m], [m/s], estimating tip and runs."""
        cuts, counts, c, felt = stepping.cuts, stepping.count, stepping.row.cut[k], stepping.row.felt[k]
        known, nominal = cuts.known[c], cuts.nominals[c]
        tick = round(counts.time[k] / TICK) + 1
        if expect is not None:
            expect(cuts, c, counts.updates[k] == 0, tick, position)
        depth = max(depth_at(nominal, position), SHALLOWEST)
        pull = felt if felt_along is None else felt_along(known, position, felt)
        reading = BladeReading(position, speed, depth, pull)
        tip, jump = estimated_tip(known.tip[0], cuts.tasks[c], nominal, tick, reading)
        if learn is not None:
            learn(known, tick, position, tip)
        force = felt if size is None else size(felt, known.ways[across])
        held = norm_held(felt, known.ways[across], pull) if sideways else felt
        count_lane(counts, k, Millisecond(position, speed, force, felt, held, tip, jump, depth))
        if count is not None:
            count(stepping.step, k, position, tip, known.ways[across])

    return count_seen


@compiled_for(njit_internal)
def conclude_lane(task: Task) -> Callable[..., int]:
    """Return the function that concludes the step of a cut."""
    conclude_cut, stored = assess_step(task), task.motion.stored

    def conclude_lane(
        stepping: Stepping, k: Integer, action: StructArray, observation: StructArray, info: Struct
    ) -> int:
        """Compute lane ``k``'s reward terms, observation and info; return end."""
        cuts, c = stepping.cuts, stepping.row.cut[k]
        end: int = conclude_cut(stepping, k, action, observation, info)
        tell(cuts, c, info)
        if stored is not None:
            further = stored(cuts.motions[c])
            info.energy_stored += further
            info.energy_residual -= further
        return end

    return conclude_lane


@compiled_for(njit_inline)
def assess_step(task: Task) -> Callable[..., int]:
    """Return the function that assesses and observes a counted step."""
    survey, breached, achieved, from_truth = task.survey, task.breached, task.achieved, task.from_truth
    charge_whole = charge(task) if task.costs else None
    left = task.left_loaded if from_truth else task.left_loaded_seen
    observe = task.observe if from_truth else task.observe_seen

    def assess_step(stepping: Stepping, k: Integer, action: StructArray, observation: StructArray, info: Struct) -> int:
        """Compute lane ``k``'s reward terms and observation; return its end."""
        cuts, count, c = stepping.cuts, stepping.count, stepping.row.cut[k]
        whole, wanted, progress = cuts.wholes[c], cuts.tasks[c], cuts.progresses[c]
        if survey is not None:
            motion = cuts.motions[c] if from_truth else cuts.known[c].motion[0]
            survey(whole, motion, stepping.step, k, count.tip[k])
        if charge_whole is not None:
            charge_whole(whole, wanted.target)
        # A further end for safety is charged as one at the limit of force: for all that stopping could still have cost.
        breach = False
        if breached is not None:
            breach = breached(whole) and (count.end[k] == 0 or count.end[k] > _SAFETY_CODES)
        if breach:
            count.end[k] = _SAFETY
        conclude(stepping, k, action, observation, info)
        if progress.end != 0:
            charge_end(wanted, progress, cuts.profiles[c] if from_truth else cuts.nominals[c], info)
            if left is not None:
                energy, toughness = left(cuts, c)
                if energy >= 0.0:
                    charge_stored(wanted, energy, toughness, info)
        success = succeeded(wanted, progress)
        if achieved is not None:
            success = success and achieved(whole, wanted.target)
        whole.success = 1 if success else 0
        if not success:
            info.reward_terms_success = 0.0
        progress.end = _FURTHER_END if breach else progress.end
        if observe is not None:
            observe(stepping, k, action, observation)
        return progress.end  # type: ignore[no-any-return]

    return assess_step


@compiled_for(njit)
def assess_readings(task: Task) -> Callable[..., tuple[float, int]]:
    """Return the function that assesses and observes a rig's readings."""
    see, begin_step, finish, scalars = count_seen(task), task.begin_step, assess_step(task), task.motion.scalars
    total = terms(task) if task.costs else None

    def assess_readings(
        one: OneCut, readings: StructArray, ways: Array, action: StructArray, observation: StructArray
    ) -> tuple[float, int]:
        """Assess and observe readings, estimating tip, runs and whole cut.

        The cut in ``one`` is memory alone.  Readings after an end do not count; ``ways``, (n, WAYS), are further
        measurements at each, the force across the cut [N] last.  Fill the observation; return the reward, and the end
        as an index in :attr:`~cutenv.task.declare.Task.ends`.
        """
        c, e = one.cut[0], one.episode[0]
        row, plain = first_row(c.rows), plain_views(c.rows, c.states, c.laws, c.drives)
        moving = Moving(first_row(c.lanes), lane_views(c.lanes, c.motions, 1, scalars), c.motions, one.shared)
        stepping = Stepping(batch_of_one(one), row, plain, moving, first_row(e.counts), first_row(e.steps))
        progress, known = e.progresses[0], e.known[0]
        row.cut[0], row.felt[0], row.angle[0] = 0, 0.0, 0.0
        begin_count(stepping.count, 0, e.tasks[0], progress)
        if begin_step is not None:
            begin_step(stepping.step, 0, min(progress.position, known.tip[0].tip))
        for i in range(len(readings)):
            reading = readings[i]
            row.felt[0], row.angle[0] = reading.force, reading.angle
            for m in range(WAYS):
                known.ways[m] = ways[i, m]
            see(stepping, 0, reading.position, reading.speed)
            if stepping.count.end[0] != 0:
                break
        end = finish(stepping, 0, action, observation, e.infos[0])
        reward = add_terms(as_float64_view(e.infos), e.totals)
        if total is not None:
            reward += total(e.wholes[0])
        return reward, end

    return assess_readings


@compiled_for(njit)
def observe_one(task: Task) -> Callable[..., None]:
    """Return the function that observes one cut at its start."""
    observe, from_truth = task.observe_start, task.from_truth

    def observe_one(one: OneCut, angle: float, observation: StructArray) -> None:
        """Fill one cut's start observation at ``angle`` [rad]."""
        cuts = batch_of_one(one)
        observe_rest(one.episode[0].counts, cuts, 0, angle, observation)
        if observe is not None:
            observe(cuts, 0, cuts.motions[0] if from_truth else cuts.known[0].motion[0], observation)

    return observe_one


@njit
def tell_one(one: OneCut) -> None:
    """Fill one cut's start `info`, without reward."""
    tell(batch_of_one(one), 0, one.episode[0].infos[0])


@njit
def tell_of_all(cuts: Cuts, which: StructArray, infos: StructArray) -> None:
    """Fill start ``infos`` of the cuts ``which``, without reward."""
    for n in which:
        tell(cuts, n, infos[n])


@njit_inline
def flat_views(cuts: Cuts, plain: Plain, infos: StructArray) -> tuple[StructArray, ...]:
    """Return flat views of prefetched records, ``infos`` last."""
    return (
        plain.states, plain.laws, plain.drives, as_float64_view(cuts.sensors), as_float64_view(cuts.tasks),
        as_float64_view(cuts.progresses), as_float64_view(infos),
    )  # fmt: skip


@njit_inline
def fetch_some(cuts: Cuts, ahead: Ahead, i: int) -> None:
    """Prefetch part of the cuts ``ahead`` during millisecond ``i``.

    Thousands of cuts do not fit into the first-level cache.  Their records come first, because these contain the grid
    indices of tip and blade, and then the profiles there.
    """
    fetched, first, last = ahead
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
    """Prefetch ``size`` numbers of cut ``n``, aligned or not."""
    for k in range(0, size - 1, _LINE):
        prefetch(numbers, size * n + k)
    prefetch(numbers, size * n + size - 1)


@njit_inline
def _fetch_places(state: Struct, profile: Struct, nominal: Struct, specimen: Struct, sensor: Struct) -> None:
    """Prefetch profiles at tip and blade, and the sensor's delay."""
    tip, blade = grid_index(state.tip)[0], grid_index(state.blade)[0]
    prefetch(profile.stiffness, tip)
    prefetch(profile.toughness, tip)
    prefetch(profile.depth, blade)
    prefetch(nominal.depth, blade)
    prefetch(specimen.modulus, tip)
    prefetch(specimen.fracture_resistance, tip)
    for k in range(-2 * _LINE, 3 * _LINE, _LINE):
        prefetch(sensor.line, (state.tick + k) & WRAP)
