"""Vertical motion of the blade.

The cutting law where depth is a degree of freedom.

The blade's lower end is at a level h [m]; at h = 0 it cuts as deep as the specimen's profile says, B(x), and the
law is that of :mod:`cutenv.sim.cutting.update`, to the last bit.  Elsewhere the tip is engaged to the depth D = B - e,
with e the higher one of h and of the floor of the cut, on which toughness and friction depend.  Stiffness is that of
the depth to which the blade is let down, P = B - h, be the tissue above its lower end cut or only pressed:

    K(a, P) by the table of partial depth,    R(a) times the integral of the layers' toughness down to D.

So the tissue that the blade carries along pushes it up by dK/dP l^2 / 2, with the lag l of the tip.  That is the
derivative of the stored energy on a floor that yields as on one that does not.  Friction is one vector, along the cut
and down (:mod:`cutenv.sim.cutting.friction`).

A blade that is lower than the floor presses on it along its edge, as on a bed of springs (Winkler).  Under force alone
the floor gives way where the force per length reaches R; where the edge is drawn along it as well, earlier, by the
slice-push ratio xi, drawn over pressed length (Atkins, The Science and Engineering of Cutting, 2009):

    V = R / (1 + xi^2),    H = R xi / (1 + xi^2)        per length of edge.

Floor and tissue respond to the blade's depth every ten updates; between these the blade presses on springs.  Forces,
crack and account go on in every update.  The work of slicing is released as force along the cut over the next point of
the grid, half a millimetre.  In a run, tissue passes the edge by millimetres at once; the edge is drawn through it as
the blade moves on.

The energy account stays exact.  Fracture grows by R dA, with the area that advancing and deepening open; work includes
that of the vertical motion.  Bed, edge length, layers and the ten updates are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.randomness import Integer
from cutenv.sim.cutting.drive import VelocityLoop, velocity_loop_step
from cutenv.sim.cutting.dtypes import PROFILE, TICK
from cutenv.sim.cutting.friction import deflected
from cutenv.sim.cutting.law import LONGEST_ADVANCE, depth_at, grid_index, stiffness_at, toughness_at
from cutenv.sim.cutting.motion import Motion, Moving
from cutenv.sim.cutting.row import gather, law_in_row, scatter
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.floor import BEDDING, EDGE_LENGTH, press
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE
from cutenv.sim.tissue.layers import Layers, layered_depth, summed_toughness
from cutenv.sim.tissue.slab import SLAB, at_depth, cut_through_along
from cutenv.sim.tissue.specimen import NOMINAL, Specimen, nominal_tissue

LEAST_DEPTH = 5e-4  # depth [m] to which the blade stays engaged, however far it is raised
LOWEST, HIGHEST = -0.025, 0.025  # ends of the blade's vertical travel [m]
_LEAST_CHANGE = 1e-6  # of the level engaged, from which the stiffness's rise with depth is taken [m]
_ASIDE = 0.25e-3  # depths on either side from which the stiffness's rise with depth is taken [m]


@dataclass(frozen=True, kw_only=True)
class DescentParameters:
    """Constants of the vertical motion."""

    edge_length: float = parameter(
        EDGE_LENGTH, unit="m", low=0.0, high=0.03, provenance="assumed",
        source="part of a No. 10 blade's edge, its belly, that meets the floor of a cut", sensitivity=(0.003, 0.010),
    )  # fmt: skip
    bedding: float = parameter(
        BEDDING, unit="1", low=0.05, high=50.0, provenance="assumed",
        source="stiffness of the floor under an edge, per length, over the modulus: near 1 for a long indenter",
        sensitivity=(0.5, 2.0),
    )  # fmt: skip

    response_time: float = parameter(
        0.010, unit="s", low=0.001, high=0.1, provenance="assumed",
        source="between updates of the tissue's stiffness and toughness to the depth of a blade that moves up or down",
        sensitivity=(0.001, 0.020),
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
            ("response", "i8"),  # updates between those of the tissue to the depth
            ("waiting", "i8"),  # updates until the next one
            ("engaged", "f8"),  # e: level down to which the tip is cut and the blade engaged [m]
            ("pressed", "f8"),  # energy in the bed [J]
            ("bearing", "f8"),  # force of the bed on the blade [N]
            ("spring", "f8"),  # stiffness of the bed [N/m]
            ("lowered", "f8"),  # deflection of the friction bristles downwards [m]
            ("grip", "f8"),  # force of friction on the blade, upwards [N]
            ("rise", "f8"),  # of the stiffness with depth, at the tip [N/m2]
            ("vertical", "f8"),  # force of the tissue on the blade, upwards [N]
            ("drag", "f8"),  # force of slicing against the motion along the cut [N]
            ("drawn", "f8"),  # deflection along the cut of the tissue under the edge, as of bristles [m]
            ("slicing", "f8"),  # size of the force of slicing, where it slips [N]
            ("pending_slicing", "f8"),  # slicing work not yet released as force [J]
            ("owed_slip", "f8"),  # advance of the tip through which the edge has not yet been drawn [m]
            ("opened", "f8"),  # area opened by deepening, beyond what advancing opens [m2]
            ("settled", "f8"),  # level at the last response, to which the stiffness belongs [m]
            ("blade", "f8"),  # where blade and tip stood then [m]
            ("tip", "f8"),
            ("under", "i8"),  # cell under the leading end of the edge
            ("cell", "i8"),  # cell of the grid in which the tip stands
            ("version", "i8"),  # number of changes of e; a point of the profile belongs to one:
            ("belongs", "i8", (N_POINTS,)),
            ("surface", "f8", (N_POINTS,)),  # B [m]: level of the surface
            ("floor", "f8", (N_POINTS,)),  # level of the floor of the cut [m]
            ("far", "f8", (N_POINTS,)),  # stiffness of a slab that is cut through, see cutenv.sim.tissue.slab
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

SHARED: np.dtype[Any] = np.dtype((np.record, [("slab", SLAB, (1,)), ("mean", NOMINAL, (1,))]))
"""Record that cuts of one tissue share: stiffness of its slab, and the mean tissue."""


@lru_cache(maxsize=8)
def shared_record(tissue: TissueDescription) -> StructArray:
    """Return what cuts of a tissue share, :data:`SHARED` of shape (1,)."""
    record = np.zeros(1, SHARED)
    record["slab"], record["mean"] = tissue.slab(), nominal_tissue(tissue)
    return record


def descent_records(
    specimens: list[Specimen], layers: Layers | None = None, parameters: DescentParameters | None = None
) -> StructArray:
    """Return :data:`DESCENT` records, shape (n,), with each blade at level 0."""
    layers, parameters = layers or Layers(), parameters or DescentParameters()
    records = np.zeros(len(specimens), DESCENT)
    for record, specimen in zip(records, specimens, strict=True):
        record["surface"] = record["floor"] = specimen.depth
        record["floor"][0] = 0.0  # the tip stands in the first cell
        record["modulus"] = cut_through_along(specimen.tissue.slab(), specimen.modulus, record["far"], record["near"])
        record["toughness"] = (1.0 - specimen.tissue.friction_share) * specimen.fracture_resistance
        record["thickness"] = specimen.thickness
        record["edge_length"], record["bed"] = parameters.edge_length, parameters.bedding * record["modulus"]
        record["response"] = record["waiting"] = round(parameters.response_time / TICK)
        record["gain"] = -math.expm1(-TICK / parameters.vertical_lag)
        record["acceleration"] = parameters.vertical_acceleration
        for name in Layers.__dataclass_fields__:
            record[name] = getattr(layers, name)
    return records


def layered_profiles(descents: StructArray, slabs: StructArray) -> StructArray:
    """Return the law's profiles at level 0, :data:`~cutenv.sim.cutting.dtypes.PROFILE` of shape (n,)."""
    profiles = np.zeros(len(descents), PROFILE)
    descents["belongs"] = -1
    _renew_all(profiles, descents, slabs)
    return profiles


