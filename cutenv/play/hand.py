"""The hand of a person who plays: where it is meant to be becomes the speed that the simulator's hand is given."""

from __future__ import annotations

import math

from cutenv.cutting.drive import Hand
from cutenv.cutting.records import Record
from cutenv.task.observation import SPEED_SCALE

PLAYED_HAND = Hand(motor_lag=0.020, acceleration=2.0)
"""Quicker than the hand of a simulated person (80 ms, 0.5 m/s2): the lag of a real one is in front of the screen."""

FASTEST = SPEED_SCALE
"""Speed of the hand at most [m/s]: the fastest measured, and an agent's action 1. The blade may lurch faster."""


def speed_toward(target: float, state: Record, hand: Hand = PLAYED_HAND) -> float:
    """Speed [m/s] to command so that the hand comes to ``target`` [m] without swinging beyond it.

    A place is followed through a speed with a lag T, so that the gain 1/(4 T) is critically damped; beyond that
    the hand's acceleration must be able to stop it: v^2 = 2 a d.

    Parameters
    ----------
    target : float
        Where the hand is meant to be, from the clamp [m].
    state : Record
        One :data:`~cutenv.cutting.records.STATE`; its ``hand`` is where it is.
    hand : Hand
        Its lag and acceleration.
    """
    left = target - float(state["hand"])
    stoppable = math.sqrt(2.0 * hand.acceleration * abs(left))
    return math.copysign(min(abs(left) / (4.0 * hand.motor_lag), stoppable, FASTEST), left)
