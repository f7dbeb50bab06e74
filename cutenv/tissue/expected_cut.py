"""Cut expected behind a blade that is led along a drawn line, and places along the line and beside it."""

from __future__ import annotations

import math

import numpy as np

from cutenv._base.arrays import Array
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.tissue.lines import CutLine
from cutenv.tissue.place_model import beside_line, off_line

CRACK_CURVATURE = 100.0
"""Largest curvature of a crack: it turns within the length that a blade drags along; assumed [1/m]."""
_ADVANCE = 0.0002  # [m], of the tip from one turn of the crack to the next
_STEEPEST = 0.25  # least cosine of the angle between crack and line
_CHUNK = 2000  # readings whose distances to all points of a line are held at once


def along_line(line: CutLine, x: Array, y: Array) -> tuple[Array, Array]:
    """Return lengths along a line and distances to its left of the places nearest to (x, y), all [m], shape (n,)."""
    nearest = np.concatenate(
        [
            np.argmin((x[i : i + _CHUNK, None] - line.x) ** 2 + (y[i : i + _CHUNK, None] - line.y) ** 2, axis=1)
            for i in range(0, len(x), _CHUNK)
        ]
    )
    cosine, sine = np.cos(line.angle[nearest]), np.sin(line.angle[nearest])
    east, north = x - line.x[nearest], y - line.y[nearest]
    ahead, left = east * cosine + north * sine, north * cosine - east * sine
    bend = line.curvature[nearest]
    # From the tangent at the nearest point to the arc, of which it is less than half a spacing away.
    place = nearest * SPACING + ahead / (1.0 - bend * left)
    return place, left - 0.5 * bend * ahead**2


def expected_cut(line: CutLine, x: Array, y: Array, tip: Array, tissue: TissueDescription) -> Array:
    """Return the distance of the cut to the left of its line that mean tissue would have, from clamp to tip [m].

    The crack turns toward the force, as the law in the plane has it; stiffness is that of a uniform slab.

    Parameters
    ----------
    line : CutLine
        Line to cut along.
    x, y : array, shape (n,)
        Places of the blade along and across the slab [m].
    tip : array, shape (n,)
        Lengths of line that the tip has cut [m].
    tissue : TissueDescription
        Tissue, for Poisson's ratio and the element of its model.
    """
    from cutenv.tissue.path_model import stiffness_at_unit_modulus, straight_stiffness

    plane = tissue.element, tissue.formulation, tissue.poisson
    stiffness = stiffness_at_unit_modulus(line, *plane)
    rates = off_line(line, straight_stiffness(*plane))
    reached = np.maximum.accumulate(np.clip(tip, 0.0, LENGTH))
    places = np.append(np.arange(0.0, reached[-1], _ADVANCE), reached[-1])
    blades = np.minimum(np.searchsorted(reached, places), len(reached) - 1)
    grid = np.arange(N_POINTS) * SPACING
    columns = (line.x, line.y, line.angle, line.curvature, *stiffness, *rates)
    on_line = np.column_stack([np.interp(places, grid, column) for column in columns])
    east, north, heading = float(line.x[0]), float(line.y[0]), float(line.angle[0])
    aside = np.zeros(len(places))
    for i, (_, _, angle, bend, *here) in enumerate(on_line[:-1].tolist()):
        step = places[i + 1] - places[i]
        cosine, sine = math.cos(angle), math.sin(angle)
        off_x, off_y = float(x[blades[i]]) - east, float(y[blades[i]]) - north
        ahead, left = off_x * cosine + off_y * sine, off_y * cosine - off_x * sine
        along, coupled, across = beside_line(here[:3], here[3:], float(aside[i]))
        pull, push = along * ahead + coupled * left, coupled * ahead + across * left
        if pull > 0.0:
            turn = math.remainder(angle + math.atan2(push, pull) - heading, 2.0 * math.pi)
            heading += min(max(turn, -CRACK_CURVATURE * step), CRACK_CURVATURE * step)
        way = step * (1.0 - bend * aside[i]) / max(math.cos(heading - angle), _STEEPEST)
        east, north = east + way * math.cos(heading), north + way * math.sin(heading)
        after = on_line[i + 1]
        aside[i + 1] = (north - after[1]) * math.cos(after[2]) - (east - after[0]) * math.sin(after[2])
    passed = grid[: int(reached[-1] / SPACING) + 1]
    return np.asarray(np.interp(passed, places, aside))
