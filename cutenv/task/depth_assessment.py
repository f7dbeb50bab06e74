"""Assessment of the depth of cut: a map of its floor, costs, the end in the layer below, and what is observed."""

from __future__ import annotations

import math
from typing import Any

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.fuse import fuse
from cutenv._engine.jit import njit_fused, njit_inline, njit_internal
from cutenv._engine.randomness import VERTICAL_NOISE, Integer, normal_at
from cutenv.cutting.law import depth_at
from cutenv.task import depth_terms
from cutenv.task.depth_terms import DEPTH_COMPONENTS, LOOK_AHEAD
from cutenv.task.map_costs import charge_lines, observe_lines
from cutenv.task.observation import COMPONENTS
from cutenv.task_quantities import (
    DEPTH_COSTS,
    DEPTH_TOLERANCE,
    LAYER_TOLERANCE,
    OF_MAP,
    into_layer,
    left_uncut,
    too_deep,
)
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING

_FIRST = len(COMPONENTS)  # component of the observation that depth adds first
_NORMALS = 4  # random numbers of a decision


def _fused(name: str, parameters: tuple[str, ...], lines: list[str]) -> Any:
    return njit_fused(fuse(name, list(parameters), lines, [depth_terms, __name__]))


_charge = _fused("_charge", ("depth", *OF_MAP), charge_lines(DEPTH_COSTS, "depth", OF_MAP))
_fill = _fused(
    "_fill", (*(one.name for one in DEPTH_COMPONENTS), "observation"), observe_lines(DEPTH_COMPONENTS, _FIRST)
)


@njit_internal
def survey(depth: Struct, descent: Struct, low: float) -> None:
    """Bring the map up to date from position ``low`` [m] to the tip, as deep as the floor of the cut is there."""
    for i in range(min(max(int(low * POINTS_PER_METRE) - 1, 0), depth.counts), descent.cell + 1):
        now, before, wanted = descent.surface[i] - descent.floor[i], depth.counted[i], depth.wanted[i]
        if now == before:
            continue
        depth.deep += SPACING * too_deep(now, wanted)
        depth.uncut += SPACING * left_uncut(now, wanted)
        depth.layer += SPACING * into_layer(now, descent.boundary)
        if before >= 0.0:
            depth.deep -= SPACING * too_deep(before, wanted)
            depth.uncut -= SPACING * left_uncut(before, wanted)
            depth.layer -= SPACING * into_layer(before, descent.boundary)
        depth.deepest = max(depth.deepest, now - descent.boundary)
        depth.counted[i] = now
    depth.counts = max(depth.counts, descent.cell + 1)


DEPTH_COUNTED = ("reached", "vertical_sum", "vertical_max")
"""Counts of a step: least position of the edge's leading end [m], sum and maximum of the true vertical force [N]."""
UNFELT = (0.0, 0.0)
"""Sum and maximum of the vertical force before the first step [N]."""


@njit_inline
def begin_depth_step(step: Struct, k: Integer, position: float) -> None:
    """Prepare a step of lane ``k`` for a blade at ``position`` [m]."""
    step.reached[k] = position
    step.vertical_sum[k], step.vertical_max[k] = 0.0, -math.inf


@njit_inline
def count_depth(step: Struct, k: Integer, position: float, vertical: float) -> None:
    """Count a millisecond of lane ``k``: position of the edge's leading end [m], true vertical force [N]."""
    step.reached[k] = min(step.reached[k], position)
    step.vertical_sum[k] += vertical
    step.vertical_max[k] = max(step.vertical_max[k], vertical)


@njit_inline
def charge_depth(depth: Struct, target: float) -> None:
    """Charge the costs of a step, of which the map is up to date."""
    _charge(depth, depth.deep, depth.uncut, depth.layer, depth.deepest, target)


@njit_inline
def as_deep_as_wanted(depth: Struct, target: float) -> bool:
    """Return True if mean error of the depth and depth into the layer below are within the tolerances of a success."""
    mean: float = (depth.deep + depth.uncut) / target
    return mean <= DEPTH_TOLERANCE and depth.deepest <= LAYER_TOLERANCE


@njit_internal
def wanted_at(depth: Struct, measured: Struct, position: float) -> float:
    """Return the wanted depth [m] at ``position`` [m] as it is shown; the specimen's own profile as it was measured."""
    if depth.level_wanted == 1:
        return depth_at(measured, position)
    at = min(max(position, 0.0) * POINTS_PER_METRE, N_POINTS - 1.0)
    i = min(int(at), N_POINTS - 2)
    return depth.wanted[i] + (at - i) * (depth.wanted[i + 1] - depth.wanted[i])  # type: ignore[no-any-return]


@njit_internal
def observe_depth(
    depth: Struct, descent: Struct, measured: Struct, sensor: Struct, tick: int, updates: int, position: float,
    felt: tuple[float, float], last_descent: float, observation: StructArray,
) -> None:  # fmt: skip
    """Fill the components of ``observation`` that depth adds; ``updates`` 0: at the start, force tared to zero.

    ``felt`` are sum and maximum of the true vertical force in the step [N].
    The sensor's noise is drawn once for each decision.
    """
    now = mean = largest = 0.0
    if updates > 0:
        key, counter = (sensor.seed, sensor.episode), _NORMALS * tick
        first = normal_at(key[0], key[1], VERTICAL_NOISE, counter)
        second = normal_at(key[0], key[1], VERTICAL_NOISE, counter + 1)
        third = normal_at(key[0], key[1], VERTICAL_NOISE, counter + 2)
        now = rounded(depth, descent.vertical + depth.vertical_noise * first)
        mean = felt[0] / updates + depth.vertical_noise * second / math.sqrt(updates)
        largest = rounded(depth, felt[1] + depth.vertical_noise * third)
    fill_depth(depth, descent, measured, position, (now, mean, largest), last_descent, observation)


@njit_internal
def fill_depth(
    depth: Struct, descent: Struct, measured: Struct, position: float, forces: tuple[float, float, float],
    last_descent: float, observation: StructArray,
) -> None:  # fmt: skip
    """Fill the components of ``observation`` that depth adds, for vertical ``forces`` now, in the mean and at most."""
    _fill(
        forces[0], forces[1], forces[2], depth_at(measured, position) - descent.level, -descent.level_speed,
        wanted_at(depth, measured, position), wanted_at(depth, measured, position + LOOK_AHEAD[0]),
        wanted_at(depth, measured, position + LOOK_AHEAD[1]), wanted_at(depth, measured, position + LOOK_AHEAD[2]),
        last_descent, observation,
    )  # fmt: skip


@njit_inline
def rounded(depth: Struct, force: float) -> float:
    """Return a vertical force [N] rounded to the sensor's resolution."""
    if depth.vertical_resolution == 0.0:
        return force
    return depth.vertical_resolution * math.floor(force / depth.vertical_resolution + 0.5)  # type: ignore[no-any-return]
