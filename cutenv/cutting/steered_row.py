"""The law in the plane for a row of cuts: their places as a structure of arrays (SIMD lanes), beside that of the law.

Arithmetic is in loops that compile to vector instructions, and what is gathered from a cut's own line in others, as in
:mod:`cutenv.cutting.update`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit_inline, njit_internal
from cutenv._engine.randomness import Integer
from cutenv.cutting.beside_row import beside_dtype, scalars_of
from cutenv.cutting.law import LONGEST_ADVANCE, at_share, grid_index, lerp, stiffness_at, toughness_at, value_and_rise
from cutenv.cutting.row import LANES
from cutenv.cutting.steering import (
    LEAST_SPREAD,
    STEERING,
    frame_at,
    renew_point,
    renew_points,
)
from cutenv.cutting.update import grow_row, leap_row, load_row, look_row, run_row, turn_row
from cutenv.tissue.grid import LENGTH, SPACING

_PASSING = (  # scratch: it lives only in the row
    ("turn", "f8"),  # to the left in this update [rad]
    ("next_offset", "f8"),  # h after it [m]
    ("line_point", "i8"),  # grid index of the line in the middle of the blade's motion
    ("line_share", "f8"),  # fraction of the way to the next point
    ("seen_line_point", "i8"),  # grid index of the values below, gathered last
    ("point_cosine", "f8"),
    ("rise_cosine", "f8"),  # difference to the next point
    ("point_sine", "f8"),
    ("rise_sine", "f8"),
    ("point_curvature", "f8"),
    ("rise_curvature", "f8"),
)


PLACE_ROW = beside_dtype(STEERING, _PASSING, LANES)
"""Places in the plane beside a :data:`~cutenv.cutting.row.ROW`."""
ONE_PLACE = beside_dtype(STEERING, _PASSING, 1)
"""Place in the plane beside a :data:`~cutenv.cutting.row.ONE`."""
PLACE_SCALARS = scalars_of(STEERING)
"""Scalars that a record of a place begins with."""


class PlaceInRow(NamedTuple):
    """The fields of a place that functions read, for one cut in a row."""

    ahead: float
    across: float
    tip_ahead: float
    tip_across: float
    east: float
    north: float
    tip_east: float
    tip_north: float
    settled: float
    stretch: float


@njit_inline
def place_in_row(places: Struct, n: int) -> PlaceInRow:
    """Gather the place of the cut in lane ``n``."""
    return PlaceInRow(
        places.ahead[n], places.across[n], places.tip_ahead[n], places.tip_across[n], places.east[n], places.north[n],
        places.tip_east[n], places.tip_north[n], places.settled[n], places.stretch[n],
    )  # fmt: skip


@njit_inline
def aim_place(places: Struct, n: Integer, turn: float) -> None:
    """Prepare lane ``n`` for updates in each of which the blade turns to the left by ``turn`` [rad]."""
    places.turn[n], places.seen_line_point[n] = turn, -1


@njit_inline
def to_crack(place: Struct) -> tuple[float, float]:
    """Return cosine and sine of the angle from the crack to the blade's direction."""
    return (
        place.ahead * place.tip_ahead + place.across * place.tip_across,
        place.tip_ahead * place.across - place.tip_across * place.ahead,
    )


@njit_inline
def turned(ahead: float, across: float, by: float) -> tuple[float, float]:
    """Return a direction turned to the left ``by`` an angle below 0.5 rad; its length stays 1 within 1e-16 a turn."""
    square = by * by
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)))
    sine = by * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0))))
    ahead, across = ahead * cosine - across * sine, ahead * sine + across * cosine
    length = 1.5 - 0.5 * (ahead * ahead + across * across)
    return ahead * length, across * length


