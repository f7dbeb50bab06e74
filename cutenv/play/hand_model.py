"""Hand of a person who plays: its wanted position becomes the speed command of the simulator's hand."""

from __future__ import annotations

import math

from cutenv._base.arrays import Struct
from cutenv.cutting.drive import Hand
from cutenv.task.observation import SPEED_SCALE

PLAYED_HAND = Hand(motor_lag=0.020, acceleration=2.0)
"""Hand that is quicker than a simulated person's (80 ms, 0.5 m/s2): the real person in front adds a lag."""

FASTEST = SPEED_SCALE
"""Greatest speed of the hand [m/s]: the fastest measured, and an agent's action 1. The blade may lurch faster."""


def speed_toward(target: float, state: Struct, hand: Hand = PLAYED_HAND) -> float:
    """Return the speed command [m/s] that brings the hand to ``target`` [m] without overshoot.

    A position is followed through a speed with a lag T, for which the gain 1/(4 T) is critically damped; farther away,
    the hand's acceleration must be able to stop it: v^2 = 2 a d.

    Parameters
    ----------
    target : float
        Wanted position of the hand, from the clamp [m].
    state : Record
        One :data:`~cutenv.cutting.dtypes.STATE`; its ``hand`` is the present position.
    hand : Hand
        Hand with its lag and acceleration.
    """
    left = target - float(state["hand"])
    stoppable = math.sqrt(2.0 * hand.acceleration * abs(left))
    return math.copysign(min(abs(left) / (4.0 * hand.motor_lag), stoppable, FASTEST), left)
