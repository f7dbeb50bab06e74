"""The cutting law in the plane.

Blade and crack tip leave a drawn line, and the tip turns after the blade.

Places are given along the drawn line: s, the arc length of the foot point, and d, the distance to the line, positive to
the left [m].  In front of the tip the tissue holds the blade as the 2 x 2 stiffness K at the tip tells; u is the
offset of the blade from the tip:

    U = u K u / 2,    F = K u.

With the direction e of the crack, and n to its left, u is divided into a lag l and an offset h to the side,

    l = u.e + c h,    h = u.n,    c = K_en / K_ee:    U = K_ee l^2 / 2 + (K_nn - c K_en) h^2 / 2.

Growth along e shortens l and leaves h, so that the law of :mod:`cutenv.sim.cutting.law` holds for l as it does for the
lag of a straight cut.  Behind the tip the faces of the cut hold the blade sideways, and h is its distance to them.
Over the last millimetre before the tip the one offset fades into the other, so that the force, which is the derivative
of the energy everywhere, does not step where a blade passes the tip.
The crack turns toward the force, in which direction it releases most energy, but by no more than a limit on its
curvature.  It turns, and stiffness and toughness respond to where it stands, every ten updates; between these it runs
straight on.  The energy account stays exact: what the turn of the crack releases or takes goes through the ledger.

On a straight line, with the blade on it, all this is the law of :mod:`cutenv.sim.cutting.update`, to the last bit.  The
stiffness is that of a crack on the line, changed by where the tip stands beside it; see
:mod:`cutenv.sim.tissue.place_model`.  The limit on the curvature, the ten updates, and that faces behind the tip hold
the blade as the tip does, are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.randomness import Integer
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.law import (
    LONGEST_ADVANCE,
    at_share,
    grid_index,
    lerp,
    stiffness_at,
    toughness_at,
    value_and_rise,
)
from cutenv.sim.cutting.motion import Motion, Moving
from cutenv.sim.tissue.drawn_lines import CRACK_CURVATURE, given_line
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.sim.tissue.lines import WIDTH, CutLine
from cutenv.sim.tissue.place_model import stiffness_off_line
from cutenv.sim.tissue.specimen import Specimen

# Largest distance of a blade to its line [m]; farther away the stiffness of a crack on the line tells nothing.
LINE_REACH = 0.015
_FADE = 1e-3  # length behind the tip over which the distance to the faces fades into that to the crack's course [m]
_LEAST_GROWN = 1e-6  # [m], of the crack since a point of the grid, from which the two give its direction
_LEAST_COSINE = 0.25  # of the angle between crack and line: a crack across the line would make no way along it
LEAST_SPREAD = 0.25  # least 1 - curvature times distance: beyond it lies the centre of the line's curvature


@dataclass(frozen=True, kw_only=True)
class SteeringParameters:
    """Constants of the law in the plane."""

    crack_curvature: float = parameter(
        CRACK_CURVATURE, unit="1/m", low=1.0, high=1000.0, provenance="assumed",
        source="largest curvature of the crack: it turns within the length that a blade drags along",
        sensitivity=(50.0, 200.0),
    )  # fmt: skip
    response_time: float = parameter(
        0.010, unit="s", low=0.001, high=0.1, provenance="assumed",
        source="between turns of the crack, which advances a quarter of a millimetre meanwhile at full speed",
        sensitivity=(0.001, 0.020),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


# Record of a cut's place in the plane, and of its line, beside the record of the law.
STEERING: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("aside", "f8"),  # d of the blade [m]
            ("east", "f8"),  # place of the blade: x - s, and y [m]; differences of places keep every bit
            ("north", "f8"),
            ("ahead", "f8"),  # direction in which the blade points: cosine and sine of its angle to the x axis
            ("across", "f8"),
            ("tip_aside", "f8"),  # d of the tip [m]
            ("tip_east", "f8"),  # place of the tip at the last response, as that of the blade [m]
            ("tip_north", "f8"),
            ("tip_ahead", "f8"),  # direction of the crack at its tip, e
            ("tip_across", "f8"),
            ("offset", "f8"),  # h: of the blade to the left of the crack [m]
            ("coupling", "f8"),  # c [1]
            ("side_stiffness", "f8"),  # K_nn - c K_en [N/m]
            ("stretch", "f8"),  # length of crack per length of line [1]
            ("per_stretch", "f8"),
            ("held", "f8"),  # energy in the offset [J]
            ("guided", "i8"),  # 1 while the blade's foot is behind the tip, between the faces of the cut
            ("slope_ahead", "f8"),  # rise of h with the blade's motion along the crack [1]
            ("slope_left", "f8"),  # and to the left of it
            ("bent", "f8"),  # deflection of the friction bristles to the left of the blade [m]
            ("rubbing_aside", "f8"),  # force of friction on the blade, to its right [N]
            ("lateral", "f8"),  # force of tissue and friction on the blade, to its right [N]
            ("crack_curvature", "f8"),  # limit [1/m]
            ("reach", "f8"),  # largest distance of the blade to its line, and to the axis of the slab [m]
            ("side", "f8"),
            ("response", "i8"),  # updates between those of the crack's direction
            ("waiting", "i8"),  # updates until the next one
            ("settled", "f8"),  # s of the tip at the last response [m]
            ("pull", "f8"),  # force along the crack then [N]
            ("cell", "i8"),  # last point of the grid that the tip has passed
            # A row of cuts gathers what stands above.
            ("belongs", "i8", (N_POINTS,)),  # number of turns of the crack to which a point of the profile belongs
            ("version", "i8"),  # their number so far
            ("cut", "f8", (N_POINTS,)),  # d of the cut [m]
            ("x_excess", "f8", (N_POINTS,)),  # x - s of the line [m]
            ("y", "f8", (N_POINTS,)),  # [m]
            ("cosine", "f8", (N_POINTS,)),  # direction of the line
            ("sine", "f8", (N_POINTS,)),
            ("curvature", "f8", (N_POINTS,)),  # [1/m]
            ("along", "f8", (N_POINTS,)),  # stiffness along the line, coupled, and across it [N/m]
            ("coupled", "f8", (N_POINTS,)),
            ("sideways", "f8", (N_POINTS,)),
            ("off_line", "f8", (3 * N_POINTS,)),  # what a tip beside the line changes in these three, by point [1/m]
            ("toughness", "f8", (N_POINTS,)),  # R B [N]
        ],
    )
)


def steering_records(
    specimens: list[Specimen], lines: list[CutLine], profiles: StructArray, parameters: SteeringParameters | None = None
) -> StructArray:
    """Return :data:`STEERING` records, shape (n,), of blades at the lines' starts.

    The stiffness in ``profiles`` of the specimens is replaced.
    """
    parameters = parameters or SteeringParameters()
    records = np.zeros(len(lines), STEERING)
    for record, specimen, line, profile in zip(records, specimens, lines, profiles, strict=True):
        tissue, own = specimen.tissue, specimen.stiffness()
        drawn = given_line(line, tissue.element, tissue.formulation, tissue.poisson).records[0]
        for name in ("x_excess", "y", "cosine", "sine", "curvature", "off_line"):
            record[name] = drawn[name]
        for name, ratio in (("along", "along"), ("coupled", "coupled"), ("sideways", "across")):
            record[name] = own * drawn[ratio]
        record["toughness"], record["crack_curvature"] = profile["toughness"], parameters.crack_curvature
        record["north"], record["tip_north"] = line.y[0], line.y[0]
        record["reach"], record["side"] = LINE_REACH, WIDTH
        record["response"] = record["waiting"] = round(parameters.response_time / TICK)
        for name in ("", "tip_"):
            record[f"{name}ahead"], record[f"{name}across"] = record["cosine"][0], record["sine"][0]
    for n in range(len(records)):
        begin_steering(profiles[n], records[n], 0.0)
    return records


def place_of_blade(states: StructArray, steerings: StructArray) -> tuple[float, float]:
    """Return the blade's place along and across the slab [m]."""
    return float(states["blade"][0] + steerings["east"][0]), float(steerings["north"][0])


