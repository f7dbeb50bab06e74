"""Tissue of an emulated or fake rig along a line."""

from __future__ import annotations

import math

from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.plant import SteeredPlant
from cutenv.sim.plant.simulator import ANGLE_RANGE
from cutenv.sim.tissue.grid import LENGTH, SPACING
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.specimen import Specimen

_MIN_MOTION = 1e-7  # [m] in a millisecond, below which a blade keeps its direction
_TRAIL = 0.002  # [m] for each radian by which the blade turns, at least


class TissueInPlane:
    """Specimen along a line, cut by a blade behind a pivot.

    The blade points where it is moved.

    It turns by a radian in 2 mm of way at most (assumed), so that at rest the steps of encoders do not turn it. The
    blade stands at the start of ``line``, with the inclination ``angle`` [rad]. ``force``, ``side_force``: force of the
    tissue on the blade back toward the clamp, and to the right, across the slab [N].
    """

    def __init__(
        self, specimen: Specimen, line: CutLine, *, law: LawParameters | None = None, angle: float = math.pi / 2
    ) -> None:
        # the specimen, with what is hidden on a rig
        self.plant = SteeredPlant(specimen, line, law=law, angle=measured(angle))
        self.force = self.side_force = 0.0

    def advance(self, x: float, y: float, angle: float) -> None:
        """Move the blade to a place in the slab [m] and an inclination [rad].

        The move takes a millisecond. At the ends of the specimen, and too far from the line, the blade is held.
        """
        state, steering = self.plant.states[0], self.plant.steerings[0]
        at_x, at_y = self.plant.blade
        east, north = within(x) - at_x, y - at_y
        along = float(east * steering.ahead + north * steering.across)
        if (way := math.hypot(east, north)) > _MIN_MOTION:
            along = math.copysign(way, along)
            ahead, across, to_x, to_y = steering.ahead, steering.across, east / along, north / along
            wanted = math.atan2(ahead * to_y - across * to_x, ahead * to_x + across * to_y)
            turn = min(max(wanted, -way / _TRAIL), way / _TRAIL)
            if turn == wanted:
                steering.ahead, steering.across = to_x, to_y
            else:
                cosine, sine = math.cos(turn), math.sin(turn)
                steering.ahead, steering.across = ahead * cosine - across * sine, ahead * sine + across * cosine
                along = float(east * steering.ahead + north * steering.across)
        readings = self.plant.lead(state.blade - state.hand + along, measured(angle))
        force, lateral = float(readings["true_force"][0]), float(self.plant.lateral_force[0])
        ahead, across = float(steering.ahead), float(steering.across)
        self.force, self.side_force = force * ahead - lateral * across, force * across + lateral * ahead

    @property
    def tip(self) -> float:
        """Arc length of the line that the crack has reached [m]."""
        return float(self.plant.states["tip"][0])


def within(position: float) -> float:
    """Limit a position [m] to the travel with tissue."""
    return min(max(position, 0.0), LENGTH - SPACING)


def measured(angle: float) -> float:
    """Limit an angle [rad] to the law's measured range."""
    return min(max(angle, ANGLE_RANGE[0]), ANGLE_RANGE[1])