@njit_inline
def steered_row(row: Struct, places: Struct, profiles: StructArray, steerings: StructArray, dt: float) -> None:
    """Advance the law as :func:`~cutenv.cutting.update.cut_row`; each blade first turns by ``places.turn`` [rad].

    ``row.dx`` is the way of each blade where it points; ``row.blade``, ``row.hand`` and ``row.tip`` are arc lengths of
    the line.
    """
    if row.turns > 0:
        turn_row(row, profiles)
    aim_row(row, places, steerings)
    load_row(row, dt)
    move_row(row, places, steerings, dt)
    if row.points > 0:
        for n in range(row.taken):
            far = row.da[n] > LONGEST_ADVANCE
            if row.going[n] == 1 and (row.tip_point[n] != row.seen_tip_point[n] or far):
                profile, steering = profiles[row.cut[n]], steerings[row.cut[n]]
                if far:
                    renew_points(profile, steering, row.tip[n], row.x[n])
                renew_point(profile, steering, row.tip_point[n])
                renew_point(profile, steering, row.tip_point[n] + 1)
    if row.leaps > 0:
        leap_row(row, profiles)
    if row.points > 0:
        look_row(row, profiles)
    grow_row(row)
    if row.runs > 0:
        for n in range(row.taken):
            if row.going[n] == 1 and row.waits[n] == 0:
                renew_points(profiles[row.cut[n]], steerings[row.cut[n]], row.tip[n], row.x[n])
        run_row(row, profiles)
    due = 0
    for n in range(len(row.blade)):
        places.waiting[n] -= 1
        due += 1 if places.waiting[n] <= 0 else 0
    if due > 0:
        for n in range(row.taken):
            if row.going[n] == 1 and places.waiting[n] <= 0:
                turn_crack(row, places, profiles[row.cut[n]], steerings[row.cut[n]], n)
    for n in range(len(row.blade)):
        cosine, sine = to_crack(place_in_row(places, n))
        pull, push = row.elastic[n] * places.per_stretch[n], places.side_stiffness[n] * places.offset[n]
        row.force[n] = pull * (cosine + places.coupling[n] * sine) + push * sine + row.rubbing[n]
        row.lateral[n] = pull * (places.coupling[n] * cosine - sine) + push * cosine
        places.lateral[n] = row.lateral[n]


@njit_inline
def aim_row(row: Struct, places: Struct, steerings: StructArray) -> None:
    """Turn each blade, find where its motion leads, and reduce it to that along the crack, on which the law acts.

    At the ends of the line, at the reach on its sides, and beside the slab, a blade stops as at an end stop.
    """
    further = 0
    for n in range(len(row.blade)):
        turn, ahead, across = places.turn[n], places.ahead[n], places.across[n]
        next_ahead, next_across = turned(ahead, across, turn)
        places.ahead[n] = next_ahead if turn != 0.0 else ahead
        places.across[n] = next_across if turn != 0.0 else across
        places.line_point[n], places.line_share[n] = grid_index(row.blade[n] + 0.5 * row.dx[n])
        further += 1 if places.line_point[n] != places.seen_line_point[n] else 0
    if further > 0:
        for n in range(len(row.blade)):
            i = places.line_point[n]
            if i != places.seen_line_point[n]:
                steering = steerings[row.cut[n]]
                places.point_cosine[n], places.rise_cosine[n] = value_and_rise(steering.cosine, i)
                places.point_sine[n], places.rise_sine[n] = value_and_rise(steering.sine, i)
                places.point_curvature[n], places.rise_curvature[n] = value_and_rise(steering.curvature, i)
                places.seen_line_point[n] = i
    for n in range(len(row.blade)):
        way, start, share = row.dx[n], row.blade[n], places.line_share[n]
        ahead, across, was_aside, was_north = places.ahead[n], places.across[n], places.aside[n], places.north[n]
        t_x = at_share(places.point_cosine[n], places.rise_cosine[n], share)
        t_y = at_share(places.point_sine[n], places.rise_sine[n], share)
        curvature = at_share(places.point_curvature[n], places.rise_curvature[n], share)
        spread = max(1.0 - curvature * was_aside, LEAST_SPREAD)
        passed = way * (ahead * t_x + across * t_y) / spread
        aside = was_aside + way * (t_x * across - t_y * ahead)
        cosine, sine = to_crack(place_in_row(places, n))
        seen = way * ((cosine + places.coupling[n] * sine) * places.per_stretch[n])
        north = was_north + way * across
        beyond = max(-(start + passed), (start + passed) - LENGTH, (start - row.creep[n] + seen) - LENGTH)
        beside = abs(north) - max(places.side[n], abs(was_north))
        away = abs(aside) - max(places.reach[n], abs(was_aside))
        stops = max(beyond, beside, away) > 0.0
        row.hand[n] -= way if stops else 0.0
        way = 0.0 if stops else way
        passed = 0.0 if stops else passed
        places.aside[n] = was_aside if stops else aside
        places.east[n] += way * ahead - passed
        places.north[n] += way * across
        row.way[n], row.passed[n], row.dx[n] = way, passed, 0.0 if stops else seen