def place_of_tip(states: StructArray, steerings: StructArray) -> tuple[float, float]:
    """Return the tip's place along and across the slab [m]."""
    steering = steerings[0]
    advance = (states["tip"][0] - steering["settled"]) * steering["stretch"]
    x = steering["settled"] + steering["tip_east"] + steering["tip_ahead"] * advance
    return float(x), float(steering["tip_north"] + steering["tip_across"] * advance)


@njit
def begin_steering(profile: Struct, steering: Struct, tip: float) -> None:
    """Fill a profile from ``steering`` for a crack from ``tip`` [m]."""
    for i in range(N_POINTS):
        steering.belongs[i] = -1
        renew_point(profile, steering, i)
    _stand(steering, tip)


class CrackFrame(NamedTuple):
    """Stiffness at a point of the line, along the crack's direction."""

    stiffness: float  # along the crack, K_ee [N/m]
    coupling: float  # c [1]
    side_stiffness: float  # k_nn - c K_en [N/m]
    stretch: float  # length of crack per length of line [1]


class LineStiffness(NamedTuple):
    """Direction, curvature [1/m], and stiffness along and across [N/m] at a line's point."""

    cosine: float
    sine: float
    curvature: float
    along: float
    coupled: float
    sideways: float
    off_line: tuple[float, float, float]  # changes by a tip beside the line, see place_model [1/m]


