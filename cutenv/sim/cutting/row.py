"""Row of cuts as a structure of arrays (SIMD lanes).

It is gathered from the cuts' records and scattered back.

The number of lanes is part of a row's type: kernels are compiled once for :data:`ROW`, whose loops become vector
instructions, and once for :data:`ONE`, where they vanish.

A motion adds lanes of its own: of a record of each cut that begins with scalars, 8 bytes wide each, and ends with
profiles along the cut.  A row gathers the scalars; the profiles stay in the records.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view
from cutenv._engine.jit import njit_inline
from cutenv._engine.randomness import Integer
from cutenv.sim.cutting.drive import lag_gain
from cutenv.sim.cutting.dtypes import DRIVE, LAW, STATE, TICK
from cutenv.sim.cutting.law import depth_at, stiffness_at, toughness_at

LANES = 32  # number of cuts in a row of a batch: enough for several vectors, few enough for the first-level cache
BLOCK = 4  # ticks (milliseconds) whose sensor noise is drawn at once

_OWN = (STATE, LAW, DRIVE)  # stored per cut in structured arrays, all of whose fields are 8 bytes wide
_PASSING = (  # scratch: it lives only in the row
    ("cut", "i8"),  # index of the cut
    ("going", "i8"),  # 1 while active; finished lanes are computed but not stored
    ("noise", "f8"),  # of the cut's sensor, standard deviation [N]
    ("resolution", "f8"),  # [N]
    ("share", "f8"),  # gain of the velocity loop, see :func:`~cutenv.sim.cutting.drive.lag_gain`
    ("given", "f8"),  # commanded speed [m/s]
    ("command", "f8"),  # commanded speed that has reached the drive [m/s]
    ("aim", "f8"),  # commanded angle [rad]
    ("next_angle", "f8"),
    ("dx", "f8"),  # motion of the blade in this millisecond [m]
    ("K", "f8"),  # stiffness at the tip [N/m],
    ("dK", "f8"),  # its derivative [N/m2]
    ("toughness", "f8"),  # R B there [N]
    ("depth", "f8"),  # of cut at the blade [m]
    ("edge_toughness", "f8"),  # R B at the blade [N]
    ("x", "f8"),  # position of the blade less the creep [m]
    ("loading", "f8"),  # part of the motion during which the tip follows [m]
    ("da", "f8"),  # advance of the tip during that part, if the ledger admits it [m]
    ("F", "f8"),  # elastic force before that part [N]
    ("U", "f8"),  # stored energy before that part [J]
    ("elastic_work", "f8"),  # work until then [J]
    ("tip_point", "i8"),  # grid index of the profile at the tip's next position
    ("tip_share", "f8"),  # fraction of the way to the next point
    ("seen_tip_point", "i8"),  # grid index of the values below, gathered last
    ("point_K", "f8"),
    ("rise_K", "f8"),  # difference to the next point
    ("point_toughness", "f8"),
    ("rise_toughness", "f8"),
    ("blade_point", "i8"),  # the same five for the blade
    ("blade_share", "f8"),
    ("seen_blade_point", "i8"),
    ("point_depth", "f8"),
    ("rise_depth", "f8"),
    ("rubbing", "f8"),  # force of friction, against forward motion [N]
    ("elastic", "f8"),  # force of the tissue [N]
    ("force", "f8"),  # both, on the blade [N]
    ("waits", "i8"),  # 1 if the crack does not run
    ("jump", "f8"),  # unstable growth [m]
    ("seed", "u8"),  # seed and episode: key of the sensor's noise
    ("episode", "u8"),
    ("inner", "f8"),  # ziggurat: width of the next layer
    ("delay", "i8"),  # of the sensor [ticks]
    ("delayed", "f8"),  # force that leaves the delay line [N]
    ("offset", "f8"),  # drift so far [N]
    ("tare", "f8"),  # [N]
    ("drift", "f8"),  # [N/s^0.5]
    ("felt", "f8"),  # force as measured [N]
)


def row_dtype(lanes: int) -> np.dtype[Any]:
    """Return the dtype of a row, with ``lanes`` elements per field."""
    fields = [
        *((name, kind[name].base, (lanes,)) for kind in _OWN for name in kind.names or ()),
        *((name, kind, (lanes,)) for name, kind in _PASSING),
        ("words", "u8", (BLOCK, lanes)),  # random words of four milliseconds
        ("normals", "f8", (BLOCK, lanes)),  # the standard normal numbers made of them
        ("taken", "i8"),  # number of cuts in the row, and of those among them:
        ("hands", "i8"),  # driven by hand or by PD control
        ("late", "i8"),  # with a dead time
        ("slack", "i8"),  # with backlash
        ("drifting", "i8"),  # with a sensor whose zero drifts
        ("relaxing", "i8"),  # whose tissue relaxes
        ("turns", "i8"),  # turning in this update
        ("leaps", "i8"),  # whose tip advances far in it
        ("points", "i8"),  # coming to another point of their profile in it
        ("runs", "i8"),  # whose crack runs in it
    ]
    return np.dtype((np.record, fields))


ROW = row_dtype(LANES)  # row of a batch
ONE = row_dtype(1)  # row of a single cut
_N_STATE, _N_LAW, _N_DRIVE = (len(kind.names or ()) for kind in _OWN)


class LawInRow(NamedTuple):
    """Fields of a law for one cut in a row."""

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
    """The fields of a drive that :func:`cutenv.sim.cutting.drive.coupling_step` reads."""

    travel: float
    mass: float
    coupling_stiffness: float
    coupling_damping: float
    drag: float


class BladeInRow(NamedTuple):
    """The fields of a state that :func:`cutenv.sim.cutting.drive.coupling_step` reads."""

    hand: float
    hand_speed: float
    blade: float
    speed: float


@njit_inline
def law_in_row(row: Struct, n: int) -> LawInRow:
    """Gather the law of the cut in lane ``n``."""
    return LawInRow(
        row.quasi_static_modulus[n], row.intercept_90[n], row.slope_90[n],
        row.fall_1[n], row.fall_1_from[n], row.fall_1_per[n], row.fall_2[n], row.fall_2_from[n], row.fall_2_per[n],
        row.fall_3[n], row.fall_3_from[n], row.fall_3_per[n], row.intercept_45[n], row.slope_45[n],
        row.speed_min[n], row.speed_max[n], row.eta90[n], row.debt_length[n], row.growth_step[n],
        row.friction_per_depth[n], row.friction_per_depth_speed[n], row.presliding_length[n],
        row.per_presliding_length[n], row.relaxing_share[n], row.creep_time[n],
    )  # fmt: skip


class Plain(NamedTuple):
    """Row and cuts' records as flat float64 views, made once for speed."""

    row: StructArray
    states: StructArray
    laws: StructArray
    drives: StructArray


