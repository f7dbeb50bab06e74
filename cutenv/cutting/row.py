"""A row of cuts: all their numbers side by side, taken from the cuts' records and put back."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutenv.compiled import inlined
from cutenv.cutting.drive import made_up
from cutenv.cutting.law import depth_at, stiffness_at, toughness_at
from cutenv.cutting.records import DRIVE, LAW, STATE, TICK, Record, Records
from cutenv.randomness import Integer

ABREAST = 32
"""Cuts in a row: enough for several vectors, few enough for the first-level cache."""
BLOCK = 4
"""Milliseconds whose noise is drawn at once."""

_OWN = (STATE, LAW, DRIVE)  # kept for every cut in records of its own, all of their fields 8 bytes wide
_PASSING = (
    ("cut", "i8"),  # number of the cut, and
    ("going", "i8"),  # whether it goes on: one that has ended is led along, and leaves no trace
    ("noise", "f8"),  # of its sensor [N]
    ("resolution", "f8"),  # [N]
    ("share", "f8"),  # of the velocity loop, see made_up
    ("given", "f8"),  # commanded speed [m/s], and
    ("command", "f8"),  # what has reached the drive of it
    ("aim", "f8"),  # commanded angle [rad]
    ("next_angle", "f8"),
    ("dx", "f8"),  # motion of the blade in this millisecond [m]
    ("K", "f8"),  # stiffness at the tip [N/m],
    ("dK", "f8"),  # its derivative [N/m2]
    ("toughness", "f8"),  # and R B there [N]
    ("depth", "f8"),  # of cut at the blade [m]
    ("edge_toughness", "f8"),  # R B there [N]
    ("x", "f8"),  # where the blade would stand if nothing had crept [m]
    ("loading", "f8"),  # part of the motion under which the tip follows [m], and
    ("da", "f8"),  # by how much it would [m]
    ("F", "f8"),  # elastic force [N] and
    ("U", "f8"),  # stored energy [J] before that part
    ("elastic_work", "f8"),  # until then [J]
    ("tip_point", "i8"),  # of the profile, at or before where the tip would follow to, and
    ("tip_share", "f8"),  # so much of the way to the next
    ("seen_tip_point", "i8"),  # the one that was looked at, where there are
    ("point_K", "f8"),
    ("rise_K", "f8"),  # to the next point
    ("point_toughness", "f8"),
    ("rise_toughness", "f8"),
    ("blade_point", "i8"),  # the same of the blade
    ("blade_share", "f8"),
    ("seen_blade_point", "i8"),
    ("point_depth", "f8"),
    ("rise_depth", "f8"),
    ("rubbing", "f8"),  # force of friction, against forward motion [N]
    ("elastic", "f8"),  # force of the tissue [N]
    ("force", "f8"),  # both, on the blade [N]
    ("waits", "i8"),  # whether its crack does not run
    ("jump", "f8"),  # unstable growth [m]
    ("seed", "u8"),  # key of its noise
    ("episode", "u8"),
    ("inner", "f8"),  # width of the layer next to a random number's
    ("delay", "i8"),  # of its sensor's line [ticks]
    ("delayed", "f8"),  # force as it comes out of that [N]
    ("offset", "f8"),  # drift so far [N]
    ("tare", "f8"),  # [N]
    ("drift", "f8"),  # [N/s^0.5]
    ("felt", "f8"),  # force as measured [N]
)

ROW: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *((name, kind[name].base, (ABREAST,)) for kind in _OWN for name in kind.names or ()),
            *((name, kind, (ABREAST,)) for name, kind in _PASSING),
            ("words", "u8", (BLOCK, ABREAST)),  # random ones for four milliseconds,
            ("normals", "f8", (BLOCK, ABREAST)),  # and the standard normal numbers that they stand for
            ("taken", "i8"),  # cuts in the row
            ("hands", "i8"),  # of them, driven by hand
            ("late", "i8"),  # with a dead time
            ("slack", "i8"),  # with backlash
            ("drifting", "i8"),  # with a sensor whose zero drifts
            ("relaxing", "i8"),  # whose tissue relaxes
            ("turns", "i8"),  # turning in this millisecond
            ("leaps", "i8"),  # whose tip advances far in it
            ("points", "i8"),  # coming to another point of their profile in it
            ("runs", "i8"),  # whose crack runs in it
        ],
    )
)
"""A row of cuts: of every number of a cut, and of what passes between loops, one for each of them."""
_N_STATE, _N_LAW, _N_DRIVE = (len(kind.names or ()) for kind in _OWN)


class LawInRow(NamedTuple):
    """What the law's functions ask of a law, of one cut in a row."""

    quasi_static_modulus: float
    intercept_90: float
    slope_90: float
    fall_1: float
    fall_1_from: float
    fall_1_per: float
    fall_2: float
    fall_2_from: float
    fall_2_per: float
    fall_3: float
    fall_3_from: float
    fall_3_per: float
    intercept_45: float
    slope_45: float
    speed_min: float
    speed_max: float
    eta90: float
    debt_length: float
    growth_step: float
    friction_per_depth: float
    friction_per_depth_speed: float
    presliding_length: float
    per_presliding_length: float
    relaxing_share: float
    creep_time: float


