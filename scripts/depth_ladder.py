"""Ladder of knowledge for DepthCut-v1: what the script that follows the depth earns with more and more of the truth.

    python scripts/depth_ladder.py                      500 held-out specimens; writes runs/depth/ladder.csv
    python scripts/depth_ladder.py --validation         on validation specimens, to plan a training
    python scripts/depth_ladder.py --print              the table of what is in runs/depth

Every rung is the script "follow the depth" with other knowledge.  The steps between the rungs say what of the gap to
the planner with truth, which is in the table of ``scripts/depth_table.py``, is the tip, the surface, the place of the
stop, and the tissue ahead.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import ladder
import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv.envs.depth_cut import DepthBatch, DepthCutEnv
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS, VALIDATION_SEEDS
from cutenv.learning.statistics import by_policy, mean_with_interval
from cutenv.policy import OneReturnStroke, StopAndUnload
from cutenv.policy.depth_scripts import DepthByTwoForces, FollowDepth
from cutenv.task.info import GROUPS, INFO, column

TABLE = Path("runs") / "depth" / "ladder.csv"
START = "as the script has it"
_TERMS = [column(field) for field in GROUPS["reward_terms"]]
SCORES = ("return", "success", "mean_error_mm", "layer_mm", "safety", "tip_error_mm")


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

    def watch(self, batch: DepthBatch) -> None:
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
        levels: Array = self._batch.descents["surface"][np.arange(len(point)), point]
        return levels


RUNGS: dict[str, Callable[[], FollowDepth]] = {
    START: Rung,
    "and it gives up earlier": lambda: Rung(careful=True),
    "tip by two forces": DepthByTwoForces,
    "true tip for the depth": lambda: Rung(careful=True, tip=True),
    "and the true surface": lambda: Rung(careful=True, tip=True, surface=True),
    "and the true tip for the stop": lambda: Rung(careful=True, tip=True, surface=True, stop=True),
}


def rows_of_rung(policy: FollowDepth, name: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Return the scores of a rung, one row for each seed."""
    count = len(seeds)
    batch = DepthBatch(count, DepthCutEnv(specimen_class="mixed"))
    batch.give_seeds(seeds, np.arange(count), np.random.default_rng())
    batch.begin(np.arange(count))
    policy.begin([np.random.default_rng(seed) for seed in seeds])
    if isinstance(policy, Rung):
        policy.watch(batch)
    infos, returns, safety, ends = np.zeros(count, INFO), np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
    lost = _TERMS[[field.name for field in GROUPS["reward_terms"]].index("safety")]
    while not ends.all():
        going = ends == 0
        rewards, ended = batch.decide(policy.act(batch.observations), ~going, infos)
        returns[going] += rewards[going]
        safety[going] += infos[lost][going]
        ends += ended
    scores = batch.further_scores()
    found = {
        "return": returns, "success": batch.succeeded().astype(float), "mean_error_mm": scores["mean_error_mm"],
        "layer_mm": scores["layer_mm"], "safety": safety,
        "tip_error_mm": 1e3 * np.abs(batch.cuts.states["tip"] - batch.cuts.tasks["target"]),
    }  # fmt: skip
    columns = [values.tolist() for values in found.values()]
    return [
        {"policy": name, "seed": seed, **dict(zip(found, values, strict=True))}
        for seed, *values in zip(seeds, *columns, strict=True)
    ]


def measure(seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Return one row for each rung and specimen."""
    return [row for name, make in RUNGS.items() for row in rows_of_rung(make(), name, seeds)]


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the ladder as a Markdown table."""
    each = {name: {int(row["seed"]): row for row in own} for name, own in by_policy(rows).items()}
    lines = [
        "| the script | return | success | mean error of the depth | charged for safety | tip error "
        "| minus the script |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, own in each.items():
        value = mean_with_interval(row["return"] for row in own.values())
        gain = mean_with_interval(row["return"] - each[START][seed]["return"] for seed, row in own.items())
        difference = "–" if name == START else f"{gain['mean']:+.3f} [{gain['low_95']:+.3f}, {gain['high_95']:+.3f}]"
        means = {score: np.mean([row[score] for row in own.values()]) for score in SCORES}
        tip = np.median([row["tip_error_mm"] for row in own.values()])
        lines.append(
            f"| {name} | {value['mean']:.3f} [{value['low_95']:.3f}, {value['high_95']:.3f}] "
            f"| {100.0 * means['success']:.1f} % | {means['mean_error_mm']:.2f} mm | {-means['safety']:.3f} "
            f"| {tip:.2f} mm | {difference} |"
        )
    where = "validation" if min(each[START]) in VALIDATION_SEEDS else "held-out"
    return "\n".join(
        [*lines, "", f"{len(each[START])} {where} specimens of class mixed; mean [95 % interval], median tip error."]
    )


def kept() -> list[dict[str, Any]]:
    """Return the rows of the last measurement; SystemExit if there is none."""
    if not TABLE.is_file():
        raise SystemExit(f"{TABLE} is missing; run 'python scripts/depth_ladder.py' first.")
    return [{name: v if name == "policy" else float(v) for name, v in row.items()} for row in rows_of(TABLE)]


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=500, metavar="N", help="number of specimens; default 500")
    parser.add_argument("--validation", action="store_true", help="cut validation specimens, print, and keep nothing")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if arguments.validation:
        print(report(measure(VALIDATION_SEEDS[: arguments.specimens])), flush=True)
        return
    if not arguments.print:
        rows = measure(TEST_SEEDS[: arguments.specimens])
        TABLE.parent.mkdir(parents=True, exist_ok=True)
        write_csv(TABLE, rows)
    print(report(kept()), flush=True)


if __name__ == "__main__":
    main()
