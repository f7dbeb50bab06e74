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

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.parameter import check_parameters, parameter
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import grid_index, lerp
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.lines import WIDTH, CutLine
from cutenv.tissue.path_model import CRACK_CURVATURE, stiffness_on_line
from cutenv.tissue.specimen import Specimen

LINE_REACH = 0.015
"""Largest distance of a blade to its line [m]; farther away the stiffness of a crack on the line tells nothing."""
_LEAST_COSINE = 0.25  # of the angle between crack and line: a crack across the line would make no way along it
LEAST_SPREAD = 0.25
"""Least 1 - curvature times distance: beyond it lies the centre of the line's curvature."""


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
    return _frame(
        steering, lerp(steering.cosine, i, share), lerp(steering.sine, i, share), lerp(steering.curvature, i, share),
        lerp(steering.along, i, share), lerp(steering.coupled, i, share), lerp(steering.sideways, i, share),
    )  # fmt: skip


@njit_inline
def _frame(
    steering: Struct, t_x: float, t_y: float, curvature: float, along: float, coupled: float, sideways: float
) -> CrackFrame:
    """Turn a stiffness along, coupled and across a line in the direction (t_x, t_y) into the frame of the crack."""
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
    """Bring point ``i`` of a profile up to date with the direction of the crack."""
    if steering.belongs[i] == steering.version:
        return
    steering.belongs[i] = steering.version
    frame = _frame(
        steering, steering.cosine[i], steering.sine[i], steering.curvature[i], steering.along[i], steering.coupled[i],
        steering.sideways[i],
    )  # fmt: skip
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