@njit_inline
def move_row(row: Struct, places: Struct, steerings: StructArray, dt: float) -> None:
    """Move each blade to its place in the plane, whatever of its motion the law has seen.

    To the side it is held by the tissue ahead of the tip, and behind the tip by the faces of the cut.
    """
    behind = 0
    for n in range(len(row.blade)):
        way, passed, seen = row.way[n], row.passed[n], row.dx[n]
        row.blade[n] += passed - seen
        row.creep[n] += passed - seen
        row.hand[n] += passed - way
        row.dx[n], row.speed[n] = way, way / dt
        row.blade_point[n], row.blade_share[n] = grid_index(row.blade[n])
        place = place_in_row(places, n)
        moved = places.offset[n] + way * to_crack(place)[1]
        placed = offset_ahead(row, place, n)[1]
        places.next_offset[n] = placed if places.guided[n] == 1 else moved
        places.guided[n] = 1 if row.x[n] <= row.tip[n] else 0
        behind += places.guided[n]
    if behind > 0:
        for n in range(row.taken):
            if places.guided[n] == 1:
                places.next_offset[n] = places.aside[n] - lerp(
                    steerings[row.cut[n]].cut, row.blade_point[n], row.blade_share[n]
                )
    points = 0
    for n in range(len(row.blade)):
        offset, next_offset = places.offset[n], places.next_offset[n]
        gained = 0.5 * places.side_stiffness[n] * ((next_offset - offset) * (next_offset + offset))
        row.work[n] += gained
        places.held[n] += gained
        places.offset[n] = next_offset
        same = row.tip_point[n] == row.seen_tip_point[n] and row.blade_point[n] == row.seen_blade_point[n]
        points += 0 if same else 1
    row.points = max(points, row.leaps)


@njit_inline
def offset_ahead(row: Struct, place: Struct, n: int) -> tuple[float, float]:
    """Return the offset of one blade from its tip along the crack and to the left of it [m]."""
    advance = row.tip[n] - place.settled
    crack = advance * place.stretch
    e_x, e_y = place.tip_ahead, place.tip_across
    east = (row.blade[n] - row.tip[n]) + (place.east - place.tip_east) - (crack * e_x - advance)
    north = (place.north - place.tip_north) - crack * e_y
    return east * e_x + north * e_y, north * e_x - east * e_y


