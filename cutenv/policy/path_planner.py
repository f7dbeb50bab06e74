"""The planner with truth for ``cutenv/PathCut-v1``: it knows tissue and tip, and plans the whole cut."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.cutting.law import grid_index, lerp
from cutenv.cutting.steering import to_crack
from cutenv.policy.map_planner import MapPlanner, MapSearch, ThirdPlan
from cutenv.policy.plan import choose_action
from cutenv.task.declare import Cuts
from cutenv.task.observation import SPEED_SCALE, speed_action
from cutenv.task.path import PATH_CUT, TURN_SCALE

_BACK, _AHEAD, _SHIFT, _TURN = range(4)
# Places in the third part of a plan, lengths [m]: within which the tip comes back to the line; ahead of the tip, at
# which the line's direction is the wanted one; within which the blade shifts to the side, and within which it turns.
_FIRST = (0.008, 0.003, 0.006, 0.003)
_STEPS = (0.004, 0.003, 0.003, 0.0015)
_LEAST, _MOST = (0.002, 0.0, 0.001, 0.001), (0.05, 0.02, 0.05, 0.02)
_LARGEST = 0.8  # [rad], of a blade to the crack, as a sine
_SLOWEST = 0.002  # [m/s], for the rate of turn of a blade at rest


@njit
def choose_path_actions(plans: StructArray, third: Array, cuts: Cuts, waits: StructArray, actions: Array) -> None:
    """Fill the actions, shape (n, 3), of n plans at the present states of their cuts; not of those that wait.

    ``third``, shape (n, 4), are the lengths of the steering.
    """
    for n in range(len(plans)):
        if not waits[n]:
            choose_action(plans[n], cuts.states[n], actions[n])
            speed = cuts.states[n].speed
            bend = wanted_bend(cuts.states[n], cuts.motions[n], third[n])
            turn = bend * (max(speed, _SLOWEST) if speed >= 0.0 else speed)
            action = speed_action(turn * (SPEED_SCALE / TURN_SCALE))
            actions[n, 2] = np.float64(np.float32(min(max(action, -1.0), 1.0)))


@njit_internal
def wanted_bend(state: Struct, steering: Struct, lengths: Array) -> float:
    """Return the bend of the blade's way to the left [1/m], by the true direction and stiffness of the crack."""
    cosine, sine = to_crack(steering)  # of the angle from the crack to the blade
    if state.speed < 0.0 or steering.guided == 1:
        return 0.0
    i, share = grid_index(min(state.tip + lengths[_AHEAD], 0.149))
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    ahead = steering.tip_ahead * t_y - steering.tip_across * t_x  # sine of the turn from the crack to the line
    wanted = min(max(ahead - steering.tip_aside / lengths[_BACK], -0.5), 0.5)  # turn of the crack, as a sine
    pull = max(steering.pull, 0.1)
    offset = pull * (wanted - steering.coupling) / steering.side_stiffness
    shift = min(max((offset - steering.offset) / lengths[_SHIFT], -_LARGEST), _LARGEST)
    return (shift * cosine - sine) / lengths[_TURN]  # type: ignore[no-any-return]


class PathSearch(MapSearch):
    """Search over plans of cuts along a line; the third part of a plan are the lengths of the steering."""

    task = PATH_CUT
    third = ThirdPlan(_FIRST, _STEPS, _LEAST, _MOST)

    def choose(self, plans: StructArray, third: Array, cuts: Cuts, waits: StructArray, actions: Array) -> None:
        """Fill the actions of all plans."""
        choose_path_actions(plans, third, cuts, waits, actions)


class PathPlanner(MapPlanner):
    """The oracle of ``cutenv/PathCut-v1``: it knows tissue and tip, and plans the whole cut.

    Speed, angle and end come from a search; the blade is steered by the true direction and stiffness of the crack, with
    lengths that are searched for as well.

    Parameters
    ----------
    rounds : int, optional
        Number of rounds of the search.
    """

    search = PathSearch
    default_rounds = 10