@njit
def _renew_all(profiles: StructArray, descents: StructArray, slabs: StructArray) -> None:
    for n in range(len(profiles)):
        for i in range(N_POINTS):
            renew(profiles[n], descents[n], slabs[0], i)


@njit_inline
def held_depth(descent: Struct, depth: float) -> float:
    """Clip a depth [m] to what a blade can engage."""
    held: float = min(max(depth, LEAST_DEPTH), descent.thickness)
    return held


@njit_inline
def stiffness_to(descent: Struct, slab: Struct, i: int, depth: float) -> float:
    """Return K [N/m] at point ``i`` for an engaged ``depth`` [m]."""
    effective, share = at_depth(slab, i, depth, descent.thickness)
    per_depth = descent.modulus * (descent.far[i] + share * (descent.near[i] - descent.far[i]))
    stiffness: float = per_depth * layered_depth(descent, depth, effective)
    return stiffness


@njit_internal
def renew(profile: Struct, descent: Struct, slab: Struct, i: int) -> None:
    """Update point ``i`` of a profile to the blade's level."""
    if descent.belongs[i] == descent.version:
        return
    descent.belongs[i] = descent.version
    profile.stiffness[i] = stiffness_to(descent, slab, i, held_depth(descent, descent.surface[i] - descent.settled))
    D = held_depth(descent, descent.surface[i] - descent.engaged)
    profile.toughness[i] = descent.toughness[i] * summed_toughness(descent, D)
    profile.depth[i] = D


