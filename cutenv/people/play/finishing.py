"""Advice on what is still missing to finish a cut.

It is in words, and also from what a rig measures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cutenv.sim.quantities import ANGLE_TOLERANCE
from cutenv.task.assessment import FORCE_UNLOADED, SPEED_AT_REST
from cutenv.task.reward import TIME_AT_REST, WITHDRAWN

_SHORTEST_RETREAT = 1e-3  # [m] to advise: a hand cannot aim at less


@dataclass(frozen=True, kw_only=True)
class NearTarget:
    """Measured and estimated state of a cut near its target.

    Attributes
    ----------
    force, elastic : float
        Measured force, and the tissue's part of it as estimated [N].
    friction : float
        Friction of the moving blade as estimated [N].
    stiffness : float
        Stiffness K of the slab at the tip as estimated [N/m].
    speed, angle : float
        Of the blade [m/s], [rad]; pi/2 is upright.
    rested : float
        Time for which the blade has been at rest and unloaded [s].
    withdrawn : float
        Distance drawn back since the tissue was last loaded [m].
    """

    force: float
    elastic: float
    friction: float
    stiffness: float
    speed: float
    angle: float
    rested: float
    withdrawn: float


def missing_to_finish(cut: NearTarget, *, force_shown: bool = True) -> tuple[str, ...]:
    """Return what is missing to finish a cut, most urgent first.

    Without ``force_shown`` it names no force, nor the distance that follows from it.
    """
    missing = []
    if abs(0.5 * math.pi - cut.angle) > ANGLE_TOLERANCE:
        missing.append(f"turn the blade upright: {math.degrees(cut.angle):.0f}°")
    # Friction is estimated: a blade at rest whose rest does not count is loaded, whatever the estimate says.
    if cut.rested == 0.0 and (abs(cut.speed) < SPEED_AT_REST or cut.force > cut.friction + FORCE_UNLOADED):
        # While the blade draws back, friction lowers the force: nothing is felt once friction holds what still pulls.
        back = max((cut.elastic - cut.friction) / cut.stiffness, _SHORTEST_RETREAT)
        words = f"{max(cut.force, 0.0):.1f} N still pull: draw back {back * 1e3:.0f} mm"
        missing.append(words if force_shown else "it still pulls: draw back")
    else:
        words = f"hold still for {max(TIME_AT_REST - cut.rested, 0.0):.1f} s"
        if cut.rested == 0.0:
            words += f", or draw back {max(WITHDRAWN - cut.withdrawn, 0.0) * 1e3:.0f} mm"
        missing.append(words)
    return tuple(missing)
