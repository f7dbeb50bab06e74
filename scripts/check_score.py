"""Check that the overall score agrees with the task: same specimens, cut by scripts, agents, planner and nobody.

    python scripts/check_score.py                   500 specimens of each class, some fifteen minutes
    python scripts/check_score.py --specimens 50    a quick look
    python scripts/check_score.py --print           prints what is in runs/check-score/

A success must have more than any failure on the same specimen; where two returns differ by more than 0.1, the score
must agree in 95 % of the pairs.  The records are those of a simulator: where the tip ended is noted in them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmark.table import markdown_table
from scipy.stats import spearmanr

from cutenv.learning.batched_rollout import batched_rollout
from cutenv.learning.evaluation import contestant
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.plant.protocol import recorded_trace
from cutenv.policy import NULL_POLICIES, ORACLE, SCRIPTS
from cutenv.scoring import score
from cutenv.scoring.scored_cut import TIP_AT_END

FOLDER, FILE = Path("runs") / "check-score", "rows.csv"
CLASSES = ("mixed", "vascular", "liver", "uniform")
FEED, GIVES_UP = "constant 1.27 cm/s 90 deg", "gives up at two thirds"
PLAYERS = (ORACLE, *SCRIPTS, "ppo-free", "ppo-fixed", FEED, "constant 0.38 cm/s 45 deg", *NULL_POLICIES)
"""Names of all who cut; beside them one who gives up: the constant feed, up to two thirds of its target."""
ORDER = (ORACLE, "return stroke", FEED, GIVES_UP)
"""Those whose mean scores must stand in this order."""
DIFFERENT = 0.1  # in return


class Agreement(NamedTuple):
    """Agreement of the score with the task, over pairs of cuts of the same specimen."""

    success_pairs: int
    success_wrong: int
    pairs: int
    agreeing: float
    rank_correlation: float


def measure(names: Iterable[str], specimens: int, kind: str) -> list[dict[str, Any]]:
    """Let everybody cut the first held-out specimens of a class, and score the records."""
    rows = []
    for name in names:
        one = contestant(name)
        rate = {"control_hz": 10} if name in NULL_POLICIES else {}
        seeds = TEST_SEEDS[:specimens]
        cuts = batched_rollout(one.policy, seeds, {**one.arguments, **rate, "specimen_class": kind}, readings=True)
        for seed, cut in zip(seeds, cuts, strict=True):
            told, tip = cut.scores(), cut.readings["tip"]
            target, end = float(told["target_length_mm"]) / 1e3, len(tip)
            row = {"class": kind, "seed": seed, "policy": name, "return": told["return"], "success": told["success"]}
            rows.append(row | {"score": scored(cut, target, end, cut.end)})
            if name == FEED:
                end = int(np.argmax(tip >= 2.0 / 3.0 * target)) or len(tip)
                given_up = {"return": np.nan, "success": 0.0, "score": scored(cut, target, end, "given up")}
                rows.append(row | {"policy": GIVES_UP} | given_up)
    return rows


def scored(cut: Any, target: float, count: int, end: str) -> float:
    """Return the overall score of the first ``count`` readings of a cut that ended in that way."""
    noted = {TIP_AT_END: float(cut.readings["tip"][count - 1]), "end": end}
    trace = recorded_trace(cut.readings[:count], cut.measured_depth, **noted)
    return float(score(trace, target_length=target).overall_score or 0.0)


def agreement(rows: Sequence[Mapping[str, Any]]) -> Agreement:
    """Compare score and task over all pairs of cuts of the same specimen."""
    by_specimen: dict[Any, list[tuple[float, float, float]]] = {}
    for row in rows:
        numbers = float(row["return"]), float(row["success"]), float(row["score"])
        by_specimen.setdefault((row["class"], row["seed"]), []).append(numbers)
    success_pairs = success_wrong = pairs = agreeing = 0
    for cuts in by_specimen.values():
        for (return_1, success_1, score_1), (return_2, success_2, score_2) in combinations(cuts, 2):
            if success_1 != success_2:
                success_pairs += 1
                success_wrong += (score_1 - score_2) * (success_1 - success_2) <= 0.0
            if abs(return_1 - return_2) > DIFFERENT:
                pairs += 1
                agreeing += (return_1 - return_2) * (score_1 - score_2) > 0.0
    whole = np.array([numbers for cuts in by_specimen.values() for numbers in cuts])
    whole = whole[np.isfinite(whole[:, 0])]
    correlation = float(spearmanr(whole[:, 0], whole[:, 2]).statistic)
    return Agreement(success_pairs, success_wrong, pairs, agreeing / max(pairs, 1), correlation)


def mean_scores(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the mean score of everybody."""
    scores: dict[str, list[float]] = {}
    for row in rows:
        scores.setdefault(str(row["policy"]), []).append(float(row["score"]))
    return {name: float(np.mean(own)) for name, own in scores.items()}


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return two Markdown tables: agreement by class, and the mean score of everybody by class."""
    kinds = list(dict.fromkeys(row["class"] for row in rows))
    by_kind = {kind: [row for row in rows if row["class"] == kind] for kind in kinds}
    specimens = len({row["seed"] for row in rows})
    found = {kind: agreement(own) for kind, own in by_kind.items()}
    table = [
        (
            kind, f"{a.success_wrong} of {a.success_pairs}", f"{100 * a.agreeing:.1f} % of {a.pairs}",
            f"{a.rank_correlation:.2f}",
        )
        for kind, a in found.items()
    ]  # fmt: skip
    means = {kind: mean_scores(own) for kind, own in by_kind.items()}
    names = sorted(means[kinds[0]], key=lambda name: -means[kinds[0]][name])
    scores = [(name, *(f"{means[kind][name]:.0f}" for kind in kinds)) for name in names]
    head = ("class", "success not above failure", "score agrees with the return", "rank correlation")
    return (
        f"{specimens} held-out specimens of each class.\n\n{markdown_table(head, table)}\n\n"
        f"Mean overall score:\n\n{markdown_table(('who cut', *kinds), scores)}"
    )


def kept(folder: Path) -> list[dict[str, str]]:
    """Return the rows of an earlier measurement; SystemExit if there is none."""
    path = folder / FILE
    if not path.is_file():
        raise SystemExit(f"{path} is missing; run 'python scripts/check_score.py' first.")
    return list(rows_of(path))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=500, metavar="N", help="of each class; default 500")
    parser.add_argument("--classes", nargs="+", default=CLASSES, choices=CLASSES, help="default all")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if arguments.specimens < 1:
        parser.error(f"--specimens {arguments.specimens} is less than 1")
    if not arguments.print:
        rows = [row for kind in arguments.classes for row in measure(PLAYERS, arguments.specimens, kind)]
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_csv(arguments.out / FILE, rows)
    print(report(kept(arguments.out)), flush=True)


if __name__ == "__main__":
    main()
