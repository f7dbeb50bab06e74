"""``cutenv/FreeCut-v1``: cut along a line, with finite elements re-solved."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32
from cutenv.envs.gymnasium_facts import described
from cutenv.envs.path_cut import PathCutEnv
from cutenv.sim.plant.freehand_plant import GrowingModel
from cutenv.sim.tissue.grid import SPACING
from cutenv.task.episode import Goal
from cutenv.task.path import PathEpisode, PathOptions


class FreeEpisode(PathEpisode):
    """An episode along a drawn line in a growing finite-element model of stiffness."""

    growing: GrowingModel  # model of the slab, cut as far as it has followed
    lost: str | None = None  # reason why the crack could not be followed further; the stiffness is then held

    def _begin(self) -> None:
        super()._begin()
        if self.goal.key is None:  # a cut that is not begun has no line
            return
        self.growing = GrowingModel(self.plant.specimen, self.line)
        self.growing.begin(self._cuts.profiles[0], self.motion[0], self.goal.start)
        self._noted = self.tip_place

    def step(self, action: Array) -> tuple[Array32, float]:
        """Command 3 numbers in [-1, 1] for one decision; the model follows the crack."""
        stepped = super().step(action)
        place, steering = self.tip_place, self.motion[0]
        if self.lost is None and math.dist(place, self._noted) > 0.5 * SPACING:
            self._noted = place
            grown = self.growing.lead([(*place, math.atan2(steering["tip_across"], steering["tip_ahead"]))])
            self.lost = grown.end
            if len(grown.ways):
                self.growing.tell(steering, grown, self.tip)
        return stepped

    def displaced(self, opening: float = 0.0) -> list[Array]:
        """Return element outlines, (3 or 4, 2) [m], with faces ``opening`` [m] apart."""
        return self.growing.displaced(np.subtract(self.blade_place, self.tip_place), opening)


class FreeOptions(PathOptions):
    """Options of cutting along a line in a newly solved slab."""

    def episode(self, plant: Any, goal: Goal, *, from_truth: bool | None = None) -> FreeEpisode:
        """Return a new episode along a line."""
        return FreeEpisode(plant, goal, self, from_truth=from_truth)


@described
class FreeCutEnv(PathCutEnv):
    """Cut along a drawn line, re-solving finite elements as it opens.

    Action, observation, reward, ends and info are those of :class:`~cutenv.envs.path_cut.PathCutEnv`, and so are the
    lines.  The stiffness is not: ``cutenv/PathCut-v1`` looks it up in a table of the line, changed by where
    the tip stands, while here a plane model of the slab, of 480 elements of 5 mm, follows the crack wherever it goes.
    After each decision in which the crack has passed a node the model is solved for the cut as it is, and for three
    nodes straight on; the crack's next turn takes what they tell.  So the blade may go where it will, but for the sides
    of the slab; an end for safety is still 8 mm from the line.

    It is one cut, at some hundred decisions a second on one core; ``gymnasium.make_vec`` makes several one after the
    other.  The page "Cuts along a curve" has its rate, and how it agrees with ``cutenv/PathCut-v1``.

    The elements, moved by the blade, are ``env.unwrapped.cutting.displaced()``.

    Arguments
    ---------
    Those of ``cutenv/PathCut-v1``, among them {keywords}.

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = FreeOptions