@njit_inline
def plain_views(rows: StructArray, states: StructArray, laws: StructArray, drives: StructArray) -> Plain:
    """Return flat views of row, shape (1,), and records, shape (n,)."""
    return Plain(as_float64_view(rows), as_float64_view(states), as_float64_view(laws), as_float64_view(drives))


@njit_inline
def take_tissue(row: Struct, plain: Plain, profile: Struct, n: Integer, cut: Integer) -> None:
    """Gather state, law and drive of cut ``cut`` into lane ``n``."""
    lanes = len(row.blade)
    for k in range(_N_STATE):
        plain.row[k * lanes + n] = plain.states[cut * _N_STATE + k]
    for k in range(_N_LAW):
        plain.row[(_N_STATE + k) * lanes + n] = plain.laws[cut * _N_LAW + k]
    for k in range(_N_DRIVE):
        plain.row[(_N_STATE + _N_LAW + k) * lanes + n] = plain.drives[cut * _N_DRIVE + k]
    row.cut[n], row.going[n] = cut, 1
    row.seen_tip_point[n], row.seen_blade_point[n] = -1, -1
    row.K[n], row.dK[n] = stiffness_at(profile, row.tip[n])
    row.toughness[n] = toughness_at(profile, row.tip[n])
    row.depth[n] = depth_at(profile, row.blade[n])


@njit_inline
def take(row: Struct, plain: Plain, cuts: Any, n: Integer, cut: Integer) -> None:
    """Gather cut ``cut``, with drive and sensor, into lane ``n``."""
    take_tissue(row, plain, cuts.profiles[cut], n, cut)
    take_sensor(row, cuts.sensors[cut], n)
    # The exponential in the gain costs more than the rest of the loading, and neighbours seldom differ.
    row.share[n] = row.share[n - 1] if n > 0 and row.lag[n] == row.lag[n - 1] else lag_gain(cuts.drives[cut], TICK)


@njit_inline
def take_sensor(row: Struct, sensor: Struct, n: Integer) -> None:
    """Load a sensor into lane ``n`` of a row."""
    row.noise[n], row.resolution[n], row.seed[n], row.episode[n] = (
        sensor.noise, sensor.resolution, sensor.seed, sensor.episode,
    )  # fmt: skip
    row.delay[n], row.offset[n], row.tare[n], row.drift[n] = (
        sensor.delay, sensor.offset, sensor.tare, sensor.drift,
    )  # fmt: skip


