"""Stepping cuts along a line: one compiled call for one cut, or for many on all cores."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view, keep_alive, prefetch, without_refcount
from cutenv._engine.jit import njit, njit_inline, njit_internal, njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.randomness import Integer
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import depth_at, grid_index
from cutenv.cutting.row import LANES, ROW, begin, note, plain_views, put
from cutenv.cutting.sensor import feel_row
from cutenv.cutting.steering import STEERING, steered_row
from cutenv.cutting.update import drive_row
from cutenv.task.assessment import COUNT, add_terms, count_lane, reward_of, succeeded
from cutenv.task.cuts import Cuts, conclude_cut, fetch_some, flat_views, take_cut
from cutenv.task.observation import DEAD_ZONE
from cutenv.task.path_assessment import (
    LATERAL_PEAK,
    LATERAL_SUM,
    N_REMEMBERED_ASIDE,
    PLANE_FORCE,
    TURN_COMMAND,
    begin_path_step,
    charge_path,
    count_lateral,
    near_enough,
    observe_path,
    survey_path,
)
from cutenv.task.path_terms import OFF_LINE, TURN_SCALE
from cutenv.task.reward import ENDS, SAFETY_ENDS, WORST_STORED
from cutenv.tissue.grid import N_POINTS

_SAFETY = ENDS.index("force_limit")  # whose charges an end off the line shares
_SAFETY_CODES = max(ENDS.index(name) for name in SAFETY_ENDS)  # the ends for safety are the first ones
_STORED_LENGTH = 0.003  # [m], as in the term "stored"
_AHEAD = 10  # points of the grid in the first distance at which the line is observed
_STEERING, _LINES = np.int64(STEERING.itemsize // 8), 5  # numbers in a record; cache lines of its first ones


@njit_internal
def commanded_turn(action: float) -> float:
    """Return the rate of turn [rad/s] that a turn action, -1 to 1, commands: 0 in the dead zone, linear beyond."""
    return TURN_SCALE * ((action - min(max(action, -DEAD_ZONE), DEAD_ZONE)) / (1.0 - DEAD_ZONE))


@njit
def step_path_one(
    cuts: StructArray,
    episodes: StructArray,
    steerings: StructArray,
    paths: StructArray,
    ticks: int,
    action: StructArray,
    observations: StructArray,
    readings: StructArray,
    lateral: StructArray,
) -> tuple[float, int]:
    """Step one cut by one decision; return its reward and end, see :func:`step_path_some`.

    Parameters
    ----------
    cuts, episodes : Records, shape (1,)
        :data:`~cutenv.cutting.simulate.CUT` and :data:`~cutenv.task.cuts.EPISODE`, changed in place.
    steerings, paths : Records, shape (1,)
        Place in the plane, and path, changed.
    ticks : int
        Milliseconds until the next decision.
    action, observations, readings, lateral : array, shape (1, 3), (1, 28) float32, (1, ticks), (1, ticks)
        Action within [-1, 1]; observation, readings and true lateral force [N]: filled.
    """
    c, e = cuts[0], episodes[0]
    one = Cuts(
        c.states, c.profiles, c.laws, c.drives, c.sensors, e.tasks, e.progresses, e.nominals, e.specimens, e.tips
    )  # fmt: skip
    row, count = first_row(c.rows), first_row(e.counts)
    plain, numbers, turns = plain_views(c.rows, c.states, c.laws, c.drives), as_float64_view(e.infos), np.empty(1)
    step = np.zeros((N_REMEMBERED_ASIDE, 1))
    take_cut(one, row, plain, count, action, 0, 0)
    begin_path_step(step, 0, commanded_turn(action[0, 2]))
    begin(row, plain, 1)
    turns[0] = step[TURN_COMMAND, 0] * TICK
    for i in range(ticks):
        _advance_path(one, steerings, turns, row, count, step, readings, lateral, i)
        if count.end[0] != 0:
            break
    put(row, plain, 0, 0)
    end = _conclude_path(one, steerings, paths, 0, row, count, step, 0, action[0], observations[0], e.infos[0])
    return add_terms(numbers, e.totals) + terms_of_path(paths[0]), end


@njit_nogil
def step_path_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    steerings: StructArray,
    paths: StructArray,
    ticks: int,
    waiting: StructArray,
    actions: StructArray,
    observations: StructArray,
    rewards: StructArray,
    ends: StructArray,
    infos: StructArray,
    readings: StructArray,
    lateral: StructArray,
) -> None:
    """Step n cuts by one decision, assessed by hidden state; as :func:`cutenv.task.cuts.step_some`.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts, steerings, paths : Cuts, Records
        The cuts, their places in the plane and their paths, changed in place.
    ticks, waiting, rewards, ends, infos, readings
        See :func:`cutenv.task.cuts.step_some`; ``ends`` are indices in :data:`cutenv.task.path_terms.PATH_ENDS`.
    actions, observations : array, shape (n, 3), (n, 28) float32
        Actions within [-1, 1]; observations: filled.
    lateral : array, shape (n, ticks) or (0, 0)
        Filled with the true lateral force [N], unless it has no rows.
    """
    cuts = without_refcount(cuts)
    waiting, actions, observations, rewards, ends, infos, readings, lateral, steerings, paths = without_refcount(
        (waiting, actions, observations, rewards, ends, infos, readings, lateral, steerings, paths)
    )
    rows, counts, turns = np.zeros(1, ROW), np.zeros(1, COUNT), np.empty(len(paths))
    step = np.zeros((N_REMEMBERED_ASIDE, LANES))
    row, count = first_row(rows), first_row(counts)
    plain, numbers = plain_views(rows, cuts.states, cuts.laws, cuts.drives), as_float64_view(infos)
    fetched, places = flat_views(cuts, plain, infos), as_float64_view(steerings)
    first, last = next_chunk(passed, core, LANES)
    while first < last:
        following = next_chunk(passed, core, LANES)
        taken = 0
        for n in range(first, last):
            if waiting[n]:
                rewards[n], ends[n] = 0.0, 0
            else:
                take_cut(cuts, row, plain, count, actions, taken, n)
                begin_path_step(step, taken, commanded_turn(actions[n, 2]))
                turns[n] = step[TURN_COMMAND, taken] * TICK
                taken += 1
        if taken > 0:
            begin(row, plain, taken)
        for i in range(ticks + 1 if taken > 0 else 0):
            fetch_some(cuts, fetched, i, following[0], following[1])
            fetch_path(steerings, paths, places, cuts, i, following[0], following[1])
            over = taken  # after the last millisecond, all of them
            if i < ticks:
                over = _advance_path(cuts, steerings, turns, row, count, step, readings, lateral, i)
            for k in range(taken if over > 0 else 0):
                if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                    c = row.cut[k]
                    row.going[k] = 0
                    put(row, plain, k, c)
                    ends[c] = _conclude_path(
                        cuts, steerings, paths, c, row, count, step, k, actions[c], observations[c], infos[c]
                    )
                    rewards[c] = reward_of(numbers, c) + terms_of_path(paths[c])
        mark_done(passed, core, last - first)
        first, last = following
    keep_alive(rows)
    keep_alive(counts)


@njit_inline
def fetch_path(
    steerings: StructArray, paths: StructArray, places: StructArray, cuts: Cuts, i: int, first: Integer, last: Integer
) -> None:
    """Prefetch place and path of two cuts of the next row, ``first`` to before ``last``; ``places`` are flat."""
    for c in range(first + 2 * i, min(first + 2 * (i + 1), last)):
        steering = steerings[c]
        for k in range(_LINES):
            prefetch(places, _STEERING * c + 8 * k)
        tip, blade = grid_index(cuts.states[c].tip)[0], grid_index(cuts.states[c].blade)[0]
        for k in (tip, blade, blade + _AHEAD, blade + 2 * _AHEAD, blade + 4 * _AHEAD):
            at = min(k, N_POINTS - 1)
            prefetch(steering.x_excess, at)
            prefetch(steering.y, at)
            prefetch(steering.cosine, at)
            prefetch(steering.sine, at)
            prefetch(steering.curvature, at)
        prefetch(steering.belongs, tip)
        prefetch(steering.cut, tip)
        prefetch(steering.along, tip)
        prefetch(steering.coupled, tip)
        prefetch(steering.sideways, tip)
        prefetch(steering.toughness, tip)


@njit_inline
def terms_of_path(path: Struct) -> float:
    """Return the sum of the costs that the path adds to the reward of a step."""
    return path.term_off_line + path.term_farthest  # type: ignore[no-any-return]


@njit_inline
def _advance_path(
    cuts: Cuts,
    steerings: StructArray,
    turns: StructArray,
    row: Struct,
    count: Struct,
    step: StructArray,
    readings: StructArray,
    lateral: StructArray,
    i: int,
) -> int:
    """Advance and count millisecond ``i`` of a row; return how many of its cuts end with it."""
    drive_row(row, TICK)
    steered_row(row, cuts.profiles, steerings, turns, TICK)
    feel_row(row, cuts.sensors, i == 0)
    for k in range(len(row.blade)):
        count_lateral(step, k, row.force[k], row.lateral[k])
    over = 0
    if row.slack == 0:
        for k in range(len(row.blade)):
            count_lane(
                count, k, row.blade[k], row.speed[k], step[PLANE_FORCE, k], row.felt[k], row.tip[k], row.jump[k],
                row.depth[k],
            )  # fmt: skip
            over += 1 if row.going[k] == 1 and count.end[k] != 0 else 0
    else:
        for k in range(row.taken):  # the encoder sits at the motor
            position, speed = row.blade[k], row.speed[k]
            if row.backlash[k] > 0.0:
                position, speed = row.hand[k], row.hand_speed[k]
            count_lane(
                count, k, position, speed, step[PLANE_FORCE, k], row.felt[k], row.tip[k], row.jump[k],
                depth_at(cuts.profiles[row.cut[k]], position),
            )  # fmt: skip
            over += 1 if row.going[k] == 1 and count.end[k] != 0 else 0
    for k in range(row.taken if len(readings) > 0 else 0):
        if row.going[k] == 1:
            note(row, k, readings[row.cut[k], i], TICK)
    for k in range(row.taken if len(lateral) > 0 else 0):
        if row.going[k] == 1:
            lateral[row.cut[k], i] = row.lateral[k]
    return over


@njit_internal
def _conclude_path(
    cuts: Cuts,
    steerings: StructArray,
    paths: StructArray,
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
    steering, path, task, progress = steerings[c], paths[c], cuts.tasks[c], cuts.progresses[c]
    survey_path(path, steering, row.tip[k])
    charge_path(path, task.target)
    # It is charged as an end at the limit of force is: for all that stopping could still have cost.
    lost = path.farthest > path.line_limit and (count.end[k] == 0 or count.end[k] > _SAFETY_CODES)
    if lost:
        count.end[k] = _SAFETY
    conclude_cut(cuts, c, row, count, k, True, action, observation, info)
    if progress.end != 0 and steering.held > 0.0:  # tissue is left loaded to the side, too
        reduced = max(row.blade[k] - row.creep[k] - row.tip[k], 0.0)
        stored = 0.5 * row.K[k] * reduced * reduced + steering.held
        info.reward_terms_stored = 0.0 - task.stored * min(stored / (row.toughness[k] * _STORED_LENGTH), WORST_STORED)
    path.success = 1 if succeeded(task, progress) and near_enough(path, task.target) else 0
    if path.success == 0:
        info.reward_terms_success = 0.0
    progress.end = OFF_LINE if lost else progress.end
    info.energy_stored += steering.held
    info.energy_residual -= steering.held
    observe_path(
        path, steering, cuts.sensors[c], cuts.states[c].tick, progress.updates, row.blade[k],
        (step[LATERAL_SUM, k], step[LATERAL_PEAK, k]), action[2], observation,
    )  # fmt: skip
    return progress.end  # type: ignore[no-any-return]


def path_errors(paths: StructArray, tips: StructArray) -> dict[str, Any]:
    """Return the path of n cuts so far in numbers, each of shape (n,), for tips on their lines [m].

    They are the area between cut and line [mm2], and mean and largest distance between them [mm].
    """
    cut = np.maximum(tips - paths["begun"], 1e-9)
    return {
        "area_mm2": 1e6 * paths["area"],
        "mean_distance_mm": 1e3 * paths["distance"] / cut,
        "largest_distance_mm": 1e3 * paths["farthest"],
    }
