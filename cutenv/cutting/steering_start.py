"""Beginning of a cut in the plane, compiled: its line, and the place of blade and tip on it."""

from __future__ import annotations

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_internal
from cutenv.cutting.law import grid_index, lerp
from cutenv.cutting.steering import begin_steering
from cutenv.tissue.grid import N_POINTS


@njit_internal
def lay_line(profile: Struct, steering: Struct, line: Struct) -> None:
    """Lay a line, :data:`~cutenv.tissue.drawn_lines.LINE`, into a specimen whose profile is that of a straight cut.

    The stiffness of the profile becomes that of a crack on the line; blade and tip stand at its start.
    """
    for i in range(N_POINTS):
        steering.x_excess[i], steering.y[i] = line.x_excess[i], line.y[i]
        steering.cosine[i], steering.sine[i] = line.cosine[i], line.sine[i]
        steering.curvature[i] = line.curvature[i]
        stiffness = profile.stiffness[i]
        steering.along[i], steering.coupled[i] = stiffness * line.along[i], stiffness * line.coupled[i]
        steering.sideways[i] = stiffness * line.across[i]
        steering.toughness[i] = profile.toughness[i]
        steering.cut[i] = 0.0


@njit_internal
def stand_on_line(profile: Struct, steering: Struct, place: float) -> None:
    """Put blade and tip to ``place`` [m] on the line, up to which it is cut; they point along it."""
    i, share = grid_index(place)
    ahead, across = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    steering.ahead, steering.across = ahead, across
    steering.tip_ahead, steering.tip_across = ahead, across
    steering.east = steering.tip_east = lerp(steering.x_excess, i, share)
    steering.north = steering.tip_north = lerp(steering.y, i, share)
    steering.settled, steering.cell = place, i if place > 0.0 else 0
    begin_steering(profile, steering, place)