@njit_inline
def _off_line_at(steering: Struct, i: int) -> tuple[float, float, float]:
    """Gather the off-line stiffness rates at point ``i`` of the line."""
    return steering.off_line[3 * i], steering.off_line[3 * i + 1], steering.off_line[3 * i + 2]


@njit_inline
def _between(
    one: tuple[float, float, float], other: tuple[float, float, float], share: float
) -> tuple[float, float, float]:
    """Interpolate three numbers."""
    return (
        at_share(one[0], other[0] - one[0], share), at_share(one[1], other[1] - one[1], share),
        at_share(one[2], other[2] - one[2], share),
    )  # fmt: skip


@njit_inline
def frame_at(steering: Struct, i: int, share: float) -> CrackFrame:
    """Return the stiffness at index ``i`` and fraction ``share``."""
    line = LineStiffness(
        lerp(steering.cosine, i, share), lerp(steering.sine, i, share), lerp(steering.curvature, i, share),
        lerp(steering.along, i, share), lerp(steering.coupled, i, share), lerp(steering.sideways, i, share),
        _between(_off_line_at(steering, i), _off_line_at(steering, i + 1), share),
    )  # fmt: skip
    return _frame(steering, line)


@njit_inline
def _frame(steering: Struct, line: LineStiffness) -> CrackFrame:
    """Rotate a line's stiffness into the frame of the crack."""
    t_x, t_y, curvature, along, coupled, sideways, off_line = line
    along, coupled, sideways = stiffness_off_line((along, coupled, sideways), off_line, steering.tip_aside)
    e_x, e_y = steering.tip_ahead, steering.tip_across
    cosine, sine = e_x * t_x + e_y * t_y, t_x * e_y - t_y * e_x  # of the angle from the line to the crack
    both = cosine * sine
    stiffness = along * cosine**2 + 2.0 * coupled * both + sideways * sine**2
    mixed = (sideways - along) * both + coupled * (cosine**2 - sine**2)
    coupling = mixed / stiffness
    spread = max(1.0 - curvature * steering.tip_aside, LEAST_SPREAD)
    across = along * sine**2 - 2.0 * coupled * both + sideways * cosine**2
    return CrackFrame(stiffness, coupling, across - coupling * mixed, spread / max(cosine, _LEAST_COSINE))


@njit_internal
def renew_point(profile: Struct, steering: Struct, i: int) -> None:
    """Update point ``i`` of a profile to the crack's direction."""
    if steering.belongs[i] == steering.version:
        return
    steering.belongs[i] = steering.version
    line = LineStiffness(
        steering.cosine[i], steering.sine[i], steering.curvature[i], steering.along[i], steering.coupled[i],
        steering.sideways[i], _off_line_at(steering, i),
    )  # fmt: skip
    frame = _frame(steering, line)
    profile.stiffness[i] = frame.stiffness * frame.stretch**2
    profile.toughness[i] = steering.toughness[i] * frame.stretch


