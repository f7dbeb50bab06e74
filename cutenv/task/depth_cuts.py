"""Stepping cuts whose depth is an action: one compiled call for one cut, or for many on all cores."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view, keep_alive, prefetch, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.descending_cut import next_level
from cutenv.cutting.descent import descending_row
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import grid_index
from cutenv.cutting.row import LANES, ROW, begin, note, plain_views, put
from cutenv.cutting.sensor import feel_row
from cutenv.cutting.update import drive_row
from cutenv.task.assessment import COUNT, add_terms, count_lane, reward_of, succeeded
from cutenv.task.cuts import Cuts, conclude_cut, count_as_seen, fetch_some, flat_views, take_cut
from cutenv.task.depth_assessment import (
    COMMAND,
    N_REMEMBERED,
    REACHED,
    VERTICAL_MAX,
    VERTICAL_SUM,
    as_deep_as_wanted,
    begin_depth_step,
    charge_depth,
    count_depth,
    observe_depth,
    survey,
)
from cutenv.task.depth_terms import DESCENT_SCALE, LAYER
from cutenv.task.observation import DEAD_ZONE
from cutenv.task.reward import ENDS, SAFETY_ENDS

_SAFETY = ENDS.index("force_limit")  # whose charges an end in the layer below shares
N_MEMORY = N_REMEMBERED + 1
"""Numbers that :func:`step_depth_one` has to remember."""
_SAFETY_CODES = max(ENDS.index(name) for name in SAFETY_ENDS)  # the ends for safety are the first ones


@njit_internal
def commanded_descent(action: float) -> float:
    """Return the speed downwards [m/s] that a descent action, -1 to 1, commands: 0 in the dead zone, linear beyond."""
    return DESCENT_SCALE * ((action - min(max(action, -DEAD_ZONE), DEAD_ZONE)) / (1.0 - DEAD_ZONE))


@njit
def step_depth_one(
    cuts: StructArray,
    episodes: StructArray,
    descents: StructArray,
    depths: StructArray,
    slabs: StructArray,
    ticks: int,
    action: StructArray,
    observations: StructArray,
    readings: StructArray,
    vertical: StructArray,
    memory: Array,
) -> tuple[float, int]:
    """Step one cut by one decision; return its reward and end, see :func:`step_depth_some`.

    Parameters
    ----------
    cuts, episodes : Records, shape (1,)
        :data:`~cutenv.cutting.simulate.CUT` and :data:`~cutenv.task.cuts.EPISODE`, changed in place.
    descents, depths, slabs : Records, shape (1,)
        Vertical motion, depth (both changed), slab.
    ticks : int
        Milliseconds until the next decision.
    action, observations, readings, vertical : array, shape (1, 3), (1, 22) float32, (1, ticks), (1, ticks)
        Action within [-1, 1]; observation, readings and true vertical force [N]: filled.
    memory : array, shape (N_MEMORY, 1)
        Memory of the call: in a browser nothing can be allocated.
    """
    c, e = cuts[0], episodes[0]
    one = Cuts(
        c.states, c.profiles, c.laws, c.drives, c.sensors, e.tasks, e.progresses, e.nominals, e.specimens, e.tips
    )  # fmt: skip
    row, count = first_row(c.rows), first_row(e.counts)
    plain, numbers = plain_views(c.rows, c.states, c.laws, c.drives), as_float64_view(e.infos)
    step, levels = memory, memory[N_REMEMBERED]
    take_cut(one, row, plain, count, action, 0, 0)
    begin_depth_step(step, 0, commanded_descent(action[0, 2]), c.states[0].tip)
    begin(row, plain, 1)
    for i in range(ticks):
        _advance_depth(one, descents, depths, slabs, levels, row, count, step, readings, vertical, i)
        if count.end[0] != 0:
            break
    put(row, plain, 0, 0)
    end = _conclude_depth(one, descents, depths, 0, row, count, step, 0, action[0], observations[0], e.infos[0])
    return add_terms(numbers, e.totals) + terms_of(depths[0]), end


@njit_nogil
def step_depth_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    descents: StructArray,
    depths: StructArray,
    slabs: StructArray,
    ticks: int,
    waiting: StructArray,
    actions: StructArray,
    observations: StructArray,
    rewards: StructArray,
    ends: StructArray,
    infos: StructArray,
    readings: StructArray,
    vertical: StructArray,
) -> None:
    """Step n cuts by one decision, assessed by hidden state; as :func:`cutenv.task.cuts.step_some`.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts, descents, depths : Cuts, Records
        The cuts, their vertical motions and depths, changed in place.
    slabs : Records
        The slab of them all, shape (1,).
    ticks, waiting, rewards, ends, infos, readings
        See :func:`cutenv.task.cuts.step_some`; ``ends`` are indices in :data:`cutenv.task.depth_terms.DEPTH_ENDS`.
    actions, observations : array, shape (n, 3), (n, 22) float32
        Actions within [-1, 1]; observations: filled.
    vertical : array, shape (n, ticks) or (0, 0)
        Filled with the true vertical force [N], unless it has no rows.
    """
    cuts = without_refcount(cuts)
    waiting, actions, observations, rewards, ends, infos, readings, vertical, descents, depths, slabs = (
        without_refcount(
            (waiting, actions, observations, rewards, ends, infos, readings, vertical, descents, depths, slabs)
        )
    )
    rows, counts, levels = np.zeros(1, ROW), np.zeros(1, COUNT), np.empty(len(depths))
    step = np.empty((N_REMEMBERED, LANES))
    row, count = first_row(rows), first_row(counts)
    plain, numbers = plain_views(rows, cuts.states, cuts.laws, cuts.drives), as_float64_view(infos)
    fetched = flat_views(cuts, plain, infos)
    first, last = next_chunk(passed, core, LANES)
    while first < last:
        following = next_chunk(passed, core, LANES)
        taken = 0
        for n in range(first, last):
            if waiting[n]:
                rewards[n], ends[n] = 0.0, 0
            else:
                take_cut(cuts, row, plain, count, actions, taken, n)
                begin_depth_step(step, taken, commanded_descent(actions[n, 2]), cuts.states[n].tip)
                taken += 1
        if taken > 0:
            begin(row, plain, taken)
        for i in range(ticks + 1 if taken > 0 else 0):
            fetch_some(cuts, fetched, i, following[0], following[1])
            fetch_depth(descents, depths, cuts, i, following[0], following[1])
            over = taken  # after the last millisecond, all of them
            if i < ticks:
                over = _advance_depth(cuts, descents, depths, slabs, levels, row, count, step, readings, vertical, i)
            for k in range(taken if over > 0 else 0):
                if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                    c = row.cut[k]
                    row.going[k] = 0
                    put(row, plain, k, c)
                    ends[c] = _conclude_depth(
                        cuts, descents, depths, c, row, count, step, k, actions[c], observations[c], infos[c]
                    )
                    rewards[c] = reward_of(numbers, c) + terms_of(depths[c])
        mark_done(passed, core, last - first)
        first, last = following
    keep_alive(rows)
    keep_alive(counts)


@njit_inline
def fetch_depth(descents: StructArray, depths: StructArray, cuts: Cuts, i: int, first: int, last: int) -> None:
    """Prefetch vertical motion and depth of two cuts of the next row, ``first`` to before ``last``."""
    for c in range(first + 2 * i, min(first + 2 * (i + 1), last)):
        descent, depth = descents[c], depths[c]
        place = grid_index(cuts.states[c].tip)[0]
        for k in (max(place - 8, 0), place):  # the edge lies behind the tip
            prefetch(descent.belongs, k)
            prefetch(descent.surface, k)
            prefetch(descent.floor, k)
            prefetch(descent.toughness, k)
            prefetch(depth.counted, k)
            prefetch(depth.wanted, k)
        prefetch(descent.far, place)
        prefetch(descent.near, place)


@njit_inline
def terms_of(depth: Struct) -> float:
    """Return the sum of the costs that depth adds to the reward of a step; at most 0 but for what is refunded."""
    return depth.term_too_deep + depth.term_uncut + depth.term_layer_area + depth.term_layer_depth  # type: ignore[no-any-return]


@njit_inline
def _advance_depth(
    cuts: Cuts,
    descents: StructArray,
    depths: StructArray,
    slabs: StructArray,
    levels: StructArray,
    row: Struct,
    count: Struct,
    step: StructArray,
    readings: StructArray,
    vertical: StructArray,
    i: int,
) -> int:
    """Advance and count millisecond ``i`` of a row; return how many of its cuts end with it."""
    drive_row(row, TICK)
    for k in range(row.taken):
        c = row.cut[k]
        if row.going[k] == 1:
            held = step[COMMAND, k] == 0.0 and descents[c].level_speed == 0.0
            levels[c] = descents[c].level if held else next_level(descents[c], step[COMMAND, k])
    descending_row(row, cuts.profiles, descents, slabs, levels, TICK)
    feel_row(row, cuts.sensors, i == 0)
    over = 0
    if row.slack == 0:
        for k in range(len(row.blade)):
            count_lane(
                count, k, row.blade[k], row.speed[k], row.force[k], row.felt[k], row.tip[k], row.jump[k], row.depth[k]
            )
    else:
        for k in range(row.taken):
            count_as_seen(cuts, row, count, k, True)
    for k in range(row.taken):
        if row.going[k] == 1:
            c = row.cut[k]
            over += 1 if count.end[k] != 0 else 0
            count_depth(step, k, min(row.blade[k] - row.creep[k], row.tip[k]), descents[c].vertical)
            if len(readings) > 0:
                note(row, k, readings[c, i], TICK)
            if len(vertical) > 0:
                vertical[c, i] = descents[c].vertical
    return over


@njit_internal
def _conclude_depth(
    cuts: Cuts,
    descents: StructArray,
    depths: StructArray,
    c: int,
    row: Struct,
    count: Struct,
    step: StructArray,
    k: int,
    action: StructArray,
    observation: StructArray,
    info: Struct,
) -> int:
    """Compute reward terms, observation and info for the step of cut number ``c``, in lane ``k``; return its end."""
    descent, depth, task, progress = descents[c], depths[c], cuts.tasks[c], cuts.progresses[c]
    survey(depth, descent, step[REACHED, k] - descent.edge_length)
    charge_depth(depth, task.target)
    # It is charged as an end at the limit of force is: for all that stopping could still have cost.
    in_layer = depth.deepest > depth.layer_limit and (count.end[k] == 0 or count.end[k] > _SAFETY_CODES)
    if in_layer:
        count.end[k] = _SAFETY
    conclude_cut(cuts, c, row, count, k, True, action, observation, info)
    depth.success = 1 if succeeded(task, progress) and as_deep_as_wanted(depth, task.target) else 0
    if depth.success == 0:
        info.reward_terms_success = 0.0
    progress.end = LAYER if in_layer else progress.end
    info.energy_stored += descent.pressed
    info.energy_residual -= descent.pressed
    observe_depth(
        depth, descent, cuts.nominals[c], cuts.sensors[c], cuts.states[c].tick, progress.updates, progress.position,
        (step[VERTICAL_SUM, k], step[VERTICAL_MAX, k]), action[2], observation,
    )  # fmt: skip
    return progress.end  # type: ignore[no-any-return]


def depth_errors(depths: StructArray, targets: Array) -> dict[str, Any]:
    """Return the depth of n cuts in numbers, each of shape (n,): areas [mm2], depth into the layer, mean error [mm]."""
    areas = [np.maximum(depths[name], 0.0) for name in ("deep", "uncut", "layer")]  # rounding may leave -1e-20
    return {
        "too_deep_mm2": 1e6 * areas[0],
        "uncut_mm2": 1e6 * areas[1],
        "layer_mm2": 1e6 * areas[2],
        "layer_mm": 1e3 * np.maximum(depths["deepest"], 0.0),
        "mean_error_mm": 1e3 * (areas[0] + areas[1]) / targets,
    }
