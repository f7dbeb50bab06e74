"""Stepping cuts whose depth is an action: one compiled call for one cut, or for many on all cores."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view, prefetch
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.lanes import first_row
from cutenv._engine.randomness import Integer
from cutenv.cutting.beside_row import Beside, beside_views, put_beside, take_beside
from cutenv.cutting.descending_row import LEVEL_ROW, LEVEL_SCALARS, ONE_LEVEL, descending_row, lower_row
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import grid_index
from cutenv.cutting.row import LANES, begin, plain_views, put
from cutenv.cutting.sensor import feel_row
from cutenv.cutting.update import drive_row
from cutenv.task.assessment import add_terms, succeeded
from cutenv.task.cuts import Cuts, batch_of_one, conclude_cut, count_row, take_cut
from cutenv.task.depth_assessment import (
    DEPTH_COUNTED,
    as_deep_as_wanted,
    begin_depth_step,
    charge_depth,
    count_depth,
    observe_depth,
    survey,
)
from cutenv.task.depth_terms import DESCENT_SCALE, LAYER
from cutenv.task.map_steps import MapLanes, map_stepper, step_counts
from cutenv.task.observation import DEAD_ZONE
from cutenv.task.reward import ENDS, SAFETY_ENDS

_SAFETY = ENDS.index("force_limit")  # whose charges an end in the layer below shares
_ROW = MapLanes(LEVEL_ROW, LEVEL_SCALARS, step_counts(DEPTH_COUNTED, LANES))
DEPTH_STEP_MEMORY = MapLanes(ONE_LEVEL, LEVEL_SCALARS, step_counts(DEPTH_COUNTED, 1)).memory
"""Memory of a call of :func:`step_depth_one`."""
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
    memory: StructArray,
) -> tuple[float, int]:
    """Step one cut by one decision; return its reward and end, see :data:`step_depth_some`.

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
    memory : Records, shape (1,)
        :data:`DEPTH_STEP_MEMORY` of the call.
    """
    c, e = cuts[0], episodes[0]
    one, beside = batch_of_one(c, e), (descents, depths, slabs)
    row, count = first_row(c.rows), first_row(e.counts)
    plain, numbers = plain_views(c.rows, c.states, c.laws, c.drives), as_float64_view(e.infos)
    level, step = first_row(memory[0].motion), first_row(memory[0].step)
    along = beside_views(memory[0].motion, descents, 1, LEVEL_SCALARS)
    take_cut(one, row, plain, count, action, 0, 0)
    take_beside(along, 0, 0)
    _begin_lane(step, 0, action[0, 2], c.states[0], level)
    begin(row, plain, 1)
    for i in range(ticks):
        _advance(one, beside, row, level, along, count, step, readings, i)
        vertical[0, i] = level.vertical[0]
        if count.end[0] != 0:
            break
    put(row, plain, 0, 0)
    put_beside(along, 0, 0)
    end = _conclude(one, beside, 0, row, count, step, 0, action[0], observations[0], e.infos[0])
    return add_terms(numbers, e.totals) + terms_of(depths[0]), end


@njit_inline
def _begin_lane(step: Struct, k: Integer, action: float, state: Struct, levels: Struct) -> None:
    """Prepare lane ``k`` for a descent action."""
    begin_depth_step(step, k, state.tip)
    levels.descent_speed[k] = commanded_descent(action)


@njit_inline
def _fetch(beside: tuple[StructArray, ...], cuts: Cuts, i: int, first: Integer, last: Integer) -> None:
    """Prefetch vertical motion and depth of two cuts of the next row, ``first`` to before ``last``."""
    for c in range(first + 2 * i, min(first + 2 * (i + 1), last)):
        descent, depth = beside[0][c], beside[1][c]
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
def _advance(
    cuts: Cuts,
    beside: tuple[StructArray, ...],
    row: Struct,
    levels: Struct,
    along: Beside,
    count: Struct,
    step: Struct,
    readings: StructArray,
    i: int,
) -> int:
    """Advance and count millisecond ``i`` of a row; return how many of its cuts end with it."""
    drive_row(row, TICK)
    lower_row(levels)
    descending_row(row, levels, along, cuts.profiles, beside[0], beside[2], TICK)
    feel_row(row, cuts.sensors, i == 0)
    over = count_row(cuts, row, count, row.force, True, readings, i)
    for k in range(len(row.blade)):
        count_depth(step, k, min(row.blade[k] - row.creep[k], row.tip[k]), levels.vertical[k])
    return over


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
    descent, depth, task, progress = beside[0][c], beside[1][c], cuts.tasks[c], cuts.progresses[c]
    survey(depth, descent, step.reached[k] - descent.edge_length)
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
        (step.vertical_sum[k], step.vertical_max[k]), action[2], observation,
    )  # fmt: skip
    return progress.end  # type: ignore[no-any-return]


step_depth_some = map_stepper("step_depth_some", _ROW, _begin_lane, _fetch, _advance, _conclude, terms_of)
"""Step n cuts by one decision, with their vertical motions, their depths and the slab of them all; see
:mod:`cutenv.task.map_steps`."""


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
