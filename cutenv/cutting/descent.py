"""Vertical motion of the blade: the cutting law where depth is a degree of freedom.

The blade's lower end is at a level h [m]; at h = 0 it cuts as deep as the specimen's profile says, B(x), and the
law is that of :mod:`cutenv.cutting.update`, to the last bit.  Elsewhere the tip is engaged to the depth D = B - e, with
e the higher one of h and of the floor of the cut, and stiffness, toughness and friction are those of this depth:

    K(a, D) by the table of partial depth,    R(a) times the integral of the layers' toughness down to D.

A blade that is lower than the floor presses on it along its edge, as on a bed of springs (Winkler).  Under force alone
the floor gives way where the force per length reaches R; where the edge is drawn along it as well, earlier, by the
slice-push ratio xi, drawn over pressed length (Atkins, The Science and Engineering of Cutting, 2009):

    V = R / (1 + xi^2),    H = R xi / (1 + xi^2)        per length of edge.

The energy account stays exact.  Fracture grows by R dA, with the area that advancing and deepening open; work includes
that of the vertical motion.  Bed, edge length and layers are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.parameter import check_parameters, parameter
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.cutting.dtypes import PROFILE, TICK
from cutenv.cutting.law import LONGEST_ADVANCE, depth_at, grid_index, stiffness_at, toughness_at
from cutenv.cutting.update import grow_row, leap_row, load_row, look_row, relax_row, run_row, turn_row
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING
from cutenv.tissue.layers import Layers, layered_depth, summed_toughness, toughness_within
from cutenv.tissue.slab import at_depth, cut_through_along
from cutenv.tissue.specimen import Specimen

LEAST_DEPTH = 5e-4
"""Depth [m] to which the blade stays engaged, however far it is raised."""
_MOST_STEPS, _EXACT = 60, 1e-12  # of the search for the depth that is left, [m]


@dataclass(frozen=True, kw_only=True)
class DescentParameters:
    """Constants of the vertical motion."""

    edge_length: float = parameter(
        0.006, unit="m", low=0.0, high=0.03, provenance="assumed",
        source="part of a No. 10 blade's edge, its belly, that meets the floor of a cut", sensitivity=(0.003, 0.010),
    )  # fmt: skip
    bedding: float = parameter(
        1.0, unit="1", low=0.05, high=50.0, provenance="assumed",
        source="stiffness of the floor under an edge, per length, over the modulus: near 1 for a long indenter",
        sensitivity=(0.5, 2.0),
    )  # fmt: skip

    vertical_lag: float = parameter(
        0.040, unit="s", low=0.001, high=1.0, provenance="assumed", source="as that of the motion along the cut",
        sensitivity=(0.010, 0.080),
    )  # fmt: skip
    vertical_acceleration: float = parameter(
        0.1, unit="m/s2", low=0.001, high=10.0, provenance="assumed", source="as that of the motion along the cut",
        sensitivity=(0.05, 0.5),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


DESCENT: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("level", "f8"),  # h: of the blade's lower end [m], upwards; 0 cuts as deep as the profile says
            ("level_speed", "f8"),  # upwards [m/s]
            ("gain", "f8"),  # of the vertical drive's velocity loop, in a millisecond
            ("acceleration", "f8"),  # its limit [m/s2]
            ("engaged", "f8"),  # e: level down to which the tip is cut and the blade engaged [m]
            ("pressed", "f8"),  # energy in the bed [J]
            ("vertical", "f8"),  # force of the tissue on the blade, upwards [N]; its elastic part only while it moves
            ("drag", "f8"),  # force of slicing against the motion along the cut [N]
            ("opened", "f8"),  # area opened by deepening, beyond what advancing opens [m2]
            ("tip", "f8"),  # where the tip stood at the last update [m]
            ("under", "i8"),  # cell under the leading end of the edge
            ("cell", "i8"),  # cell of the grid in which the tip stands
            ("version", "i8"),  # number of changes of e; a point of the profile belongs to one:
            ("belongs", "i8", (N_POINTS,)),
            ("surface", "f8", (N_POINTS,)),  # B [m]: level of the surface
            ("floor", "f8", (N_POINTS,)),  # level of the floor of the cut [m]
            ("far", "f8", (N_POINTS,)),  # stiffness of a slab that is cut through, see cutenv.tissue.slab
            ("near", "f8", (N_POINTS,)),
            ("toughness", "f8", (N_POINTS,)),  # fracture part of R [J/m2]
            ("modulus", "f8"),  # mean of the tissue [Pa]
            ("thickness", "f8"),  # of the slab [m]
            ("edge_length", "f8"),  # [m]
            ("bed", "f8"),  # stiffness of the floor under the edge, per length [Pa]
            *((name, "f8") for name in Layers.__dataclass_fields__),
        ],
    )
)
"""Record of a cut's vertical motion, beside those of the law."""


