"""Assessment of the path of a cut: a map of its distance to the line, costs, success, and what is observed."""

from __future__ import annotations

import math
from typing import Any

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.fuse import fuse
from cutenv._engine.jit import njit_fused, njit_inline, njit_internal
from cutenv._engine.randomness import LATERAL_NOISE, Integer, three_normals_at
from cutenv.cutting.law import grid_index, lerp
from cutenv.task import path_terms
from cutenv.task.map_costs import charge_lines, observe_lines
from cutenv.task.observation import COMPONENTS
from cutenv.task.path_terms import LINE_AHEAD, PATH_COMPONENTS
from cutenv.task_quantities import FARTHEST_TOLERANCE, LINE_TOLERANCE, OF_PATH, PATH_COSTS
from cutenv.tissue.grid import LENGTH, SPACING

_FIRST = len(COMPONENTS)  # component of the observation that the path adds first


def _fused(name: str, parameters: tuple[str, ...], lines: list[str]) -> Any:
    return njit_fused(fuse(name, list(parameters), lines, [path_terms, __name__]))


_charge = _fused("_charge", ("path", *OF_PATH), charge_lines(PATH_COSTS, "path", OF_PATH))
_fill = _fused("_fill", (*(one.name for one in PATH_COMPONENTS), "observation"), observe_lines(PATH_COMPONENTS, _FIRST))

PATH_COUNTED = ("lateral_sum", "lateral_peak")
"""Counts of a step: sum and largest size of the force to the right of the blade [N]."""
UNFELT_ASIDE = (0.0, 0.0)
"""Sum and largest size of the lateral force before the first step [N]."""


@njit_internal
def survey_path(path: Struct, steering: Struct, tip: float) -> None:
    """Bring the map up to date to a ``tip`` [m] of the line, whose crack has run straight on since it last turned."""
    for i in range(path.counts, steering.cell + 1):
        _count(path, steering, i, steering.cut[i])
    path.counts = max(path.counts, steering.cell + 1)
    passed = path.passed_area, path.passed_farthest, path.passed_distance
    last = grid_index(tip)[0]
    if last > steering.cell:
        grown, start = tip - steering.settled, steering.tip_aside
        way = grown * steering.stretch
        east = steering.tip_east + way * steering.tip_ahead - grown
        north = steering.tip_north + way * steering.tip_across
        j, share = grid_index(tip)
        end = (north - lerp(steering.y, j, share)) * lerp(steering.cosine, j, share) - (
            east - lerp(steering.x_excess, j, share)
        ) * lerp(steering.sine, j, share)
        for i in range(steering.cell + 1, last + 1):
            _count(path, steering, i, start + (end - start) * ((i * SPACING - steering.settled) / grown))
    path.area, path.farthest, path.distance = path.passed_area, path.passed_farthest, path.passed_distance
    path.passed_area, path.passed_farthest, path.passed_distance = passed


@njit_inline
def _count(path: Struct, steering: Struct, i: int, aside: float) -> None:
    """Add point ``i`` of the line, which the cut passes at a distance ``aside`` to the left [m]."""
    size = abs(aside)
    path.passed_area += SPACING * size * (1.0 - 0.5 * steering.curvature[i] * aside)
    path.passed_distance += SPACING * size
    path.passed_farthest = max(path.passed_farthest, size)


@njit_inline
def begin_path_step(step: Struct, k: Integer) -> None:
    """Prepare a step of lane ``k``."""
    step.lateral_sum[k], step.lateral_peak[k] = 0.0, 0.0


@njit_inline
def count_lateral(step: Struct, k: Integer, lateral: float) -> None:
    """Count a millisecond of lane ``k``: true force on the blade, to its right [N]."""
    step.lateral_sum[k] += lateral
    step.lateral_peak[k] = max(step.lateral_peak[k], abs(lateral))


@njit_inline
def charge_path(path: Struct, target: float) -> None:
    """Charge the costs of a step, of which the map is up to date."""
    _charge(path, path.area, path.farthest, target)


@njit_inline
def near_enough(path: Struct, target: float) -> bool:
    """Return True if mean and largest distance between cut and line are within the tolerances of a success."""
    mean: float = path.distance / target
    return mean <= LINE_TOLERANCE and path.farthest <= FARTHEST_TOLERANCE


@njit_internal
def observe_path(
    path: Struct, steering: Struct, sensor: Struct, tick: int, updates: int, position: float,
    felt: tuple[float, float], last_turn: float, observation: StructArray,
) -> None:  # fmt: skip
    """Fill the components of ``observation`` that the path adds; ``updates`` 0: at the start, force tared to zero.

    ``position`` is that of the blade on the line [m]; ``felt`` are sum and largest size of the true lateral force in
    the step [N].  The sensor's noise is drawn once for each decision.
    """
    now = mean = peak = 0.0
    if updates > 0:
        first, second, third = three_normals_at(sensor.seed, sensor.episode, LATERAL_NOISE, tick)
        now = _rounded(path, steering.lateral + path.lateral_noise * first)
        mean = felt[0] / updates + path.lateral_noise * second / math.sqrt(updates)
        peak = _rounded(path, felt[1] + path.lateral_noise * third)
    here = line_ahead(steering, position, 0.0)
    near, further = line_ahead(steering, position, LINE_AHEAD[0]), line_ahead(steering, position, LINE_AHEAD[1])
    far = line_ahead(steering, position, LINE_AHEAD[2])
    _fill(
        now, mean, peak, here[0], here[1], here[2], near[0], near[1], near[2], further[0], further[1], further[2],
        far[0], far[1], far[2], last_turn, observation,
    )  # fmt: skip


@njit_internal
def line_ahead(steering: Struct, position: float, ahead: float) -> tuple[float, float, float]:
    """Return how far the line is to the left of the blade's course [m], the sine of its direction, and its bend [1/m].

    It is told at a distance ``ahead`` [m] along the line of a blade at ``position``.
    """
    place = min(max(position + ahead, 0.0), LENGTH)
    i, share = grid_index(place)
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    east = (place - position) + (lerp(steering.x_excess, i, share) - steering.east)
    north = lerp(steering.y, i, share) - steering.north
    aside = steering.ahead * north - steering.across * east
    return aside, steering.ahead * t_y - steering.across * t_x, lerp(steering.curvature, i, share)


@njit_inline
def _rounded(path: Struct, force: float) -> float:
    """Return a lateral force [N] rounded to the sensor's resolution."""
    if path.lateral_resolution == 0.0:
        return force
    return path.lateral_resolution * math.floor(force / path.lateral_resolution + 0.5)  # type: ignore[no-any-return]
