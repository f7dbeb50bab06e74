"""The cutting law in the plane: blade and crack tip leave a drawn line, and the tip turns after the blade.

Places are told along the drawn line: s, the arc length of the foot point, and d, the distance to the line, positive to
the left [m].  In front of the tip the tissue holds the blade as the 2 x 2 stiffness K at the tip tells; u is the
offset of the blade from the tip:

    U = u K u / 2,    F = K u.

With the direction e of the crack, and n to its left, u is divided into a lag l and an offset h to the side,

    l = u.e + c h,    h = u.n,    c = K_en / K_ee:    U = K_ee l^2 / 2 + (K_nn - c K_en) h^2 / 2.

Growth along e shortens l and leaves h, so that the law of :mod:`cutenv.cutting.law` holds for l as it does for the lag
of a straight cut.  Behind the tip (l < 0) only the second part is left: the faces of the cut hold the blade sideways.
The crack turns toward the force, in which direction it releases most energy, but by no more than a limit on its
curvature.  It turns, and stiffness and toughness respond to where it stands, every ten updates; between these it runs
straight on.  The energy account stays exact: what the turn of the crack releases or takes goes through the ledger.

On a straight line, with the blade on it, all this is the law of :mod:`cutenv.cutting.update`, to the last bit.  The
stiffness is that of a crack on the line, which the tip leaves by millimetres only.  The limit on the curvature, the
ten updates, and that faces behind the tip hold the blade as the tip does, are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.parameter import check_parameters, parameter
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import LONGEST_ADVANCE, grid_index, lerp, stiffness_at, toughness_at
from cutenv.cutting.update import grow_row, leap_row, load_row, look_row, run_row, turn_row
from cutenv.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.tissue.lines import WIDTH, CutLine
from cutenv.tissue.path_model import CRACK_CURVATURE, stiffness_on_line
from cutenv.tissue.specimen import Specimen

LINE_REACH = 0.015
"""Largest distance of a blade to its line [m]; farther away the stiffness of a crack on the line tells nothing."""
_LEAST_COSINE = 0.25  # of the angle between crack and line: a crack across the line would make no way along it
_LEAST_SPREAD = 0.25  # 1 - curvature times distance: beyond it lies the centre of the line's curvature


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
            ("guided", "i8"),  # 1 while the blade is behind the tip, between the faces of the cut
            ("lateral", "f8"),  # force of the tissue on the blade, to its right [N]
            ("crack_curvature", "f8"),  # limit [1/m]
            ("reach", "f8"),  # largest distance of the blade to its line, and to the axis of the slab [m]
            ("side", "f8"),
            ("response", "i8"),  # updates between those of the crack's direction
            ("waiting", "i8"),  # updates until the next one
            ("settled", "f8"),  # s of the tip at the last response [m]
            ("pull", "f8"),  # force along the crack then [N]
            ("cell", "i8"),  # last point of the grid that the tip has passed
            ("version", "i8"),  # number of turns of the crack; a point of the profile belongs to one:
            ("belongs", "i8", (N_POINTS,)),
            ("cut", "f8", (N_POINTS,)),  # d of the cut [m]
            ("x_excess", "f8", (N_POINTS,)),  # x - s of the line [m]
            ("y", "f8", (N_POINTS,)),  # [m]
            ("cosine", "f8", (N_POINTS,)),  # direction of the line
            ("sine", "f8", (N_POINTS,)),
            ("curvature", "f8", (N_POINTS,)),  # [1/m]
            ("along", "f8", (N_POINTS,)),  # stiffness along the line, coupled, and across it [N/m]
            ("coupled", "f8", (N_POINTS,)),
            ("sideways", "f8", (N_POINTS,)),
            ("toughness", "f8", (N_POINTS,)),  # R B [N]
        ],
    )
)
"""Record of a cut's place in the plane, and of its line, beside the record of the law."""


def steering_records(
    specimens: list[Specimen], lines: list[CutLine], profiles: StructArray, parameters: SteeringParameters | None = None
) -> StructArray:
    """Return the records of n cuts in the plane, :data:`STEERING` of shape (n,), with each blade at its line's start.

    Parameters
    ----------
    specimens, lines : list of Specimen, of CutLine
        The tissue, and where to cut.
    profiles : Records
        :data:`~cutenv.cutting.dtypes.PROFILE` of the specimens, shape (n,); the stiffness in it is replaced.
    parameters : SteeringParameters
        Constants of the law in the plane.
    """
    parameters = parameters or SteeringParameters()
    records = np.zeros(len(lines), STEERING)
    for record, specimen, line, profile in zip(records, specimens, lines, profiles, strict=True):
        record["x_excess"], record["y"] = line.x - np.arange(N_POINTS) * SPACING, line.y
        record["cosine"], record["sine"], record["curvature"] = np.cos(line.angle), np.sin(line.angle), line.curvature
        record["along"], record["coupled"], record["sideways"] = stiffness_on_line(specimen, line)
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
    """Return the place of a blade, records of shape (1,), along and across the slab [m]."""
    return float(states["blade"][0] + steerings["east"][0]), float(steerings["north"][0])