@njit_inline
def begin(row: Struct, plain: Plain, taken: Integer) -> None:
    """Pad a row of ``taken`` lanes, and count its special cases."""
    lanes = len(row.blade)
    for n in range(taken, lanes):
        for k in range(_N_STATE + _N_LAW + _N_DRIVE + len(_PASSING)):
            plain.row[k * lanes + n] = plain.row[k * lanes]
        row.hand[n], row.hand_speed[n], row.given[n], row.mass[n] = row.blade[0], 0.0, 0.0, 0.0
        row.aim[n], row.dead_ticks[n], row.going[n] = row.angle[0], 0, 0
    row.taken = taken
    hands, late, slack, drifting, relaxing = 0, 0, 0, 0, 0
    for n in range(lanes):
        hands += 1 if row.mass[n] > 0.0 else 0
        late += 1 if row.dead_ticks[n] > 0 else 0
        slack += 1 if row.backlash[n] > 0.0 else 0
        drifting += 1 if row.drift[n] > 0.0 else 0
        relaxing += 1 if row.relaxing_share[n] > 0.0 else 0
    row.hands, row.late, row.slack, row.drifting, row.relaxing = hands, late, slack, drifting, relaxing


@njit_inline
def put(row: Struct, plain: Plain, n: int, cut: int) -> None:
    """Scatter the state in lane ``n`` back to its cut."""
    lanes = len(row.blade)
    for k in range(_N_STATE):
        plain.states[cut * _N_STATE + k] = plain.row[k * lanes + n]


def lane_dtype(record: np.dtype[Any], scratch: Sequence[tuple[str, str]], lanes: int) -> np.dtype[Any]:
    """Return the dtype of lanes for a record's scalars and scratch."""
    names = (record.names or ())[: count_scalars(record)]
    own = [(name, record[name].base, (lanes,)) for name in names]
    return np.dtype((np.record, [*own, *((name, kind, (lanes,)) for name, kind in scratch)]))


def count_scalars(record: np.dtype[Any]) -> int:
    """Return how many scalars a record begins with."""
    names = record.names or ()
    return next((k for k, name in enumerate(names) if record[name].shape != ()), len(names))


class LaneViews(NamedTuple):
    """Lanes and records as flat float64 arrays, like :class:`Plain`."""

    lanes: StructArray
    records: StructArray
    width: Integer  # number of lanes
    scalars: Integer
    size: Integer  # 64-bit numbers in a record


@njit_inline
def lane_views(lanes: StructArray, records: StructArray, count: Integer, scalars: Integer) -> LaneViews:
    """Return flat views of lanes, shape (1,), and records, shape (n,)."""
    numbers = as_float64_view(records)
    return LaneViews(as_float64_view(lanes), numbers, count, scalars, len(numbers) // len(records))


@njit_inline
def gather(views: LaneViews, n: Integer, cut: Integer) -> None:
    """Load the scalars of cut number ``cut`` into lane ``n``."""
    for k in range(views.scalars):
        views.lanes[k * views.width + n] = views.records[cut * views.size + k]


@njit_inline
def pad(views: LaneViews, taken: Integer) -> None:
    """Fill the unused lanes with the first lane's scalars."""
    for n in range(taken, views.width):
        for k in range(views.scalars):
            views.lanes[k * views.width + n] = views.lanes[k * views.width]


@njit_inline
def scatter(views: LaneViews, n: Integer, cut: Integer) -> None:
    """Store the scalars in lane ``n`` back to their cut."""
    for k in range(views.scalars):
        views.records[cut * views.size + k] = views.lanes[k * views.width + n]


@njit_inline
def note(row: Struct, n: int, reading: Struct, dt: float) -> None:
    """Fill a :data:`~cutenv.sim.cutting.dtypes.READING` from lane ``n`` after ``dt`` [s]."""
    moved = row.backlash[n] > 0.0  # the encoder sits at the motor
    reading.time = row.tick[n] * dt
    reading.force = row.felt[n]
    reading.position = row.hand[n] if moved else row.blade[n]
    reading.speed = row.hand_speed[n] if moved else row.speed[n]
    reading.angle = row.angle[n]
    reading.true_force = row.force[n]
    reading.elastic_force = row.elastic[n]
    reading.tip = row.tip[n]
    reading.jump = row.jump[n]