@njit_internal
def renew_edge(profile: Struct, descent: Struct, i: int) -> None:
    """Update depth and toughness, but not stiffness, at point ``i``."""
    D = held_depth(descent, descent.surface[i] - descent.engaged)
    profile.toughness[i] = descent.toughness[i] * summed_toughness(descent, D)
    profile.depth[i] = D


@njit_internal
def renew_between(profile: Struct, descent: Struct, slab: Struct, low: float, high: float) -> None:
    """Update the points around positions ``low`` to ``high`` [m]."""
    first, last = grid_index(low)[0], grid_index(max(low, high))[0]
    for i in range(first, last + 2):
        renew(profile, descent, slab, i)


@njit_internal
def rise_with_depth(descent: Struct, slab: Struct, i: int) -> float:
    """Return the stiffness's derivative by depth at ``i`` [N/m2]."""
    depth = descent.surface[i] - descent.settled
    low, high = held_depth(descent, depth - _ASIDE), held_depth(descent, depth + _ASIDE)
    rise: float = (stiffness_to(descent, slab, i, high) - stiffness_to(descent, slab, i, low)) / (2.0 * _ASIDE)
    return rise


@njit_inline
def command_descent(levels: Struct, n: Integer, speed: float) -> None:
    """Command a speed downwards [m/s]."""
    levels.descent_speed[n] = speed


@njit_inline
def lower_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Advance every vertical drive by 1 ms under ``descent_speed``."""
    levels = moving.lanes
    for n in range(len(levels.level)):
        level, speed, wanted = levels.level[n], levels.level_speed[n], -levels.descent_speed[n]
        loop = VelocityLoop(levels.gain[n], levels.acceleration[n], HIGHEST - LOWEST)
        height, next_speed = velocity_loop_step(loop, level - LOWEST, speed, wanted, TICK)
        rests = wanted == 0.0 and speed == 0.0
        levels.level_speed[n] = speed if rests else next_speed
        levels.next_level[n] = level if rests or next_speed == 0.0 else height + LOWEST


@njit_inline
def renew_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Update the profiles of cuts that reach another grid point."""
    slab = moving.shared[0].slab[0]
    for n in range(row.taken):
        i, j, far = row.tip_point[n], row.blade_point[n], row.da[n] > LONGEST_ADVANCE
        if row.going[n] == 1 and (i != row.seen_tip_point[n] or j != row.seen_blade_point[n] or far):
            profile, descent = profiles[row.cut[n]], moving.records[row.cut[n]]
            if far:
                renew_between(profile, descent, slab, row.tip[n], row.blade[n])
            renew(profile, descent, slab, i)
            renew(profile, descent, slab, i + 1)
            renew_edge(profile, descent, j)
            renew_edge(profile, descent, j + 1)