def descent_records(
    specimens: list[Specimen], layers: Layers | None = None, parameters: DescentParameters | None = None
) -> StructArray:
    """Return the vertical motion's records, :data:`DESCENT` of shape (n,), with each blade at level 0."""
    layers, parameters = layers or Layers(), parameters or DescentParameters()
    records = np.zeros(len(specimens), DESCENT)
    for record, specimen in zip(records, specimens, strict=True):
        record["surface"] = record["floor"] = specimen.depth
        record["floor"][0] = 0.0  # the tip stands in the first cell
        record["modulus"] = cut_through_along(specimen.tissue.slab(), specimen.modulus, record["far"], record["near"])
        record["toughness"] = (1.0 - specimen.tissue.friction_share) * specimen.fracture_resistance
        record["thickness"] = specimen.thickness
        record["edge_length"], record["bed"] = parameters.edge_length, parameters.bedding * record["modulus"]
        record["gain"] = -math.expm1(-TICK / parameters.vertical_lag)
        record["acceleration"] = parameters.vertical_acceleration
        for name in Layers.__dataclass_fields__:
            record[name] = getattr(layers, name)
    return records


def layered_profiles(descents: StructArray, slabs: StructArray) -> StructArray:
    """Return the law's profiles at level 0, :data:`~cutenv.cutting.dtypes.PROFILE` of shape (n,)."""
    profiles = np.zeros(len(descents), PROFILE)
    descents["belongs"] = -1
    _renew_all(profiles, descents, slabs)
    return profiles


@njit
def _renew_all(profiles: StructArray, descents: StructArray, slabs: StructArray) -> None:
    for n in range(len(profiles)):
        for i in range(N_POINTS):
            renew(profiles[n], descents[n], slabs[0], i)


@njit_internal
def renew(profile: Struct, descent: Struct, slab: Struct, i: int) -> None:
    """Bring point ``i`` of a profile up to date with the level to which the blade is engaged."""
    if descent.belongs[i] == descent.version:
        return
    descent.belongs[i] = descent.version
    D = min(max(descent.surface[i] - descent.engaged, LEAST_DEPTH), descent.thickness)
    effective, share = at_depth(slab, i, D, descent.thickness)
    per_depth = descent.modulus * (descent.far[i] + share * (descent.near[i] - descent.far[i]))
    profile.stiffness[i] = per_depth * layered_depth(descent, D, effective)
    profile.toughness[i] = descent.toughness[i] * summed_toughness(descent, D)
    profile.depth[i] = D


@njit_internal
def renew_between(profile: Struct, descent: Struct, slab: Struct, low: float, high: float) -> None:
    """Bring the points around positions ``low`` to ``high`` [m] up to date."""
    first, last = grid_index(low)[0], grid_index(max(low, high))[0]
    for i in range(first, last + 2):
        renew(profile, descent, slab, i)


@njit_inline
def descending_row(
    row: Struct, profiles: StructArray, descents: StructArray, slabs: StructArray, levels: StructArray, dt: float
) -> None:
    """Advance the law as :func:`~cutenv.cutting.update.cut_row`; then each blade goes to its level, ``levels`` [m]."""
    slab = slabs[0]
    if row.turns > 0:
        turn_row(row, profiles)
    if row.relaxing > 0:
        relax_row(row, dt)
    load_row(row, dt)
    for n in range(row.taken):
        cut = row.cut[n]
        profile, descent, tip, blade = profiles[cut], descents[cut], row.tip[n], row.blade[n]
        if row.da[n] > LONGEST_ADVANCE:
            renew_between(profile, descent, slab, tip, blade)
        for i in range(row.tip_point[n], row.tip_point[n] + 2):
            renew(profile, descent, slab, i)
        for i in range(row.blade_point[n], row.blade_point[n] + 2):
            renew(profile, descent, slab, i)
    if row.leaps > 0:
        leap_row(row, profiles)
    if row.points > 0:
        look_row(row, profiles)
    grow_row(row)
    if row.runs > 0:
        for n in range(row.taken):
            if row.waits[n] == 0:
                renew_between(profiles[row.cut[n]], descents[row.cut[n]], slab, row.tip[n], row.blade[n])
        run_row(row, profiles)
    for n in range(row.taken):
        if row.going[n] == 1:
            descend(row, profiles[row.cut[n]], descents[row.cut[n]], slab, n, levels[row.cut[n]])
    for n in range(len(row.blade)):
        row.force[n] = row.elastic[n] + row.rubbing[n]
    for n in range(row.taken):
        row.force[n] += descents[row.cut[n]].drag