def place_of_tip(states: StructArray, steerings: StructArray) -> tuple[float, float]:
    """Return the place of a tip, records of shape (1,), along and across the slab [m]."""
    steering = steerings[0]
    advance = (states["tip"][0] - steering["settled"]) * steering["stretch"]
    x = steering["settled"] + steering["tip_east"] + steering["tip_ahead"] * advance
    return float(x), float(steering["tip_north"] + steering["tip_across"] * advance)


@njit
def begin_steering(profile: Struct, steering: Struct, tip: float) -> None:
    """Take every point of a profile from the stiffness in ``steering``, for a crack that begins at ``tip`` [m]."""
    for i in range(N_POINTS):
        steering.belongs[i] = -1
        renew_point(profile, steering, i)
    _stand(steering, tip)


class CrackFrame(NamedTuple):
    """Stiffness at a point of the line in the frame of a crack's direction there."""

    stiffness: float
    """Along the crack, K_ee [N/m]."""
    coupling: float
    """c [1]."""
    side_stiffness: float
    """K_nn - c K_en [N/m]."""
    stretch: float
    """Length of crack per length of line [1]."""


@njit_inline
def frame_at(steering: Struct, i: int, share: float) -> CrackFrame:
    """Return the stiffness at grid index ``i`` and a fraction ``share`` of the way to the next point."""
    e_x, e_y = steering.tip_ahead, steering.tip_across
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    cosine, sine = e_x * t_x + e_y * t_y, t_x * e_y - t_y * e_x  # of the angle from the line to the crack
    along, coupled, sideways = (
        lerp(steering.along, i, share), lerp(steering.coupled, i, share), lerp(steering.sideways, i, share),
    )  # fmt: skip
    both = cosine * sine
    stiffness = along * cosine**2 + 2.0 * coupled * both + sideways * sine**2
    mixed = (sideways - along) * both + coupled * (cosine**2 - sine**2)
    coupling = mixed / stiffness
    spread = max(1.0 - lerp(steering.curvature, i, share) * steering.tip_aside, _LEAST_SPREAD)
    across = along * sine**2 - 2.0 * coupled * both + sideways * cosine**2
    return CrackFrame(stiffness, coupling, across - coupling * mixed, spread / max(cosine, _LEAST_COSINE))


@njit_internal
def renew_point(profile: Struct, steering: Struct, i: int) -> None:
    """Bring point ``i`` of a profile up to date with the direction of the crack."""
    if steering.belongs[i] == steering.version:
        return
    steering.belongs[i] = steering.version
    frame = frame_at(steering, i, 0.0) if i < N_POINTS - 1 else frame_at(steering, i - 1, 1.0)
    profile.stiffness[i] = frame.stiffness * frame.stretch**2
    profile.toughness[i] = steering.toughness[i] * frame.stretch


@njit_internal
def renew_points(profile: Struct, steering: Struct, low: float, high: float) -> None:
    """Bring the points around positions ``low`` to ``high`` [m] of the line up to date."""
    first, last = grid_index(low)[0], grid_index(max(low, high))[0]
    for i in range(first, last + 2):
        renew_point(profile, steering, i)


@njit_inline
def _stand(steering: Struct, tip: float) -> None:
    """Take coupling, stiffness sideways and stretch from the line at the tip."""
    i, share = grid_index(tip)
    frame = frame_at(steering, i, share)
    steering.coupling, steering.side_stiffness = frame.coupling, frame.side_stiffness
    steering.stretch, steering.per_stretch = frame.stretch, 1.0 / frame.stretch


