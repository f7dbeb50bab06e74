"""The force-only score beside four experts' ratings of fifteen real excisions: evidence, by which nothing is chosen.

    python -m scripts.validation.records.expert_ratings  reads ../shared/data beside the repository

A trial has some twelve cuts and one rating by each expert, 0 to 3. Its score is the mean over its cuts. Fifteen trials
are too few to choose a weight, a metric or a reference by, and none was.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import norm, spearmanr

from cutenv._base.arrays import Array
from cutenv.records.scoring import ReferenceSet, score
from cutenv.records.scoring.cut_metrics import FORCE_WEIGHTS, METRICS
from cutenv.sim.trace import Trace
from scripts.tables import markdown_table
from scripts.validation.records.real_records import CUT_SAMPLES, DATA, by_trial, read_cuts

RATINGS = DATA.with_name("scalpel_excision_ratings.csv")
DRAWS, SEED = 10_000, 0  # draws of trials for an interval, and their seed
SCALES = (1.0, 2.0, 5.0, 10.0, 20.0)
"""Newtons that the largest force of the data set may have been: it was published without a unit."""
WIDTHS = (0.2, 0.1)  # half widths of an interval that a study may want


def read_ratings(path: Path) -> dict[str, Array]:
    """Return each trial's ratings, shape (4,), in the order of the experts."""
    if not path.is_file():
        raise FileNotFoundError(f"No file {path}. Put scalpel_excision_ratings.csv there, or name its folder (--data).")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    return {trial: np.array(ratings, float) for trial, *ratings in rows[1:]}


def trial_means(trials: Mapping[str, Sequence[Trace]], reference: ReferenceSet, scale: float | None = None) -> Array:
    """Return the mean score of each trial's cuts; in newtons where the largest force of all is ``scale`` [N]."""
    means = []
    for cuts in trials.values():
        cuts = [cut.select(slice(0, CUT_SAMPLES)) for cut in cuts]
        if scale is not None:
            cuts = [dataclasses.replace(cut, force=scale * cut.force, force_unit="N") for cut in cuts]
        means.append(np.mean([score(cut, reference=reference).overall_score or np.nan for cut in cuts]))
    return np.array(means)


def own_reference(cuts: Sequence[Trace]) -> ReferenceSet:
    """Return the cuts of a data set as the set within which each of them is ranked: their unit is their own."""
    cards = [score(cut.select(slice(0, CUT_SAMPLES))) for cut in cuts]
    rows = [("cut", {name: scored.value for name, scored in card.metrics.items()}) for card in cards]
    return ReferenceSet.of(rows, name="these cuts", about="hand-held excisions", force_unit="1")


def metric_means(trials: Mapping[str, Sequence[Trace]], name: str) -> Array:
    """Return the mean of a metric of each trial's cuts, with the sign turned where less is better."""
    sign = -1.0 if METRICS[name].direction == "lower" else 1.0
    cards = {trial: [score(cut.select(slice(0, CUT_SAMPLES))) for cut in cuts] for trial, cuts in trials.items()}
    return np.array([sign * np.mean([card[name] for card in own]) for own in cards.values()])


def rank_correlation(first: Array, second: Array) -> float:
    """Return Spearman's rank correlation of two columns."""
    return float(spearmanr(first, second).statistic)


def interval(first: Array, second: Array) -> tuple[float, float]:
    """Return the 95 % interval of the rank correlation, by drawing trials with replacement."""
    rng, n = np.random.default_rng(SEED), len(first)
    drawn = rng.integers(n, size=(DRAWS, n))
    found = [rank_correlation(first[rows], second[rows]) for rows in drawn if len(set(second[rows])) > 1]
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)


def people_needed(correlation: float, half_width: float) -> int:
    """Return how many trials narrow the 95 % interval of a rank correlation so far (Bonett and Wright's formula)."""
    spread, centre = math.sqrt(1.0 + 0.5 * correlation**2), math.atanh(correlation)
    numbers = np.arange(4, 100_000)
    reach = float(norm.ppf(0.975)) * spread / np.sqrt(numbers - 3.0)
    narrow = 0.5 * (np.tanh(centre + reach) - np.tanh(centre - reach)) <= half_width
    return int(numbers[np.argmax(narrow)])


def report(folder: Path = DATA.parent) -> str:
    """Return the comparison as Markdown."""
    ratings = read_ratings(folder / RATINGS.name)
    everything = read_cuts(folder / DATA.name)
    trials = {trial: cuts for trial, cuts in by_trial(everything).items() if trial in ratings}
    experts = np.array([ratings[trial] for trial in trials])
    rated, marks = experts.mean(axis=1), trial_means(trials, own_reference(everything))
    found = rank_correlation(marks, rated)
    low, high = interval(marks, rated)
    left = [rank_correlation(np.delete(marks, i), np.delete(rated, i)) for i in range(len(marks))]
    rows = [("the force-only score", f"{found:.2f}", f"{low:.2f} to {high:.2f}")]
    rows += [("the same, one trial left out", f"{min(left):.2f} to {max(left):.2f}", "")]
    for k, name in enumerate("ABCD"):
        others = np.delete(experts, k, axis=1).mean(axis=1)
        ends = interval(experts[:, k], others)
        alone = rank_correlation(experts[:, k], others)
        rows.append((f"expert {name}, with the other three", f"{alone:.2f}", f"{ends[0]:.2f} to {ends[1]:.2f}"))
    for name in FORCE_WEIGHTS:
        values = metric_means(trials, name)
        ends = interval(values, rated)
        alone = rank_correlation(values, rated)
        rows.append((name.replace("_", " "), f"{alone:.2f}", f"{ends[0]:.2f} to {ends[1]:.2f}"))
    table = markdown_table(("with the mean rating", "rank correlation", "95 % interval"), rows)
    needed = " and ".join(f"{people_needed(found, width)} for 0.{round(10 * width)}" for width in WIDTHS)
    frozen = ReferenceSet.shipped("force-alone")
    in_newtons = [rank_correlation(trial_means(trials, frozen, scale), rated) for scale in SCALES]
    of_scales = ", ".join(f"{value:.2f} at {scale:g} N" for scale, value in zip(SCALES, in_newtons, strict=True))
    return (
        f"{len(marks)} trials, {sum(len(cuts) for cuts in trials.values())} cuts, four experts.\n\n{table}\n\n"
        f"To narrow the interval to plus or minus as much, a study needs so many trials: {needed}.\n\n"
        f"Told in newtons, the score depends on what the largest force was: {of_scales}."
    )


def main() -> int:
    """Read, compare and print; return 2 if a file is missing or another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA.parent, metavar="FOLDER", help="folder of both files")
    try:
        print(report(parser.parse_args().data))
    except (FileNotFoundError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