@njit_inline
def renew_runs(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Update the profiles of running cracks, from tip to blade."""
    for n in range(row.taken):
        if row.going[n] == 1 and row.waits[n] == 0:
            renew_between(
                profiles[row.cut[n]], moving.records[row.cut[n]], moving.shared[0].slab[0], row.tip[n], row.blade[n]
            )


@njit_inline
def respond_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Lower each blade, and sum the forces of floor and tissue."""
    levels = moving.lanes
    due = 0
    for n in range(len(row.blade)):
        levels.waiting[n] -= 1
        due += 1 if levels.waiting[n] <= 0 else 0
    move_to_level(row, levels)
    if due > 0:
        for n in range(row.taken):
            if row.going[n] == 1 and levels.waiting[n] <= 0:
                scatter(moving.views, n, row.cut[n])
                respond(row, profiles[row.cut[n]], moving.records[row.cut[n]], moving.shared[0].slab[0], n)
                gather(moving.views, n, row.cut[n])
    add_up_forces(row, levels)


@njit_inline
def motion_down(levels: Struct, n: Integer) -> tuple[float, float]:
    """Return the bristles' deflection and the blade's motion, downwards [m]."""
    return levels.lowered[n], levels.level[n] - levels.next_level[n]


@njit_inline
def grip_blade(levels: Struct, n: Integer, lowered: float, force: float) -> None:
    """Store the downward bristle deflection [m] and upward friction [N]."""
    levels.lowered[n], levels.grip[n] = lowered, force


@njit_inline
def move_to_level(row: Struct, levels: Struct) -> None:
    """Move each blade to its next level, against the edge's springs."""
    for n in range(len(row.blade)):
        fall = levels.level[n] - levels.next_level[n]
        levels.level[n] = levels.next_level[n]
        was, spring = levels.bearing[n], levels.spring[n]
        bearing = was + spring * fall
        rises = bearing < 0.0  # it leaves the floor on the way
        pressing = -0.5 * was**2 / spring if rises else 0.5 * (was + bearing) * fall
        levels.bearing[n] = 0.0 if rises else bearing
        levels.pressed[n] += pressing
        row.work[n] += pressing


@njit_inline
def add_up_forces(row: Struct, levels: Struct) -> None:
    """Compute the vertical force; add slicing drag along the cut."""
    for n in range(len(row.blade)):
        lag = max(row.blade[n] - row.creep[n] - row.tip[n], 0.0)
        levels.vertical[n] = levels.bearing[n] + levels.grip[n] + 0.5 * levels.rise[n] * lag**2
        # It reverses as friction on the faces does, but a blade that goes down does not turn it aside.
        levels.drawn[n] = deflected(law_in_row(row, n), levels.drawn[n], row.dx[n])
        drag = levels.slicing[n] * levels.drawn[n] * row.per_presliding_length[n] if levels.slicing[n] > 0.0 else 0.0
        levels.drag[n] = drag
        row.force[n] += drag


@njit_internal
def respond(row: Struct, profile: Struct, descent: Struct, slab: Struct, n: int) -> None:
    """Let floor and tissue respond to the latest motion."""
    a, x = row.tip[n], row.blade[n]
    moved, fall = x - descent.blade, descent.settled - descent.level
    lag, grown, cell = x - row.creep[n] - a, a - descent.tip, int(a * POINTS_PER_METRE + 0.5)
    onwards = cell != descent.cell
    for i in range(descent.cell + 1, cell + 1):
        descent.floor[i] = descent.engaged
    descent.waiting, descent.blade, descent.settled = descent.response, x, descent.level
    descent.cell, descent.tip = cell, a
    # A loading blade carries the tissue with it: the edge is drawn through it as far as the tip advances.  After a run
    # the edge slips through the length that it opened as the blade moves on: slicing force depends on motion alone.
    if lag >= 0.0:
        descent.owed_slip += grown
        slip = min(descent.owed_slip, max(moved, 0.0))
        descent.owed_slip -= slip
    else:
        descent.owed_slip, slip = 0.0, abs(moved)

    at, sliced = a + min(lag, 0.0), 0.0  # the leading end of the edge, in the tissue
    under = int(at * POINTS_PER_METRE + 0.5)
    if fall != 0.0 or descent.pressed != 0.0 or under != descent.under:
        descent.under = under
        pressing, released, spent, sliced, descent.bearing, descent.spring = press(descent, at, a, slip)
        surplus = spent - released
        row.work[n] += (pressing - descent.pressed) + max(surplus, 0.0)
        row.fracture[n] += spent
        row.loss[n] += max(-surplus, 0.0)
        descent.pressed = pressing - released
        sliced = max(surplus, 0.0) if fall <= 0.0 else min(max(surplus, 0.0), sliced)
    engaged = max(descent.level, descent.floor[cell])
    if engaged != descent.engaged or fall != 0.0:
        row.work[n] += engage(row, profile, descent, slab, n, engaged, fall, max(lag, 0.0))
    elif onwards or descent.rise == 0.0:
        descent.rise = rise_with_depth(descent, slab, cell)
    descent.pending_slicing = max(descent.pending_slicing - descent.slicing * abs(moved), 0.0) + (
        sliced if moved != 0.0 else 0.0
    )
    descent.slicing = descent.pending_slicing * POINTS_PER_METRE


@njit_internal
def engage(
    row: Struct, profile: Struct, descent: Struct, slab: Struct, n: int, engaged: float, fall: float, lag: float
) -> float:
    """Engage one blade to level ``engaged`` [m]; return the work [J]."""
    a, x, K, toughness = row.tip[n], row.blade[n], row.K[n], row.toughness[n]
    descent.engaged = engaged
    descent.version += 1
    renew_between(profile, descent, slab, a, a)
    j = grid_index(x)[0]
    renew_edge(profile, descent, j)
    renew_edge(profile, descent, j + 1)
    row.K[n], row.dK[n] = stiffness_at(profile, a)
    row.toughness[n], row.depth[n] = toughness_at(profile, a), depth_at(profile, x)
    row.seen_tip_point[n], row.seen_blade_point[n] = -1, -1
    row.held_force[n] *= row.toughness[n] / toughness
    row.elastic[n] = row.K[n] * lag
    row.force[n] += row.elastic[n] - K * lag
    if abs(fall) > _LEAST_CHANGE:
        descent.rise = (row.K[n] - K) / fall
    else:
        descent.rise = rise_with_depth(descent, slab, descent.cell)
    return 0.5 * (row.K[n] - K) * lag**2  # type: ignore[no-any-return]


@njit_inline
def lead_to_level(row: Struct, levels: Struct, level: float) -> float:
    """Lead one blade to ``level`` [m]; return its position [m]."""
    levels.next_level[0] = level
    return row.blade[0]  # type: ignore[no-any-return]


@njit_inline
def vertical_force(levels: Struct, n: Integer) -> float:
    """Return the tissue's upward force on a blade [N]."""
    return levels.vertical[n]  # type: ignore[no-any-return]


@njit_inline
def stored_in_bed(descent: Struct) -> float:
    """Return the energy stored in the floor's bed [J]."""
    return descent.pressed  # type: ignore[no-any-return]


DESCENDING = Motion(
    place=f"{__name__}:DESCENDING",
    record=DESCENT,
    scratch=(
        ("descent_speed", "f8"),  # commanded, downwards [m/s]
        ("next_level", "f8"),  # to which the blade goes in this update [m]
    ),
    shared=SHARED,
    command=command_descent,
    drive=lower_row,
    renew=renew_row,
    renew_runs=renew_runs,
    across=motion_down,
    rub=grip_blade,
    respond=respond_row,
    force=vertical_force,
    stored=stored_in_bed,
    lead=lead_to_level,
)
"""Motion along the cut, and up and down."""
