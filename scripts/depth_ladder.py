"""Ladder of knowledge for DepthCut-v1: what the script that follows the depth earns with more and more of the truth.

    python scripts/depth_ladder.py                      500 held-out specimens; writes runs/depth/ladder.csv
    python scripts/depth_ladder.py --validation         on validation specimens, to plan a training
    python scripts/depth_ladder.py --print              the table of what is in runs/depth

Every rung is the script "follow the depth" with other knowledge.  The steps between the rungs say what of the gap to
the planner with truth, which is in the table of ``scripts/depth_table.py``, is the tip, the surface, the place of the
stop, and the tissue ahead.
"""

from __future__ import annotations

from collections.abc import Callable

import ladder
import numpy as np
from knowledge_ladder import START, KnowledgeLadder

from cutenv._base.arrays import Array, Indices
from cutenv.envs.batch import CutBatch
from cutenv.policy import OneReturnStroke, StopAndUnload
from cutenv.policy.depth_scripts import DepthByTwoForces, FollowDepth


class Rung(FollowDepth):
    """The script with the tip of the depth, the surface, or the tip of the stop from elsewhere."""

    def __init__(self, *, careful: bool = False, tip: bool = False, surface: bool = False, stop: bool = False) -> None:
        self._told = ladder.TrueTip() if stop else None
        along = {"run_share": 1.0, "beyond": 0.002} if careful else {}
        if self._told is not None:
            unloading = StopAndUnload(margin=-0.0005, retreat_speed=0.012, tip_estimate=self._told)
            super().__init__(OneReturnStroke(approach=0.0, unloading=unloading, **along))
        else:
            super().__init__(OneReturnStroke(**along))
        self._true_tip, self._true_surface = tip, surface

    def watch(self, batch: CutBatch) -> None:
        """Let the script see the hidden state of a batch."""
        self._batch = batch
        if self._told is not None:
            self._told.batch = batch

    def tips(self, along: Array, seen: Array) -> Array:
        """Return the tips [m] by which the depth is set."""
        tips = super().tips(along, seen)
        return self._batch.cuts.states["tip"].copy() if self._true_tip else tips

    def surfaces(self, point: Indices) -> Array:
        """Return the levels of the surface [m] at these points."""
        if not self._true_surface:
            return super().surfaces(point)
        levels: Array = self._batch.cuts.motions["surface"][np.arange(len(point)), point]
        return levels


RUNGS: dict[str, Callable[[], FollowDepth]] = {
    START: Rung,
    "and it gives up earlier": lambda: Rung(careful=True),
    "tip by two forces": DepthByTwoForces,
    "true tip for the depth": lambda: Rung(careful=True, tip=True),
    "and the true surface": lambda: Rung(careful=True, tip=True, surface=True),
    "and the true tip for the stop": lambda: Rung(careful=True, tip=True, surface=True, stop=True),
}


LADDER = KnowledgeLadder(task="depth", rungs=RUNGS, errors=(("mean_error_mm", "mean error of the depth"),))


if __name__ == "__main__":
    LADDER.run(__doc__)
