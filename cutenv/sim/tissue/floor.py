"""The floor of a cut under a blade's edge.

A bed of springs, which gives way to force and slicing.

The simulator has a hidden floor.  A rig's task, a score and a measurement expect the one that the mean tissue would
have under a blade that moved as recorded (:func:`expected_floor`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING
from cutenv.sim.tissue.layers import Layers, summed_toughness, toughness_within

EDGE_LENGTH = 0.006  # length of a blade's edge that meets the floor of a cut [m]; assumed, 3 to 10 mm
BEDDING = 1.0  # stiffness of the floor under an edge, per length, over the modulus [1]; assumed, 0.5 to 2
FLOOR_EVERY = 0.010  # time between two responses of an expected floor [s]
_MOST_STEPS, _NEAR = 60, 0.05  # of the search for the depth by which the floor gives way; its relative step at the end


@njit_internal
def press(descent: Struct, at: float, a: float, slip: float) -> tuple[float, float, float, float, float, float]:
    """Press the edge at ``at`` [m] on the floor; deepen the cut.

    Returns the energy [J] in the bed before the floor gives way, what of it is then released, the fracture energy, the
    part of it that slicing spends, and force [N] and stiffness [N/m] of the bed afterwards.
    """
    bed, thickness, level = descent.bed, descent.thickness, descent.level
    per_bed = 1.0 / bed
    energy = released = spent = sliced = force = length = 0.0
    start = max(at - descent.edge_length, 0.0)
    first, last = int(start * POINTS_PER_METRE + 0.5), min(int(at * POINTS_PER_METRE + 0.5), descent.cell)
    for i in range(first, last + 1):
        p = descent.floor[i] - level
        depth = descent.surface[i] - descent.floor[i]
        if p <= 0.0 or depth >= thickness:
            continue
        low, high = (i - 0.5) * SPACING, (i + 0.5) * SPACING
        under = max(min(high, at) - max(low, start), 0.0)  # length of edge over this cell
        R = descent.toughness[i] * toughness_within(descent, depth)
        sunk = given_way(p, R * per_bed, slip)
        energy += 0.5 * bed * under * p**2
        if sunk > 0.0 and under > 0.0:
            cell = min(high, a) - max(low, 0.0)  # of it that is behind the tip: deepened as a whole
            deeper = min(depth + sunk, thickness)
            taken = cell * descent.toughness[i] * (summed_toughness(descent, deeper) - summed_toughness(descent, depth))
            spent += taken
            sliced += taken * slip**2 / (slip**2 + sunk**2)
            descent.opened += cell * (deeper - depth)
            descent.floor[i] = descent.surface[i] - deeper
            released += 0.5 * bed * under * sunk * (2.0 * p - sunk)
            p -= sunk
        force += bed * under * p
        length += under
    return energy, released, spent, sliced, force, bed * length


@njit_inline
def given_way(p: float, most: float, slip: float) -> float:
    """Return how far a floor pressed to ``p`` [m] gives way.

    ``most`` [m] is where force alone cuts, R over the bed's stiffness, and ``slip`` [m] the length by which the edge is
    drawn.  The sinking d leaves u = p - d and solves u (1 + xi^2) = most with xi = slip/d; Newton's method comes down
    to it from a bound above.
    """
    over = p - most
    if slip <= 0.0:
        return max(over, 0.0)
    square = slip**2
    if over < -slip:
        d = 2.0 * slip * p / (slip + math.sqrt(square - 4.0 * over * p))
    else:
        d = min(max(over, 0.0) + math.sqrt(slip * p), p)
    for _ in range(_MOST_STEPS):
        step = (d * d * (d - over) - square * (p - d)) / (d * (3.0 * d - 2.0 * over) + square)
        d -= step
        if step < _NEAR * d:
            break
    return d


FLOOR_RECORD: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("level", "f8"),  # of the blade's lower end [m], upwards; 0 cuts as deep as the surface says
            ("engaged", "f8"),  # level down to which the tip is cut [m]
            ("opened", "f8"),  # area opened by deepening, beyond what advancing opens [m2]
            ("blade", "f8"),  # position of blade and tip at the last response [m]
            ("tip", "f8"),
            ("cell", "i8"),  # cell of the grid in which the tip stands
            ("surface", "f8", (N_POINTS,)),  # level of the surface [m]
            ("floor", "f8", (N_POINTS,)),  # level of the floor [m]
            ("toughness", "f8", (N_POINTS,)),  # fracture part of R [J/m2]
            ("bed", "f8"),  # stiffness of the floor under the edge, per length [Pa]
            ("thickness", "f8"),  # of the slab [m]
            ("edge_length", "f8"),  # [m]
            *((name, "f8") for name in Layers.__dataclass_fields__),
        ],
    )
)
"""Record of the floor that is expected under a blade."""


@njit_internal
def follow_floor(floor: Struct, position: float, tip: float) -> None:
    """Update the expected floor for new positions of blade and tip [m]."""
    cell = min(int(tip * POINTS_PER_METRE + 0.5), N_POINTS - 1)
    for i in range(floor.cell + 1, cell + 1):
        floor.floor[i] = max(floor.engaged, floor.surface[i] - floor.thickness)
    slip = max(tip - floor.tip, 0.0) if position >= tip else abs(position - floor.blade)
    floor.cell, floor.tip, floor.blade = max(cell, floor.cell), tip, position
    press(floor, min(position, tip), tip, slip)
    floor.engaged = max(floor.level, floor.floor[cell])


@njit
def _follow(floors: StructArray, positions: Array, heights: Array, tips: Array, engaged: Array) -> None:
    floor = floors[0]
    for k in range(len(positions)):
        floor.level = heights[k]
        follow_floor(floor, positions[k], tips[k])
        engaged[k] = floor.engaged


class BladePath(NamedTuple):
    """Blade position, height and tip every :data:`FLOOR_EVERY`, each (n,) [m]."""

    positions: Array
    heights: Array
    tips: Array


def expected_floor(
    tissue: TissueDescription, surface: Array, path: BladePath, *, layers: Layers | None = None
) -> tuple[Array, Array]:
    """Return the floor expected in a tissue under a blade's path.

    Of the floor, which has the tissue's mean resistance and modulus: the depth below the surface at each point of the
    grid up to the tip [m], and the level down to which the blade was engaged at the tip [m].  ``surface`` is the depth
    of cut of a blade at height 0, (301,) [m]; the tip of ``path`` never goes back.  Edge and bedding are assumed:
    :data:`EDGE_LENGTH`, :data:`BEDDING`.
    """
    record = np.zeros(1, FLOOR_RECORD)
    record["toughness"] = (1.0 - tissue.friction_share) * tissue.fracture_resistance
    record["bed"] = BEDDING * tissue.modulus
    record["thickness"], record["edge_length"] = tissue.thickness, EDGE_LENGTH
    for name in Layers.__dataclass_fields__:
        record[name] = getattr(layers or Layers(), name)
    record["surface"] = record["floor"] = surface
    record["engaged"] = record["floor"][0, 0] = path.heights[0]
    engaged = np.empty(len(path.positions))
    along, up, grown = (np.ascontiguousarray(each, np.float64) for each in path)
    _follow(record, along, up, grown, engaged)
    cells = int(record["cell"][0]) + 1
    depth = surface[:cells] - record["floor"][0, :cells]
    return np.clip(depth, 0.0, tissue.thickness), engaged
