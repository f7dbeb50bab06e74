"""The planner with truth for ``cutenv/DepthCut-v1``: it knows tissue, surface and layer, and plans the whole cut."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.cutting.descent import renew
from cutenv.policy.map_planner import MapPlanner, MapSearch, ThirdPlan
from cutenv.policy.plan import choose_action
from cutenv.policy.planner import Search
from cutenv.task.declare import Cuts
from cutenv.task.depth import DEPTH_CUT, DESCENT_SCALE, DepthEpisode
from cutenv.task.observation import SPEED_SCALE, speed_action
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE

_LEAD, _GAIN = 0.004, 6.0  # at the start of the search [m], and always [1/s]
_LEAD_STEP, _PRESS_STEP = 0.003, 0.0004  # of the search [m]
_LEAST_PRESS, _MOST_PRESS, _MOST_LEAD = -0.002, 0.003, 0.02  # [m]


@njit
def cut_as_deep(profiles: StructArray, descents: StructArray, slabs: StructArray, depth: Array) -> None:
    """Fill a profile, shape (1,), with that of a tissue that is cut to ``depth`` [m], shape (301,)."""
    for i in range(N_POINTS):
        descents[0].engaged = descents[0].surface[i] - depth[i]
        descents[0].version += 1
        renew(profiles[0], descents[0], slabs[0], i)


@njit
def choose_depth_actions(
    plans: StructArray, depth_plans: Array, cuts: Cuts, waits: StructArray, actions: Array
) -> None:
    """Fill the actions, shape (n, 3), of n plans at the present states of their cuts; not of those that wait.

    ``depth_plans``, shape (n, 2), are the distance ahead of the tip at which the depth is followed, and the depth by
    which the blade is lower than wanted [m].
    """
    for n in range(len(plans)):
        if not waits[n]:
            state, descent = cuts.states[n], cuts.motions[n]
            choose_action(plans[n], state, actions[n])
            target = target_level(descent, cuts.wholes[n], min(state.tip + depth_plans[n, 0], state.blade))
            descent_speed = _GAIN * (descent.level - target + depth_plans[n, 1])
            action = speed_action(descent_speed * (SPEED_SCALE / DESCENT_SCALE))
            actions[n, 2] = np.float64(np.float32(min(max(action, -1.0), 1.0)))


@njit_internal
def target_level(descent: Struct, depth: Struct, position: float) -> float:
    """Return the level [m] of a blade that cuts as deep as wanted at ``position`` [m]."""
    i = min(max(int(position * POINTS_PER_METRE + 0.5), 0), N_POINTS - 1)
    return descent.surface[i] - depth.wanted[i]  # type: ignore[no-any-return]


class _PlainSearch(Search):
    """Search over plans of cuts that are as deep as wanted everywhere: where the search with deepening begins."""

    def __init__(self, cuttings: Sequence[DepthEpisode]) -> None:
        super().__init__(*cuttings)
        for start, cutting in zip(self._starts, cuttings, strict=True):
            slab = cutting.plant.specimen.tissue.slab()
            cut_as_deep(start.profiles, cutting.motion.copy(), slab, cutting.whole["wanted"][0])


class DepthSearch(MapSearch):
    """Search over plans of cuts along a wanted depth.

    The third part of a plan are the distance ahead of the tip at which the depth is followed, and the depth by which
    the blade is lower than wanted [m].
    """

    task = DEPTH_CUT
    third = ThirdPlan((_LEAD, 0.0), (_LEAD_STEP, _PRESS_STEP), (0.0, _LEAST_PRESS), (_MOST_LEAD, _MOST_PRESS))

    def new_plain(self, cuttings: Sequence[DepthEpisode]) -> Search:
        """Return a search over plans of cuts that are as deep as wanted everywhere."""
        return _PlainSearch(cuttings)

    def choose(self, plans: StructArray, third: Array, cuts: Cuts, waits: StructArray, actions: Array) -> None:
        """Fill the actions of all plans."""
        choose_depth_actions(plans, third, cuts, waits, actions)


class DepthPlanner(MapPlanner):
    """The oracle of ``cutenv/DepthCut-v1``: it knows the specimen and plans the whole cut.

    Its plans come from a search, so the true optimum is better.

    Parameters
    ----------
    rounds : int, optional
        Number of rounds of the search.
    """

    search = DepthSearch