@njit_internal
def renew_points(profile: Struct, steering: Struct, low: float, high: float) -> None:
    """Update the points around positions ``low`` to ``high`` [m]."""
    first, last = grid_index(low)[0], grid_index(max(low, high))[0]
    for i in range(first, last + 2):
        renew_point(profile, steering, i)


@njit_inline
def _stand(steering: Struct, tip: float) -> None:
    """Copy coupling, sideways stiffness and stretch from the line's tip."""
    i, share = grid_index(tip)
    frame = frame_at(steering, i, share)
    steering.coupling, steering.side_stiffness = frame.coupling, frame.side_stiffness
    steering.stretch, steering.per_stretch = frame.stretch, 1.0 / frame.stretch


@njit_inline
def advanced(place: Struct, steering: Struct, a: float, i: int, share: float) -> tuple[float, float, float, float]:
    """Return the crack length to ``a`` [m], and the place there [m].

    The place is east, north and aside.  ``i`` and ``share`` are the grid index of ``a`` and the fraction of the way to
    the next point.
    """
    grown = a - place.settled
    advance = grown * place.stretch
    east = place.tip_east + (advance * place.tip_ahead - grown)
    north = place.tip_north + advance * place.tip_across
    aside = (north - lerp(steering.y, i, share)) * lerp(steering.cosine, i, share) - (
        east - lerp(steering.x_excess, i, share)
    ) * lerp(steering.sine, i, share)
    return advance, east, north, aside


class CutPoint(NamedTuple):
    """Cell of the grid, place along the line and distance to its left [m]."""

    cell: int
    place: float
    aside: float


@njit_inline
def lay_cut(steering: Struct, last: CutPoint, tip: CutPoint) -> None:
    """Lay the cut from the ``last`` point to the ``tip``."""
    for k in range(last.cell + 1, tip.cell + 1):
        share = (k * SPACING - last.place) / (tip.place - last.place)
        steering.cut[k] = last.aside + (tip.aside - last.aside) * share
    steering.cut[tip.cell + 1] = tip.aside


@njit_inline
def advance_tip(steering: Struct, a: float) -> float:
    """Advance a tip to ``a`` [m]; return the growth [m]."""
    i, share = grid_index(a)
    advance, east, north, aside = advanced(steering, steering, a, i, share)
    lay_cut(steering, CutPoint(steering.cell, steering.settled, steering.tip_aside), CutPoint(i, a, aside))
    steering.tip_east, steering.tip_north, steering.tip_aside = east, north, aside
    steering.settled, steering.cell = a, i
    return advance


class PlaceInRow(NamedTuple):
    """Fields of a place for one cut in a row."""

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
def command_turn(places: Struct, n: Integer, rate: float) -> None:
    """Command a rate of turn to the left [rad/s]."""
    _aim_place(places, n, rate * TICK)


@njit_inline
def _aim_place(places: Struct, n: Integer, turn: float) -> None:
    """Prepare lane ``n`` for a left ``turn`` [rad] per update."""
    places.turn[n], places.seen_line_point[n] = turn, -1


@njit_inline
def to_crack(place: Struct) -> tuple[float, float]:
    """Return cosine and sine of the blade's angle to the crack."""
    return (
        place.ahead * place.tip_ahead + place.across * place.tip_across,
        place.tip_ahead * place.across - place.tip_across * place.ahead,
    )


@njit_inline
def turned(ahead: float, across: float, by: float) -> tuple[float, float]:
    """Return a direction turned left ``by`` less than 0.5 rad, of length 1."""
    square = by * by
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)))
    sine = by * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0))))
    ahead, across = ahead * cosine - across * sine, ahead * sine + across * cosine
    length = 1.5 - 0.5 * (ahead * ahead + across * across)
    return ahead * length, across * length