@njit_internal
def descend(row: Struct, profile: Struct, descent: Struct, slab: Struct, n: int, level: float) -> None:
    """Move one blade to ``level`` [m]: it presses, deepens the cut, and engages the tip down to another depth."""
    a, x, friction_per_depth = row.tip[n], row.blade[n], row.friction_per_depth[n]
    reach = x - row.creep[n]
    slip = a - descent.tip if reach >= a else abs(row.dx[n])  # a loading blade carries the tissue with it
    cell = int(a * POINTS_PER_METRE + 0.5)
    for i in range(descent.cell + 1, cell + 1):
        descent.floor[i] = descent.engaged
    descent.cell, descent.tip = cell, a

    at = min(reach, a)  # of the leading end of the edge, in the tissue
    fall, under = descent.level - level, int(at * POINTS_PER_METRE + 0.5)
    if fall == 0.0 and descent.pressed == 0.0 and under == descent.under:
        descent.drag, descent.vertical = 0.0, 0.0
        return
    descent.level, descent.under = level, under
    rubbed = friction_per_depth * row.depth[n] * abs(fall)
    row.work[n] += rubbed
    row.friction[n] += rubbed

    pressing, released, spent, force = press(descent, at, a, level, slip)
    row.work[n] += pressing - descent.pressed
    descent.pressed = pressing - released
    engaged = max(level, descent.floor[cell])
    lag = max(reach - a, 0.0)
    gained, up = 0.0, 0.0
    if engaged != descent.engaged:
        stiffness, toughness, change = row.K[n], row.toughness[n], engaged - descent.engaged
        descent.engaged = engaged
        descent.version += 1
        renew_between(profile, descent, slab, a, a)
        renew_between(profile, descent, slab, x, x)
        row.K[n], row.dK[n] = stiffness_at(profile, a)
        row.toughness[n], row.depth[n] = toughness_at(profile, a), depth_at(profile, x)
        row.seen_tip_point[n], row.seen_blade_point[n] = -1, -1
        row.held_force[n] *= row.toughness[n] / toughness
        row.elastic[n] = row.K[n] * lag
        gained = 0.5 * (row.K[n] - stiffness) * lag**2
        up = -gained / change
    balance = spent + gained - released
    row.fracture[n] += spent
    if spent > 0.0 and balance < 0.0:
        row.loss[n] -= balance
    else:
        row.work[n] += balance
    sliced = spent > 0.0 and balance > 0.0 and row.dx[n] != 0.0
    descent.drag = balance / row.dx[n] if sliced else 0.0
    descent.vertical = force + (up if spent == 0.0 else 0.0)
    if fall != 0.0:
        descent.vertical += math.copysign(friction_per_depth * row.depth[n], fall)


@njit_internal
def press(descent: Struct, at: float, a: float, level: float, slip: float) -> tuple[float, float, float, float]:
    """Press the edge, whose leading end is ``at`` [m], on the floor; it deepens the cut where its force suffices.

    Returns the energy [J] in the bed before the floor gives way, what of it is then released, the fracture energy, and
    the force [N] afterwards.
    """
    bed = descent.bed
    energy = released = spent = force = 0.0
    start = max(at - descent.edge_length, 0.0)
    first, last = int(start * POINTS_PER_METRE + 0.5), min(int(at * POINTS_PER_METRE + 0.5), descent.cell)
    for i in range(first, last + 1):
        p = descent.floor[i] - level
        depth = descent.surface[i] - descent.floor[i]
        if p <= 0.0 or depth >= descent.thickness:
            continue
        low, high = (i - 0.5) * SPACING, (i + 0.5) * SPACING
        under = max(min(high, at) - max(low, start), 0.0)  # length of edge over this cell
        cell = min(high, a) - max(low, 0.0)  # of it that is behind the tip: deepened as a whole
        R = descent.toughness[i] * toughness_within(descent, depth)
        left = given_way(p, R / bed, slip)
        energy += 0.5 * bed * under * p**2
        if left < p and under > 0.0:
            deeper = min(depth + (p - left), descent.thickness)
            spent += (
                cell * descent.toughness[i] * (summed_toughness(descent, deeper) - summed_toughness(descent, depth))
            )
            descent.opened += cell * (deeper - depth)
            descent.floor[i] = descent.surface[i] - deeper
            released += 0.5 * bed * under * (p**2 - left**2)
        force += bed * under * left
    return energy, released, spent, force


@njit_internal
def given_way(p: float, most: float, slip: float) -> float:
    """Return what is left of a depth ``p`` [m] to which the floor is pressed, after it gave way.

    ``most`` [m] is where force alone cuts, R over the bed's stiffness, and ``slip`` [m] the length by which the edge is
    drawn.  The rest u solves u (1 + xi^2) = most with xi = slip/(p - u).
    """
    if slip <= 0.0:
        return min(p, most)
    low, high = 0.0, min(p, most)
    u = p - slip * math.sqrt(p / (most - p)) if p < most else most - (slip / max(p - most, slip)) ** 2 * most
    u = u if 0.0 < u < high else 0.5 * high
    for _ in range(_MOST_STEPS):  # Newton's method, halving where it leaves the bracket
        value = (p - u) ** 2 * (most - u) - slip**2 * u
        if value > 0.0:
            low = u
        else:
            high = u
        new = u + value / ((p - u) * (2.0 * (most - u) + (p - u)) + slip**2)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - u) < _EXACT:
            return new
        u = new
    return u