@njit_inline
def to_crack(steering: Struct) -> tuple[float, float]:
    """Return cosine and sine of the angle from the crack to the blade's direction."""
    return (
        steering.ahead * steering.tip_ahead + steering.across * steering.tip_across,
        steering.tip_ahead * steering.across - steering.tip_across * steering.ahead,
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
def steered_row(row: Struct, profiles: StructArray, steerings: StructArray, turns: StructArray, dt: float) -> None:
    """Advance the law as :func:`~cutenv.cutting.update.cut_row`; each blade first turns by ``turns`` [rad] to the left.

    ``row.dx`` is the way of each blade where it points; ``row.blade``, ``row.hand`` and ``row.tip`` are arc lengths of
    the line.
    """
    if row.turns > 0:
        turn_row(row, profiles)
    for n in range(row.taken):
        if row.going[n] == 1:
            point(row, steerings[row.cut[n]], n, turns[row.cut[n]])
    load_row(row, dt)
    for n in range(row.taken):
        if row.going[n] == 1:
            move(row, profiles[row.cut[n]], steerings[row.cut[n]], n, dt)
    if row.leaps > 0:
        leap_row(row, profiles)
    if row.points > 0:
        look_row(row, profiles)
    grow_row(row)
    if row.runs > 0:
        for n in range(row.taken):
            if row.waits[n] == 0:
                renew_points(profiles[row.cut[n]], steerings[row.cut[n]], row.tip[n], row.x[n])
        run_row(row, profiles)
    for n in range(len(row.blade)):
        row.force[n] = row.elastic[n] + row.rubbing[n]
    for n in range(row.taken):
        if row.going[n] == 1:
            steering = steerings[row.cut[n]]
            steering.waiting -= 1
            if steering.waiting <= 0:
                turn_crack(row, profiles[row.cut[n]], steering, n)
            tell_plane_forces(row, steering, n)


@njit_inline
def point(row: Struct, steering: Struct, n: int, turn: float) -> None:
    """Turn one blade, find where its motion leads, and reduce it to that along the crack, on which the law acts.

    At the ends of the line, at the reach on its sides, and beside the slab, a blade stops as at an end stop.
    """
    if turn != 0.0:
        steering.ahead, steering.across = turned(steering.ahead, steering.across, turn)
    way, start = row.dx[n], row.blade[n]
    i, share = grid_index(start + 0.5 * way)
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    spread = max(1.0 - lerp(steering.curvature, i, share) * steering.aside, _LEAST_SPREAD)
    passed = way * (steering.ahead * t_x + steering.across * t_y) / spread
    aside = steering.aside + way * (t_x * steering.across - t_y * steering.ahead)
    cosine, sine = to_crack(steering)
    seen = way * ((cosine + steering.coupling * sine) * steering.per_stretch)
    within = 0.0 <= start + passed <= LENGTH and start - row.creep[n] + seen <= LENGTH
    north = steering.north + way * steering.across
    within = within and abs(north) <= max(steering.side, abs(steering.north))
    if not (within and abs(aside) <= max(steering.reach, abs(steering.aside))):
        row.hand[n] -= way
        way, passed, aside, seen = 0.0, 0.0, steering.aside, 0.0
    steering.aside = aside
    steering.east += way * steering.ahead - passed
    steering.north += way * steering.across
    row.way[n], row.passed[n], row.dx[n] = way, passed, seen


@njit_inline
def move(row: Struct, profile: Struct, steering: Struct, n: int, dt: float) -> None:
    """Move one blade to its place in the plane, whatever of its motion the law has seen."""
    way, passed, seen = row.way[n], row.passed[n], row.dx[n]
    row.blade[n] += passed - seen
    row.creep[n] += passed - seen
    row.hand[n] += passed - way
    row.dx[n], row.speed[n] = way, way / dt
    row.blade_point[n], row.blade_share[n] = grid_index(row.blade[n])
    hold_sideways(row, steering, n, way * to_crack(steering)[1])
    i, j, far = row.tip_point[n], row.blade_point[n], row.da[n] > LONGEST_ADVANCE
    if i != row.seen_tip_point[n] or j != row.seen_blade_point[n] or far:
        row.points += 1
        if far:
            renew_points(profile, steering, row.tip[n], row.x[n])
        renew_point(profile, steering, i)
        renew_point(profile, steering, i + 1)


@njit_inline
def hold_sideways(row: Struct, steering: Struct, n: int, moved: float) -> None:
    """Move one blade to the side of the crack by ``moved`` [m]; behind the tip, the faces of the cut guide it."""
    if row.x[n] > row.tip[n]:
        offset = offset_ahead(row, steering, n)[1] if steering.guided == 1 else steering.offset + moved
        steering.guided = 0
    else:
        i, share = grid_index(row.blade[n])
        offset = steering.aside - lerp(steering.cut, i, share)
        steering.guided = 1
    if offset != steering.offset:
        gained = 0.5 * steering.side_stiffness * ((offset - steering.offset) * (offset + steering.offset))
        row.work[n] += gained
        steering.held += gained
        steering.offset = offset


@njit_inline
def offset_ahead(row: Struct, steering: Struct, n: int) -> tuple[float, float]:
    """Return the offset of one blade from its tip along the crack and to the left of it [m]."""
    advance = row.tip[n] - steering.settled
    crack = advance * steering.stretch
    e_x, e_y = steering.tip_ahead, steering.tip_across
    east = (row.blade[n] - row.tip[n]) + (steering.east - steering.tip_east) - (crack * e_x - advance)
    north = (steering.north - steering.tip_north) - crack * e_y
    return east * e_x + north * e_y, north * e_x - east * e_y


@njit_inline
def tell_plane_forces(row: Struct, steering: Struct, n: int) -> None:
    """Tell the forces of one blade along its direction and to its right."""
    cosine, sine = to_crack(steering)
    pull, push = row.elastic[n] * steering.per_stretch, steering.side_stiffness * steering.offset
    row.force[n] = pull * (cosine + steering.coupling * sine) + push * sine + row.rubbing[n]
    row.lateral[n] = steering.lateral = pull * (steering.coupling * cosine - sine) + push * cosine


@njit_internal
def turn_crack(row: Struct, profile: Struct, steering: Struct, n: int) -> None:
    """Let one crack turn, and its tissue respond, to the growth since they last did."""
    steering.waiting = steering.response
    a, grown = row.tip[n], row.tip[n] - steering.settled
    pull = row.elastic[n] * steering.per_stretch
    if grown == 0.0:
        steering.pull = pull
        return
    lag, K, toughness = row.blade[n] - row.creep[n] - a, row.K[n], row.toughness[n]
    stored = 0.5 * K * max(lag, 0.0) ** 2 + steering.held

    advance = advance_tip(steering, a)
    mean_pull = 0.5 * (steering.pull + pull)
    push = steering.coupling * mean_pull + steering.side_stiffness * steering.offset
    if push != 0.0 and lag > 0.0:  # a crack that is not loaded does not turn
        most = steering.crack_curvature * advance
        turn = min(max(push / math.sqrt(mean_pull**2 + push**2), -most), most)
        steering.tip_ahead, steering.tip_across = turned(steering.tip_ahead, steering.tip_across, turn)
    steering.version += 1
    _stand(steering, a)
    renew_points(profile, steering, a, a)

    row.K[n], row.dK[n] = stiffness_at(profile, a)
    row.toughness[n] = toughness_at(profile, a)
    row.seen_tip_point[n] = -1
    row.held_force[n] *= row.toughness[n] / toughness
    ahead, left = offset_ahead(row, steering, n)
    reduced = min((ahead + steering.coupling * left) * steering.per_stretch, LENGTH - a)
    if steering.guided == 0:
        steering.offset = left
    else:
        reduced = min(reduced, 0.0)
    row.creep[n] += lag - reduced
    lag = row.blade[n] - row.creep[n] - a
    steering.held = 0.5 * steering.side_stiffness * steering.offset**2
    row.elastic[n] = row.K[n] * max(lag, 0.0)
    taken = 0.5 * row.K[n] * max(lag, 0.0) ** 2 + steering.held - stored
    # As growth may, the turn may borrow no more than the fracture energy of a length, nor more than was ever spent.
    borrowed = min(row.toughness[n] * row.debt_length[n], row.fracture[n] + row.loss[n])
    excess = min(max(taken - max(row.ledger[n] + borrowed, 0.0), 0.0), steering.held)
    if excess > 0.0:
        steering.held -= excess
        steering.side_stiffness = 2.0 * steering.held / steering.offset**2
    row.ledger[n] -= taken - excess
    steering.pull = row.elastic[n] * steering.per_stretch


@njit_inline
def advance_tip(steering: Struct, a: float) -> float:
    """Advance one tip in its direction to ``a`` [m] of the line; return by how much crack [m]."""
    start, aside = steering.settled, steering.tip_aside
    advance = (a - start) * steering.stretch
    steering.tip_east += advance * steering.tip_ahead - (a - start)
    steering.tip_north += advance * steering.tip_across
    i, share = grid_index(a)
    steering.tip_aside = (steering.tip_north - lerp(steering.y, i, share)) * lerp(steering.cosine, i, share) - (
        steering.tip_east - lerp(steering.x_excess, i, share)
    ) * lerp(steering.sine, i, share)
    steering.settled = a
    for k in range(steering.cell + 1, i + 1):
        steering.cut[k] = aside + (steering.tip_aside - aside) * ((k * SPACING - start) / (a - start))
    steering.cell = i
    steering.cut[i + 1] = steering.tip_aside
    return advance  # type: ignore[no-any-return]