@njit_internal
def turn_crack(row: Struct, places: Struct, profile: Struct, steering: Struct, n: int) -> None:
    """Let one crack turn, and its tissue respond, to the growth since they last did."""
    places.waiting[n] = places.response[n]
    a, grown = row.tip[n], row.tip[n] - places.settled[n]
    pull = row.elastic[n] * places.per_stretch[n]
    if grown == 0.0:
        places.pull[n] = pull
        return
    lag, K, toughness = row.blade[n] - row.creep[n] - a, row.K[n], row.toughness[n]
    stored = 0.5 * K * max(lag, 0.0) ** 2 + places.held[n]

    i, share = grid_index(a)
    advance = _advance_tip(places, steering, n, a, i, share)
    mean_pull = 0.5 * (places.pull[n] + pull)
    push = places.coupling[n] * mean_pull + places.side_stiffness[n] * places.offset[n]
    if push != 0.0 and lag > 0.0:  # a crack that is not loaded does not turn
        most = places.crack_curvature[n] * advance
        turn = min(max(push / math.sqrt(mean_pull**2 + push**2), -most), most)
        places.tip_ahead[n], places.tip_across[n] = turned(places.tip_ahead[n], places.tip_across[n], turn)
    steering.tip_ahead, steering.tip_across = places.tip_ahead[n], places.tip_across[n]
    steering.tip_aside = places.tip_aside[n]
    steering.version += 1
    frame = frame_at(steering, i, share)
    places.coupling[n], places.side_stiffness[n] = frame.coupling, frame.side_stiffness
    places.stretch[n], places.per_stretch[n] = frame.stretch, 1.0 / frame.stretch
    renew_point(profile, steering, i)
    renew_point(profile, steering, i + 1)

    row.K[n], row.dK[n] = stiffness_at(profile, a)
    row.toughness[n] = toughness_at(profile, a)
    row.seen_tip_point[n] = -1
    row.held_force[n] *= row.toughness[n] / toughness
    ahead, left = offset_ahead(row, place_in_row(places, n), n)
    reduced = min((ahead + places.coupling[n] * left) * places.per_stretch[n], LENGTH - a)
    if places.guided[n] == 0:
        places.offset[n] = left
    else:
        reduced = min(reduced, 0.0)
    row.creep[n] += lag - reduced
    lag = row.blade[n] - row.creep[n] - a
    held = 0.5 * places.side_stiffness[n] * places.offset[n] ** 2
    row.elastic[n] = row.K[n] * max(lag, 0.0)
    taken = 0.5 * row.K[n] * max(lag, 0.0) ** 2 + held - stored
    # As growth may, the turn may borrow no more than the fracture energy of a length, nor more than was ever spent.
    borrowed = min(row.toughness[n] * row.debt_length[n], row.fracture[n] + row.loss[n])
    excess = min(max(taken - max(row.ledger[n] + borrowed, 0.0), 0.0), held)
    if excess > 0.0:
        held -= excess
        places.side_stiffness[n] = 2.0 * held / places.offset[n] ** 2
    places.held[n] = held
    row.ledger[n] -= taken - excess
    places.pull[n] = row.elastic[n] * places.per_stretch[n]


@njit_inline
def _advance_tip(places: Struct, steering: Struct, n: int, a: float, i: int, share: float) -> float:
    """Advance one tip in its direction to ``a`` [m] of the line; return by how much crack [m].

    ``i`` and ``share`` are the grid index of ``a`` and the fraction of the way to the next point.
    """
    start, aside = places.settled[n], places.tip_aside[n]
    advance = (a - start) * places.stretch[n]
    east = places.tip_east[n] + (advance * places.tip_ahead[n] - (a - start))
    north = places.tip_north[n] + advance * places.tip_across[n]
    next_aside = (north - lerp(steering.y, i, share)) * lerp(steering.cosine, i, share) - (
        east - lerp(steering.x_excess, i, share)
    ) * lerp(steering.sine, i, share)
    places.tip_east[n], places.tip_north[n], places.tip_aside[n], places.settled[n] = east, north, next_aside, a
    for k in range(places.cell[n] + 1, i + 1):
        steering.cut[k] = aside + (next_aside - aside) * ((k * SPACING - start) / (a - start))
    places.cell[n] = i
    steering.cut[i + 1] = next_aside
    return advance  # type: ignore[no-any-return]
