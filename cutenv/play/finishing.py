"""Advice in words on what is still missing to finish a cut; from what a rig measures, too."""

from __future__ import annotations

import math

from cutenv.task.assessment import FORCE_UNLOADED, SPEED_AT_REST
from cutenv.task.reward import TIME_AT_REST, WITHDRAWN
from cutenv.task_quantities import ANGLE_TOLERANCE

_SHORTEST_RETREAT = 1e-3  # [m] to advise: a hand cannot aim at less


def missing_to_finish(
    *,
    force: float,
    elastic: float,
    friction: float,
    stiffness: float,
    speed: float,
    angle: float,
    rested: float,
    withdrawn: float,
    force_shown: bool = True,
) -> tuple[str, ...]:
    """Return what is still missing to finish a cut that has come near its target, most urgent first.

    Parameters
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
    force_shown : bool
        False to name no force, nor the distance that follows from it.
    """
    missing = []
    if abs(0.5 * math.pi - angle) > ANGLE_TOLERANCE:
        missing.append(f"turn the blade upright: {math.degrees(angle):.0f}°")
    # Friction is estimated: a blade at rest whose rest does not count is loaded, whatever the estimate says.
    if rested == 0.0 and (abs(speed) < SPEED_AT_REST or force > friction + FORCE_UNLOADED):
        # While the blade draws back, friction lowers the force: nothing is felt once friction holds what still pulls.
        back = max((elastic - friction) / stiffness, _SHORTEST_RETREAT)
        words = f"{max(force, 0.0):.1f} N still pull: draw back {back * 1e3:.0f} mm"
        missing.append(words if force_shown else "it still pulls: draw back")
    else:
        words = f"hold still for {max(TIME_AT_REST - rested, 0.0):.1f} s"
        if rested == 0.0:
            words += f", or draw back {max(WITHDRAWN - withdrawn, 0.0) * 1e3:.0f} mm"
        missing.append(words)
    return tuple(missing)
