"""The planner with truth for ``cutenv/DepthCut-v1``: it knows tissue, surface and layer, and plans the whole cut."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, StructArray
from cutenv._engine.jit import njit
from cutenv.cutting.descent import renew
from cutenv.policy.depth_scripts import BLADE_DEPTH, DepthByForce
from cutenv.policy.planner import PlannerWithTruth, Search
from cutenv.policy.signals import DEPTH_COLUMN, POSITION_COLUMN
from cutenv.task.depth_cutting import DepthCutting
from cutenv.task.gentle_cutting import GentleCutting
from cutenv.task.observation import COMPONENTS, SCALES
from cutenv.tissue.grid import N_POINTS, SPACING


@njit
def cut_as_deep(profiles: StructArray, descents: StructArray, slabs: StructArray, depth: Array) -> None:
    """Fill a profile, shape (1,), with that of a tissue that is cut to ``depth`` [m], shape (301,)."""
    for i in range(N_POINTS):
        descents[0].engaged = descents[0].surface[i] - depth[i]
        descents[0].version += 1
        renew(profiles[0], descents[0], slabs[0], i)


class DepthSearch(Search):
    """Search over plans of cuts that are as deep as wanted everywhere.

    Deepening is left out, so what is found is the best plan only where the wanted depth changes slowly.
    """

    def __init__(self, *cuttings: GentleCutting) -> None:
        super().__init__(*cuttings)
        for k, cutting in enumerate(cuttings):
            if not isinstance(cutting, DepthCutting):
                raise TypeError(f"this search needs a DepthCutting, got {type(cutting).__name__}.")
            profiles = self._starts[k].profiles
            cut_as_deep(profiles, cutting.descents.copy(), cutting.slabs, cutting.depths["wanted"][0])


class PlannerAlong(PlannerWithTruth):
    """The speeds, angles and end of the best plan that is as deep as wanted."""

    search = DepthSearch


class DepthPlanner(DepthByForce):
    """The oracle of ``cutenv/DepthCut-v1``: an estimate from below of what can be achieved.

    It moves along the cut as :class:`PlannerAlong` plans, and keeps to the wanted depth below the true surface.

    Parameters
    ----------
    rounds : int
        Number of rounds of the search.
    """

    privileged = True

    def __init__(self, *, rounds: int = 20, **keywords: Any) -> None:
        self._planner = PlannerAlong(rounds=rounds)
        super().__init__(self._planner, **keywords)

    def set_states(self, cuttings: Sequence[GentleCutting]) -> None:
        """Plan the cuts that are about to begin, on all cores."""
        self._planner.set_states(cuttings)
        self._above = np.array([_surface_error(cutting) for cutting in cuttings])

    def act(self, observations: Array32) -> Array32:
        """Return the actions, shape (n, 3), for the observations of all cuts, shape (n, 22)."""
        truth = np.array(observations, np.float32)  # with the true surface in the place of the measured one
        place = truth[:, POSITION_COLUMN] * SCALES[POSITION_COLUMN] / SPACING
        point = np.clip(place.astype(int), 0, N_POINTS - 2)
        rows = np.arange(len(point))
        left, right = self._above[rows, point], self._above[rows, point + 1]
        error = left + (place - point) * (right - left)
        truth[:, DEPTH_COLUMN] += error / SCALES[DEPTH_COLUMN]
        truth[:, len(COMPONENTS) + BLADE_DEPTH] += error / SCALES[DEPTH_COLUMN]
        return super().act(truth)


def _surface_error(cutting: GentleCutting) -> Array:
    """Return by how much the surface is higher than it was measured [m], shape (301,)."""
    if not isinstance(cutting, DepthCutting):
        raise TypeError(f"this planner needs a DepthCutting, got {type(cutting).__name__}.")
    error: Array = cutting.descents["surface"][0] - cutting.nominal["depth"][0]
    return error