@njit_inline
def renew_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Update profiles of cuts whose tip reaches another grid point."""
    if row.points > 0:
        for n in range(row.taken):
            far = row.da[n] > LONGEST_ADVANCE
            if row.going[n] == 1 and (row.tip_point[n] != row.seen_tip_point[n] or far):
                profile, steering = profiles[row.cut[n]], moving.records[row.cut[n]]
                if far:
                    renew_points(profile, steering, row.tip[n], row.x[n])
                renew_point(profile, steering, row.tip_point[n])
                renew_point(profile, steering, row.tip_point[n] + 1)


@njit_inline
def renew_runs(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Update the profiles of running cracks, from tip to blade."""
    for n in range(row.taken):
        if row.going[n] == 1 and row.waits[n] == 0:
            renew_points(profiles[row.cut[n]], moving.records[row.cut[n]], row.tip[n], row.x[n])


@njit_inline
def respond_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Turn cracks, and sum the forces along and across the blades."""
    places = moving.lanes
    due = 0
    for n in range(len(row.blade)):
        places.waiting[n] -= 1
        due += 1 if places.waiting[n] <= 0 else 0
    if due > 0:
        for n in range(row.taken):
            if row.going[n] == 1 and places.waiting[n] <= 0:
                turn_crack(row, places, profiles[row.cut[n]], moving.records[row.cut[n]], n)
    for n in range(len(row.blade)):
        cosine, sine = to_crack(place_in_row(places, n))
        pull, push = row.elastic[n] * places.per_stretch[n], places.side_stiffness[n] * places.offset[n]
        ahead, left = places.slope_ahead[n], places.slope_left[n]
        along, aside = left * sine + ahead * cosine, left * cosine - ahead * sine
        row.force[n] = pull * (cosine + places.coupling[n] * sine) + push * along + row.rubbing[n]
        places.lateral[n] = pull * (places.coupling[n] * cosine - sine) + push * aside + places.rubbing_aside[n]


@njit_inline
def aim_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Turn each blade, and project its motion onto the crack.

    At the ends of the line, at the reach on its sides, and outside the slab, a blade stops as at an end stop.
    """
    places, steerings = moving.lanes, moving.records
    further = 0
    for n in range(len(row.blade)):
        turn, ahead, across = places.turn[n], places.ahead[n], places.across[n]
        next_ahead, next_across = turned(ahead, across, turn)
        places.ahead[n] = next_ahead if turn != 0.0 else ahead
        places.across[n] = next_across if turn != 0.0 else across
        # The tissue that sticks to the faces keeps its place while the blade turns.
        cosine, sine = ahead * next_ahead + across * next_across, ahead * next_across - across * next_ahead
        along, bent = row.bristle[n], places.bent[n]
        row.bristle[n] = along * cosine + bent * sine if turn != 0.0 else along
        places.bent[n] = bent * cosine - along * sine if turn != 0.0 else bent
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
        outside = abs(north) - max(places.side[n], abs(was_north))
        away = abs(aside) - max(places.reach[n], abs(was_aside))
        stops = max(beyond, outside, away) > 0.0
        row.hand[n] -= way if stops else 0.0
        way = 0.0 if stops else way
        passed = 0.0 if stops else passed
        places.aside[n] = was_aside if stops else aside
        places.east[n] += way * ahead - passed
        places.north[n] += way * across
        places.way[n], places.passed[n], row.dx[n] = way, passed, 0.0 if stops else seen


