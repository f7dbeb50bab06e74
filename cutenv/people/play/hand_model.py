"""Hand of a person: wanted position to speed command."""

from __future__ import annotations

import math

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_internal
from cutenv.sim.cutting.drive import Hand
from cutenv.task.depth import DESCENT_SCALE
from cutenv.task.observation import SPEED_SCALE, speed_action
from cutenv.task.path import TURN_SCALE

PLAYED_HAND = Hand(motor_lag=0.020, acceleration=2.0)
"""Hand that is quicker than a simulated person's (80 ms, 0.5 m/s2): the real person in front adds a lag."""

MAX_HAND_SPEED = SPEED_SCALE
"""Greatest speed of the hand [m/s]: the fastest measured, and an agent's action 1. The blade may lurch faster."""
_TURN_GAIN = 8.0  # rate of turn over the sine of the angle from the blade to a place [1/s]
_NEAR = 0.001  # [m], a millimetre: less than the hand is behind what leads it, at half its speed
_SIDEWAYS = 2.0  # a place that is behind the hand, and less than this beside it, is one to draw back to
_LEVEL_GAIN = 20.0  # descent speed over the error of the level [1/s]


def speed_toward(target: float, state: Struct, hand: Hand = PLAYED_HAND) -> float:
    """Return the speed command [m/s] toward ``target`` [m] without overshoot.

    A position is followed through a speed with a lag T, for which the gain 1/(4 T) is critically damped; farther away,
    the hand's acceleration must be able to stop it: v^2 = 2 a d. The present position is that of ``state``.
    """
    return speed_over(target - float(state["hand"]), hand.motor_lag, hand.acceleration)


@njit_internal
def speed_over(left: float, lag: float, acceleration: float) -> float:
    """Return :func:`speed_toward`'s command for ``left`` [m]; compiled."""
    stoppable = math.sqrt(2.0 * acceleration * abs(left))
    return math.copysign(min(abs(left) / (4.0 * lag), stoppable, MAX_HAND_SPEED), left)


@njit_internal
def hand_over_slab(state: Struct, steering: Struct) -> tuple[float, float]:
    """Return a steered hand's place along and left across the slab [m]."""
    reach = state.hand - state.blade
    # In this order it is the hand of a straight cut, to the last bit, while the blade points along the slab.
    return state.hand + steering.east + reach * (steering.ahead - 1.0), steering.north + reach * steering.across


@njit_internal
def steered_toward(
    state: Struct, steering: Struct, place: tuple[float, float], lag: float, acceleration: float
) -> tuple[float, float]:
    """Return speed [m/s] and turn rate [rad/s] toward a slab place [m]."""
    here = hand_over_slab(state, steering)
    east, north = place[0] - here[0], place[1] - here[1]
    ahead = east * steering.ahead + north * steering.across
    return speed_over(ahead, lag, acceleration), turn_toward(ahead, north * steering.ahead - east * steering.across)


@njit_internal
def turn_toward(ahead: float, left: float) -> float:
    """Return the left turn rate [rad/s] that aims at a place.

    It is in proportion to the sine of the angle, and at most the task's.  A place that is less than :data:`_NEAR` ahead
    counts as that far, so that a hand at rest does not tremble. A blade that is drawn back does not turn.
    """
    if ahead < 0.0 and abs(left) < -_SIDEWAYS * ahead:
        return 0.0
    before = max(ahead, _NEAR)
    turn = _TURN_GAIN * left / math.sqrt(before * before + left * left)
    return min(max(turn, -TURN_SCALE), TURN_SCALE)


@njit_internal
def descent_toward(level: float, wanted: float) -> float:
    """Return the descent action from ``level`` to ``wanted`` [m]; compiled."""
    fall = min(max(_LEVEL_GAIN * (level - wanted), -DESCENT_SCALE), DESCENT_SCALE)
    return speed_action(fall * (SPEED_SCALE / DESCENT_SCALE))
