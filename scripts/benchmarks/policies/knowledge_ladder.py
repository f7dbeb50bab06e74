"""Ladder of knowledge of a task that adds to gentle cutting: what one script earns with more and more of the truth.

    python -m scripts.benchmarks.policies.knowledge_ladder depth  500 held-out specimens; writes runs/depth/ladder.csv

Every rung for DepthCut-v1 is the script "follow the depth" with other knowledge.  The steps between the rungs say what
of the gap to the planner with truth, which is in the table of ``scripts/benchmarks/policies/task_table.py depth``, is
the tip, the surface, the place of the stop, and the tissue ahead.

The first rungs for PathCut-v1 are the script "steer by force", told one thing, or several.  The last three steer by the
planner's rule at the script's speed, with the true state but for what their names say: so they say whether knowledge or
the rule of steering is worth more.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._engine.jit import njit
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import by_policy
from cutenv.agents.policy import OneReturnStroke, StopAndUnload
from cutenv.agents.policy.depth_policies import DepthByTwoForces, FollowDepth
from cutenv.agents.policy.interface import SPEED_COLUMN, ArrayPolicy
from cutenv.agents.policy.path_policies import (
    ALONG_NUMBERS,
    ENDING_NUMBERS,
    EXCISION_NUMBERS,
    HAND_NUMBERS,
    TUNED_AT,
    SeenPath,
    SteerByForce,
    course_back,
)
from cutenv.agents.policy.third_axis_planners import wanted_bend
from cutenv.envs.vector import CutBatch
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE
from scripts.benchmarks.policies.ladder import TrueTip, rows_of_rung
from scripts.tables import keep, kept_rows, mean_text

START = "as the script has it"  # name of the first rung


@dataclass(frozen=True, kw_only=True)
class KnowledgeLadder:
    """One task's ladder."""

    task: str
    rungs: Mapping[str, Callable[[], ArrayPolicy]]
    errors: tuple[tuple[str, str], ...]  # scores that the task adds [mm]: name and heading

    @property
    def file(self) -> Path:
        """File with one row for each rung and specimen."""
        return Path("runs") / self.task / "ladder.csv"

    def rows_of_rung(self, name: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
        """Return the scores of a rung, one row for each seed."""
        return rows_of_rung(self.rungs[name](), name, seeds, self.task)

    def measure(self, seeds: Sequence[int]) -> list[dict[str, Any]]:
        """Return one row for each rung and specimen."""
        return [row for name in self.rungs for row in self.rows_of_rung(name, seeds)]

    def report(self, rows: Sequence[Mapping[str, Any]]) -> str:
        """Return the ladder as a Markdown table."""
        each = {name: {int(row["seed"]): row for row in own} for name, own in by_policy(rows).items()}
        headings = " | ".join(heading for _, heading in self.errors)
        lines = [
            f"| the script | return | success | {headings} | charged for safety | tip error | minus the script |",
            f"| --- | --- | --- |{' --- |' * len(self.errors)} --- | --- | --- |",
        ]
        for name, own in each.items():
            gain = mean_text((row["return"] - each[START][seed]["return"] for seed, row in own.items()), sign="+")
            gain = "–" if name == START else gain
            errors = " | ".join(f"{np.mean([row[error] for row in own.values()]):.2f} mm" for error, _ in self.errors)
            success, safety = (np.mean([row[score] for row in own.values()]) for score in ("success", "safety"))
            tip = np.median([row["tip_error_mm"] for row in own.values()])
            lines.append(
                f"| {name} | {mean_text(row['return'] for row in own.values())} "
                f"| {100.0 * success:.1f} % | {errors} | {-safety:.3f} | {tip:.2f} mm | {gain} |"
            )
        specimens = f"{len(each[START])} held-out specimens of class mixed"
        return "\n".join([*lines, "", f"{specimens}; mean [95 % interval], median tip error."])

    def kept_report(self) -> str:
        """Return the table of the last measurement; SystemExit if there is none."""
        return self.report(kept_rows(self.file, f"scripts.benchmarks.policies.knowledge_ladder {self.task}"))


class DepthRung(FollowDepth):
    """The script with the tip of the depth, the surface, or the tip of the stop from elsewhere."""

    def __init__(self, *, careful: bool = False, tip: bool = False, surface: bool = False, stop: bool = False) -> None:
        self._told = TrueTip() if stop else None
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
        return self._batch.cuts.motions["surface"][np.arange(len(point)), point]


DEPTH_RUNGS: dict[str, Callable[[], FollowDepth]] = {
    START: DepthRung,
    "and it gives up earlier": lambda: DepthRung(careful=True),
    "tip by two forces": DepthByTwoForces,
    "true tip for the depth": lambda: DepthRung(careful=True, tip=True),
    "and the true surface": lambda: DepthRung(careful=True, tip=True, surface=True),
    "and the true tip for the stop": lambda: DepthRung(careful=True, tip=True, surface=True, stop=True),
}


LENGTHS = (0.0053, 0.0055, 0.0029, 0.0011)  # lengths [m] of wanted_bend, chosen on training specimens


class PathRung(SteerByForce):
    """The script with the tip, its distance to the line, or the direction of the crack from elsewhere.

    ``numbers`` are those of the script, see :func:`cutenv.agents.policy.path_policies.with_numbers`.
    """

    def __init__(
        self,
        numbers: Mapping[str, float] | None = None,
        *,
        tip: bool = False,
        aside: bool = False,
        crack: bool = False,
        stop: bool = False,
        rule: bool = False,
    ) -> None:
        numbers, self._told = numbers or {}, TrueTip() if stop else None
        self.environment_arguments = TUNED_AT if numbers else {}
        ending = {"margin": -0.0005, **{name: numbers[name] for name in ENDING_NUMBERS if name in numbers}}
        if stop:  # whoever knows the tip stops there, and needs no return stroke
            ending["margin"] = -0.0005
        unloading = StopAndUnload(**{"retreat_speed": 0.012, **ending}, tip_estimate=self._told)
        along = {name: numbers[name] for name in ALONG_NUMBERS if name in numbers} | ({"approach": 0.0} if stop else {})
        own = {name: value for name, value in numbers.items() if name not in (*ALONG_NUMBERS, *ENDING_NUMBERS)}
        super().__init__(OneReturnStroke(unloading=unloading, **along), **own)
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


TOLD: dict[str, dict[str, bool]] = {  # knowledge that each rung along a line is told, by name
    START: {},
    "true tip along the line": {"tip": True},
    "true distance of the tip to the line": {"aside": True},
    "true direction of the crack": {"crack": True},
    "all three": {"tip": True, "aside": True, "crack": True},
    "the true tip for the stop alone": {"stop": True},
    "all four": {"tip": True, "aside": True, "crack": True, "stop": True},
    "the planner's rule of steering, with truth": {"aside": True, "rule": True},
    "the planner's rule of steering, distance to the line estimated": {"rule": True},
    "the planner's rule, with the true tip for the stop": {"aside": True, "rule": True, "stop": True},
}


def path_rungs(numbers: Mapping[str, float]) -> dict[str, Callable[[], SteerByForce]]:
    """Return the rungs of *steer by force* with these numbers."""
    return {name: partial(PathRung, numbers, **told) for name, told in TOLD.items()}


def path_ladder(task: str, numbers: Mapping[str, float]) -> KnowledgeLadder:
    """Return the ladder of a task along a line."""
    errors = ("mean_distance_mm", "mean distance to the line"), ("largest_distance_mm", "largest")
    return KnowledgeLadder(task=task, rungs=path_rungs(numbers), errors=errors)


LADDERS = {
    ladder.task: ladder
    for ladder in (
        KnowledgeLadder(task="depth", rungs=DEPTH_RUNGS, errors=(("mean_error_mm", "mean error of the depth"),)),
        path_ladder("path", {}),
        path_ladder("excision", EXCISION_NUMBERS),
        path_ladder("hand-excision", HAND_NUMBERS),
    )
}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=list(LADDERS), help="the task of the script")
    parser.add_argument("--specimens", type=int, default=500, metavar="N", help="number of specimens; default 500")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    ladder = LADDERS[arguments.task]
    if not arguments.print:
        keep(ladder.file, ladder.measure(TEST_SEEDS[: arguments.specimens]))
    print(ladder.kept_report(), flush=True)


if __name__ == "__main__":
    main()