@njit_inline
def move_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
    """Move each blade in the plane, replacing motion along the crack.

    To the side the blade is held by the tissue ahead of the tip, and behind the tip by the faces of the cut.
    """
    places, steerings = moving.lanes, moving.records
    behind = 0
    for n in range(len(row.blade)):
        way, passed, seen = places.way[n], places.passed[n], row.dx[n]
        row.blade[n] += passed - seen
        row.creep[n] += passed - seen
        row.hand[n] += passed - way
        row.dx[n], row.speed[n] = way, way / dt
        row.blade_point[n], row.blade_share[n] = grid_index(row.blade[n])
        place = place_in_row(places, n)
        moved = places.offset[n] + way * to_crack(place)[1]
        ahead, left = offset_ahead(row, place, n)
        places.next_offset[n] = left if places.guided[n] == 1 else moved
        places.slope_ahead[n], places.slope_left[n] = 0.0, 1.0
        places.guided[n] = 1 if ahead < 0.0 else 0
        behind += places.guided[n]
    if behind > 0:
        for n in range(row.taken):
            if places.guided[n] == 1:
                places.next_offset[n], places.slope_ahead[n], places.slope_left[n] = offset_behind(
                    row, places, steerings[row.cut[n]], n
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
def bristles_aside(places: Struct, n: Integer) -> tuple[float, float]:
    """Return the bristles' leftward deflection and the blade's leftward motion [m]."""
    return places.bent[n], 0.0


@njit_inline
def hold_aside(places: Struct, n: Integer, bent: float, force: float) -> None:
    """Store the leftward deflection [m] and the rightward friction [N]."""
    places.bent[n], places.rubbing_aside[n] = bent, force


@njit_inline
def offset_ahead(row: Struct, place: Struct, n: int) -> tuple[float, float]:
    """Return a blade's offset ahead and left of its settled tip [m]."""
    e_x, e_y = place.tip_ahead, place.tip_across
    east = (row.blade[n] - place.settled) + (place.east - place.tip_east)
    north = place.north - place.tip_north
    return east * e_x + north * e_y, north * e_x - east * e_y


@njit_internal
def offset_behind(row: Struct, places: Struct, steering: Struct, n: int) -> tuple[float, float, float]:
    """Return h behind the tip [m], and its slopes [1].

    It is the blade's distance to the faces of the cut, across the drawn line, which fades into that to the crack's
    course straight back, as ahead of the tip.
    """
    i, share = row.blade_point[n], row.blade_share[n]
    settled, e_x, e_y = places.settled[n], places.tip_ahead[n], places.tip_across[n]
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    start = i * SPACING
    grown = settled - start
    if row.blade[n] < settled and grown > SPACING:
        slope = (steering.cut[i + 1] - steering.cut[i]) / SPACING
        face = steering.cut[i] + slope * (row.blade[n] - start)
    else:  # between the last point that the tip has passed and the tip, or beside what is ahead of it
        j, part = grid_index(settled)
        sine = lerp(steering.cosine, j, part) * e_y - lerp(steering.sine, j, part) * e_x
        slope = sine * places.stretch[n]
        if row.blade[n] < settled and grown > _LEAST_GROWN:
            slope = (places.tip_aside[n] - steering.cut[i]) / grown
        face = places.tip_aside[n] + slope * (row.blade[n] - settled)
    spread = max(1.0 - lerp(steering.curvature, i, share) * places.aside[n], LEAST_SPREAD)
    faces, slope = places.aside[n] - face, slope / spread
    x, y = 0.0 - t_y - slope * t_x, t_x - slope * t_y  # how it rises along the slab and across
    ahead, left = offset_ahead(row, place_in_row(places, n), n)
    part = min(max(1.0 + ahead / _FADE, 0.0), 1.0)
    fade, per_way = part * part * (3.0 - 2.0 * part), 6.0 * part * (1.0 - part) / _FADE
    return (
        faces + fade * (left - faces),
        (1.0 - fade) * (x * e_x + y * e_y) + per_way * (left - faces),
        (1.0 - fade) * (y * e_x - x * e_y) + fade,
    )


@njit_internal
def turn_crack(row: Struct, places: Struct, profile: Struct, steering: Struct, n: int) -> None:
    """Turn one crack and its tissue for the latest growth."""
    places.waiting[n] = places.response[n]
    a, grown = row.tip[n], row.tip[n] - places.settled[n]
    pull = row.elastic[n] * places.per_stretch[n]
    if grown == 0.0:
        places.pull[n] = pull
        return
    lag, K, toughness = row.blade[n] - row.creep[n] - a, row.K[n], row.toughness[n]
    stored = 0.5 * K * max(lag, 0.0) ** 2 + places.held[n]

    i, share = grid_index(a)
    advance, east, north, next_aside = advanced(place_in_row(places, n), steering, a, i, share)
    last = CutPoint(places.cell[n], places.settled[n], places.tip_aside[n])
    lay_cut(steering, last, CutPoint(i, a, next_aside))
    places.tip_east[n], places.tip_north[n], places.tip_aside[n] = east, north, next_aside
    places.settled[n], places.cell[n] = a, i
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
    places.guided[n] = 1 if ahead < 0.0 else 0
    places.offset[n], places.slope_ahead[n], places.slope_left[n] = left, 0.0, 1.0
    if places.guided[n] == 1:
        places.offset[n], places.slope_ahead[n], places.slope_left[n] = offset_behind(row, places, steering, n)
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


@njit_internal
def lay_line(profile: Struct, steering: Struct, line: Struct) -> None:
    """Fit a straight cut's profile to a :data:`~cutenv.sim.tissue.drawn_lines.LINE`.

    The stiffness of the profile becomes that of a crack on the line; blade and tip stand at its start.
    """
    for i in range(N_POINTS):
        steering.x_excess[i], steering.y[i] = line.x_excess[i], line.y[i]
        steering.cosine[i], steering.sine[i] = line.cosine[i], line.sine[i]
        steering.curvature[i] = line.curvature[i]
        stiffness = profile.stiffness[i]
        steering.along[i], steering.coupled[i] = stiffness * line.along[i], stiffness * line.coupled[i]
        steering.sideways[i] = stiffness * line.across[i]
        for k in range(3 * i, 3 * i + 3):
            steering.off_line[k] = line.off_line[k]
        steering.toughness[i] = profile.toughness[i]
        steering.cut[i] = 0.0


@njit_internal
def stand_on_line(profile: Struct, steering: Struct, place: float) -> None:
    """Put blade and tip on the line at ``place`` [m]."""
    i, share = grid_index(place)
    ahead, across = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    steering.ahead, steering.across = ahead, across
    steering.tip_ahead, steering.tip_across = ahead, across
    steering.east = steering.tip_east = lerp(steering.x_excess, i, share)
    steering.north = steering.tip_north = lerp(steering.y, i, share)
    steering.settled, steering.cell = place, i if place > 0.0 else 0
    begin_steering(profile, steering, place)


@njit_inline
def lead_turn(row: Struct, places: Struct, turn: float) -> float:
    """Turn one blade left [rad]; return the way travelled [m]."""
    _aim_place(places, 0, turn)
    # The law moves blade and hand along the line alike, but for the blade's own motion.
    return row.blade[0] - row.hand[0]  # type: ignore[no-any-return]


@njit_inline
def lateral_force(places: Struct, n: Integer) -> float:
    """Return the force on a blade, to its right [N]."""
    return places.lateral[n]  # type: ignore[no-any-return]


@njit_inline
def pull_back(places: Struct, n: Integer, felt: float) -> float:
    """Return the force along the line from ``felt`` along the blade."""
    t_x = places.point_cosine[n] + places.line_share[n] * places.rise_cosine[n]
    t_y = places.point_sine[n] + places.line_share[n] * places.rise_sine[n]
    turned_ahead, turned_left = (
        places.ahead[n] * t_x + places.across[n] * t_y,
        places.across[n] * t_x - places.ahead[n] * t_y,
    )
    return felt * turned_ahead - places.lateral[n] * turned_left  # type: ignore[no-any-return]


@njit_inline
def stored_aside(steering: Struct) -> float:
    """Return the energy that is held sideways [J]."""
    return steering.held  # type: ignore[no-any-return]


STEERED = Motion(
    place=f"{__name__}:STEERED",
    record=STEERING,
    scratch=(
        ("turn", "f8"),  # to the left in this update [rad]
        ("way", "f8"),  # of the blade in the plane [m]; the law's dx is the part of it along the crack
        ("passed", "f8"),  # the part of it along the drawn line [m]
        ("plane_force", "f8"),  # size of the force in the plane [N]
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
    ),
    command=command_turn,
    aim=aim_row,
    move=move_row,
    renew=renew_row,
    renew_runs=renew_runs,
    across=bristles_aside,
    rub=hold_aside,
    respond=respond_row,
    force=lateral_force,
    pull=pull_back,
    stored=stored_aside,
    lead=lead_turn,
    stops_at_ends=True,
)
"""Motion where the blade points, which turns to the left and right."""
