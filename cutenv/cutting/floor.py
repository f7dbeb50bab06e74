"""The floor of a cut under a blade's edge: a bed of springs, which gives way to force and slicing."""

from __future__ import annotations

import math

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_inline, njit_internal
from cutenv.tissue.grid import POINTS_PER_METRE, SPACING
from cutenv.tissue.layers import summed_toughness, toughness_within

_MOST_STEPS, _NEAR = 60, 0.05  # of the search for the depth by which the floor gives way; its relative step at the end


@njit_internal
def press(descent: Struct, at: float, a: float, slip: float) -> tuple[float, float, float, float, float, float]:
    """Press the edge, whose leading end is ``at`` [m], on the floor; it deepens the cut where its force suffices.

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
    """Return by how much a floor gives way that is pressed to a depth ``p`` [m].

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