class DriveInRow(NamedTuple):
    """What :func:`cutenv.cutting.drive.pulled` asks of a drive."""

    travel: float
    mass: float
    coupling_stiffness: float
    coupling_damping: float


@inlined
def law_in_row(row: Record, n: int) -> LawInRow:
    """The law of the cut in place ``n``."""
    return LawInRow(
        row.quasi_static_modulus[n], row.intercept_90[n], row.slope_90[n],
        row.fall_1[n], row.fall_1_from[n], row.fall_1_per[n], row.fall_2[n], row.fall_2_from[n], row.fall_2_per[n],
        row.fall_3[n], row.fall_3_from[n], row.fall_3_per[n], row.intercept_45[n], row.slope_45[n],
        row.speed_min[n], row.speed_max[n], row.eta90[n], row.debt_length[n], row.growth_step[n],
        row.friction_per_depth[n], row.friction_per_depth_speed[n], row.presliding_length[n],
        row.per_presliding_length[n], row.relaxing_share[n], row.creep_time[n],
    )  # fmt: skip


@inlined
def take(
    row: Record,
    numbers: Records,
    states: Records,
    laws: Records,
    drives: Records,
    drive: Record,
    sensor: Record,
    profile: Record,
    n: Integer,
    cut: Integer,
) -> None:
    """Put cut number ``cut`` into place ``n`` of a row.

    ``numbers``, ``states``, ``laws`` and ``drives`` are the row and the cuts' records seen as plain numbers: views cost
    more than what they show, so they are made once for many calls.
    """
    for k in range(_N_STATE):
        numbers[k * ABREAST + n] = states[cut * _N_STATE + k]
    for k in range(_N_LAW):
        numbers[(_N_STATE + k) * ABREAST + n] = laws[cut * _N_LAW + k]
    for k in range(_N_DRIVE):
        numbers[(_N_STATE + _N_LAW + k) * ABREAST + n] = drives[cut * _N_DRIVE + k]
    row.cut[n], row.going[n] = cut, 1
    row.noise[n], row.resolution[n], row.seed[n], row.episode[n] = (
        sensor.noise, sensor.resolution, sensor.seed, sensor.episode,
    )  # fmt: skip
    row.delay[n], row.offset[n], row.tare[n], row.drift[n] = (
        sensor.delay, sensor.offset, sensor.tare, sensor.drift,
    )  # fmt: skip
    row.seen_tip_point[n], row.seen_blade_point[n] = -1, -1
    # An exponential costs more than all the rest, and neighbours seldom differ.
    row.share[n] = row.share[n - 1] if n > 0 and row.lag[n] == row.lag[n - 1] else made_up(drive, TICK)
    row.K[n], row.dK[n] = stiffness_at(profile, row.tip[n])
    row.toughness[n] = toughness_at(profile, row.tip[n])
    row.depth[n] = depth_at(profile, row.blade[n])


@inlined
def begin(row: Record, numbers: Records, taken: Integer) -> None:
    """Make a row of its first ``taken`` places ready; in the others a cut stands still, and nobody looks."""
    for n in range(taken, ABREAST):
        for k in range(_N_STATE + _N_LAW + _N_DRIVE + len(_PASSING)):
            numbers[k * ABREAST + n] = numbers[k * ABREAST]
        row.hand[n], row.hand_speed[n], row.given[n], row.mass[n] = row.blade[0], 0.0, 0.0, 0.0
        row.aim[n], row.dead_ticks[n], row.going[n] = row.angle[0], 0, 0
    row.taken = taken
    hands, late, slack, drifting, relaxing = 0, 0, 0, 0, 0
    for n in range(ABREAST):
        hands += 1 if row.mass[n] > 0.0 else 0
        late += 1 if row.dead_ticks[n] > 0 else 0
        slack += 1 if row.backlash[n] > 0.0 else 0
        drifting += 1 if row.drift[n] > 0.0 else 0
        relaxing += 1 if row.relaxing_share[n] > 0.0 else 0
    row.hands, row.late, row.slack, row.drifting, row.relaxing = hands, late, slack, drifting, relaxing


@inlined
def put(numbers: Records, states: Records, n: int, cut: int) -> None:
    """Write the state in place ``n`` of a row back to its cut."""
    for k in range(_N_STATE):
        states[cut * _N_STATE + k] = numbers[k * ABREAST + n]
