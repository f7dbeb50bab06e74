"""Ladder of knowledge for PathCut-v1: what the script that steers by force earns with more and more of the truth.

    python scripts/path_ladder.py                       500 held-out specimens; writes runs/path/ladder.csv
    python scripts/path_ladder.py --validation          on validation specimens, to plan a training
    python scripts/path_ladder.py --print               the table of what is in runs/path

The first rungs are the script "steer by force", told one thing, or several.  The last three steer by the planner's
rule at the script's speed, with the true state but for what their names say: so they say whether knowledge or the rule
of steering is worth more.
"""

from __future__ import annotations

from collections.abc import Callable

import ladder
import numpy as np
from knowledge_ladder import START, KnowledgeLadder

from cutenv._base.arrays import Array, Array32
from cutenv._engine.jit import njit
from cutenv.envs.batch import CutBatch
from cutenv.policy import OneReturnStroke, StopAndUnload
from cutenv.policy.path_planner import wanted_bend
from cutenv.policy.path_scripts import SeenPath, SteerByForce, course_back
from cutenv.policy.signals import SPEED_COLUMN
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE

LENGTHS = (0.0053, 0.0055, 0.0029, 0.0011)
"""Lengths [m] of :func:`~cutenv.policy.path_planner.wanted_bend`, chosen on training specimens."""


class Rung(SteerByForce):
    """The script with the tip, its distance to the line, or the direction of the crack from elsewhere."""

    def __init__(
        self, *, tip: bool = False, aside: bool = False, crack: bool = False, stop: bool = False, rule: bool = False
    ) -> None:
        self._told = ladder.TrueTip() if stop else None
        unloading = StopAndUnload(margin=-0.0005, retreat_speed=0.012, tip_estimate=self._told)
        super().__init__(OneReturnStroke(unloading=unloading, **({"approach": 0.0} if stop else {})))
        self._tip, self._aside, self._crack, self._rule = tip, aside, crack, rule

    def watch(self, batch: CutBatch) -> None:
        """Let the script see the hidden state of a batch."""
        self._batch = batch
        if self._told is not None:
            self._told.batch = batch

    def reckon(self, seen: SeenPath) -> tuple[Array, Array]:
        """Return the distances of the tips to the left of the line [m], and the angles of the cracks to it [rad]."""
        states, steerings = self._batch.cuts.states, self._batch.cuts.motions
        if self._tip:
            seen.estimates["tip"] = states["tip"]
        aside, crack = super().reckon(seen)
        if self._crack:
            n = np.arange(len(states))
            point = np.clip(np.rint(states["tip"] * POINTS_PER_METRE).astype(int), 0, N_POINTS - 1)
            line = np.arctan2(steerings["sine"][n, point], steerings["cosine"][n, point])
            crack = np.arctan2(steerings["tip_across"], steerings["tip_ahead"]) - line
        return steerings["tip_aside"].copy() if self._aside else aside, crack

    def bends(self, seen: SeenPath, actions: Array32) -> Array:
        """Return the bends of the script, or those of the planner's rule with the same knowledge."""
        if not self._rule:
            return super().bends(seen, actions)
        steerings = self._batch.cuts.motions.copy()
        if not self._aside:
            steerings["tip_aside"] = self.reckon(seen)[0]
        bends: Array = np.zeros(len(actions))
        _fill_bends(self._batch.cuts.states, steerings, np.array(LENGTHS), bends)
        return np.where(seen.along[:, SPEED_COLUMN] <= 0.0, course_back(seen), bends)


@njit
def _fill_bends(states: Array, steerings: Array, lengths: Array, bends: Array) -> None:
    for n in range(len(bends)):
        bends[n] = wanted_bend(states[n], steerings[n], lengths)


RUNGS: dict[str, Callable[[], SteerByForce]] = {
    START: SteerByForce,
    "true tip along the line": lambda: Rung(tip=True),
    "true distance of the tip to the line": lambda: Rung(aside=True),
    "true direction of the crack": lambda: Rung(crack=True),
    "all three": lambda: Rung(tip=True, aside=True, crack=True),
    "the true tip for the stop alone": lambda: Rung(stop=True),
    "all four": lambda: Rung(tip=True, aside=True, crack=True, stop=True),
    "the planner's rule of steering, with truth": lambda: Rung(aside=True, rule=True),
    "that, but for the distance to the line": lambda: Rung(rule=True),
    "the planner's rule, with the true tip for the stop": lambda: Rung(aside=True, rule=True, stop=True),
}
LADDER = KnowledgeLadder(
    task="path",
    rungs=RUNGS,
    errors=(("mean_distance_mm", "mean distance to the line"), ("largest_distance_mm", "largest")),
)


if __name__ == "__main__":
    LADDER.run(__doc__)
