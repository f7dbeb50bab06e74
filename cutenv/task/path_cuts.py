"""Stepping cuts along a line: one compiled call for one cut, or for many on all cores."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view, prefetch
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.lanes import first_row
from cutenv._engine.randomness import Integer
from cutenv.cutting.beside_row import Beside, beside_views, put_beside, take_beside
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import grid_index
from cutenv.cutting.row import LANES, begin, plain_views, put
from cutenv.cutting.sensor import feel_row
from cutenv.cutting.steered_row import ONE_PLACE, PLACE_ROW, PLACE_SCALARS, aim_place, steered_row
from cutenv.cutting.steering import STEERING
from cutenv.cutting.update import drive_row
from cutenv.task.assessment import add_terms, succeeded
from cutenv.task.cuts import Cuts, batch_of_one, conclude_cut, count_row, take_cut
from cutenv.task.map_steps import MapLanes, map_stepper, step_counts
from cutenv.task.observation import DEAD_ZONE
from cutenv.task.path_assessment import (
    PATH_COUNTED,
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
_ROW = MapLanes(PLACE_ROW, PLACE_SCALARS, step_counts(PATH_COUNTED, LANES))
PATH_STEP_MEMORY = MapLanes(ONE_PLACE, PLACE_SCALARS, step_counts(PATH_COUNTED, 1)).memory
"""Memory of a call of :func:`step_path_one`."""
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
    memory: StructArray,
) -> tuple[float, int]:
    """Step one cut by one decision; return its reward and end, see :data:`step_path_some`.

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
    memory : Records, shape (1,)
        :data:`PATH_STEP_MEMORY` of the call.
    """
    c, e = cuts[0], episodes[0]
    one, beside = batch_of_one(c, e), (steerings, paths)
    row, count = first_row(c.rows), first_row(e.counts)
    plain, numbers = plain_views(c.rows, c.states, c.laws, c.drives), as_float64_view(e.infos)
    place, step = first_row(memory[0].motion), first_row(memory[0].step)
    along = beside_views(memory[0].motion, steerings, 1, PLACE_SCALARS)
    take_cut(one, row, plain, count, action, 0, 0)
    take_beside(along, 0, 0)
    _begin_lane(step, 0, action[0, 2], c.states[0], place)
    begin(row, plain, 1)
    for i in range(ticks):
        _advance(one, beside, row, place, along, count, step, readings, i)
        lateral[0, i] = row.lateral[0]
        if count.end[0] != 0:
            break
    put(row, plain, 0, 0)
    put_beside(along, 0, 0)
    end = _conclude(one, beside, 0, row, count, step, 0, action[0], observations[0], e.infos[0])
    return add_terms(numbers, e.totals) + terms_of_path(paths[0]), end


@njit_inline
def _begin_lane(step: Struct, k: Integer, action: float, state: Struct, places: Struct) -> None:
    """Prepare lane ``k`` for a turn action."""
    begin_path_step(step, k)
    aim_place(places, k, commanded_turn(action) * TICK)


@njit_inline
def _fetch(beside: tuple[StructArray, ...], cuts: Cuts, i: int, first: Integer, last: Integer) -> None:
    """Prefetch place and path of two cuts of the next row, ``first`` to before ``last``."""
    places = as_float64_view(beside[0])
    for c in range(first + 2 * i, min(first + 2 * (i + 1), last)):
        steering = beside[0][c]
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
def _advance(
    cuts: Cuts,
    beside: tuple[StructArray, ...],
    row: Struct,
    places: Struct,
    along: Beside,
    count: Struct,
    step: Struct,
    readings: StructArray,
    i: int,
) -> int:
    """Advance and count millisecond ``i`` of a row; return how many of its cuts end with it."""
    drive_row(row, TICK)
    steered_row(row, places, cuts.profiles, beside[0], TICK)
    feel_row(row, cuts.sensors, i == 0)
    for k in range(len(row.blade)):
        count_lateral(step, k, row.lateral[k])
        # Without a lateral force it is the size to the last bit.
        row.plane_force[k] = math.sqrt(row.force[k] * row.force[k] + row.lateral[k] * row.lateral[k])
    return count_row(cuts, row, count, row.plane_force, True, readings, i)


@njit_internal
def _conclude(
    cuts: Cuts,
    beside: tuple[StructArray, ...],
    c: int,
    row: Struct,
    count: Struct,
    step: Struct,
    k: int,
    action: StructArray,
    observation: StructArray,
    info: Struct,
) -> int:
    """Compute reward terms, observation and info for the step of cut number ``c``, in lane ``k``; return its end."""
    steering, path, task, progress = beside[0][c], beside[1][c], cuts.tasks[c], cuts.progresses[c]
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
        (step.lateral_sum[k], step.lateral_peak[k]), action[2], observation,
    )  # fmt: skip
    return progress.end  # type: ignore[no-any-return]


step_path_some = map_stepper("step_path_some", _ROW, _begin_lane, _fetch, _advance, _conclude, terms_of_path)
"""Step n cuts by one decision, with their places in the plane and their paths; see :mod:`cutenv.task.map_steps`."""


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
