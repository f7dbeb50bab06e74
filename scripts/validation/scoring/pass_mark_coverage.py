"""Print pass marks beside published ones, and how often their intervals hold the truth, as two Markdown tables.

    python -m scripts.validation.scoring.pass_mark_coverage [--trials 400]    a few minutes

The truth of a trial is known because the people are drawn from normal distributions: those of the passing group two or
three standard deviations above the others.
"""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np
from scipy.stats import norm
from tqdm import tqdm

from cutenv.records.scoring.study import Estimate, pass_mark, rater_correlation
from cutenv.records.scoring.study.pass_mark import METHODS, NormalCurve, crossing
from scripts.tables import markdown_table

PEOPLE = (5, 6, 8, 10, 15, 20, 30, 60)
DESIGNS = ((2.0, 1.0), (3.0, 0.5))  # mean and standard deviation of the passing group; the others have 0 and 1
CORRELATION = 0.6  # of a metric with a rater's marks, in truth
CUTS = 4  # of a person, in the trials with raters


def curve(mean: float, sd: float) -> NormalCurve:
    """Return one normal curve."""
    return NormalCurve(np.asarray(mean, np.float64), np.asarray(sd, np.float64))


def published() -> str:
    """Return published marks and rates beside ours."""
    z1, z2 = float(norm.isf(0.027)), float(norm.isf(0.064))
    sd = math.exp(0.5 * (z1**2 - z2**2))  # equal densities at the mark
    cases = (
        (
            "Jorgensen, Konge & Subhi 2018, figure 3: curves of 2.7 % and 6.4 %",
            (0.0, 1.0),
            (z1 + sd * z2, sd),
            "false passes 2.7 %, false fails 6.4 %",
        ),
        (
            "Hertz et al. 2018, abstract: 50.7 (SD 13.2) and 74.7 (SD 4.8) points",
            (50.7, 13.2),
            (74.7, 4.8),
            "mark 62; 3 of 23 false passes, 0 of 11 false fails",
        ),
        (
            "Equal spreads, help of Stata's `cgssm`: 40 (SD 5) and 50 (SD 5)",
            (40.0, 5.0),
            (50.0, 5.0),
            "by symmetry: mark 45, both rates 15.9 %",
        ),
    )
    rows = []
    for source, failing, passing, said in cases:
        mark = float(crossing(curve(*failing), curve(*passing)))
        rates = (
            f"false passes {100 * norm.sf(mark, *failing):.1f} %, false fails {100 * norm.cdf(mark, *passing):.1f} %"
        )
        rows.append((source, said, f"mark {mark:.1f}; {rates}"))
    return markdown_table(("source and curves", "published", "ours"), rows)


def coverage(trials: int) -> str:
    """Return the share of trials in which the 95 % interval of a mark, or of a correlation, holds the truth."""
    rng = np.random.default_rng(26)
    rows = []
    for people in tqdm(PEOPLE, desc="people", file=sys.stderr, leave=False):
        rows.append((str(people), *(f"{100 * share:.0f} %" for share in _shares(people, trials, rng))))
    heads = ("people in each group", "contrasting groups", "expert mean", "mean less 1 SD", "correlation with a rater")
    return markdown_table(heads, rows)


def _shares(people: int, trials: int, rng: np.random.Generator) -> list[float]:
    methods = METHODS[:3]
    held: dict[str, list[bool]] = {name: [] for name in (*methods, "rater")}
    for trial in range(trials):
        mean, sd = DESIGNS[trial % len(DESIGNS)]
        failing, passing = rng.normal(0.0, 1.0, people), rng.normal(mean, sd, people)
        truths = (float(crossing(curve(0.0, 1.0), curve(mean, sd))), mean, mean - sd)
        for method, truth in zip(methods, truths, strict=True):
            try:
                held[method].append(_holds(pass_mark(failing, passing, method=method, rng=rng).mark, truth))
            except ValueError:  # these people give no mark, and so no interval
                continue
        held["rater"].append(_holds(_rated(people, rng), CORRELATION))
    return [float(np.mean(each)) for each in held.values()]


def _rated(people: int, rng: np.random.Generator) -> Estimate:
    """Return the correlation in one trial: half of the variance, of metric and of marks, is between people."""
    pair = [[1.0, CORRELATION], [CORRELATION, 1.0]]
    between = np.repeat(rng.multivariate_normal((0.0, 0.0), pair, people), CUTS, axis=0)
    values, marks = (between + rng.multivariate_normal((0.0, 0.0), pair, CUTS * people)).T
    made_by = [str(i // CUTS) for i in range(CUTS * people)]
    return rater_correlation(values, marks, made_by, better="higher", rng=rng).linear


def _holds(each: Estimate, truth: float) -> bool:
    return each.low is not None and each.high is not None and each.low <= truth <= each.high


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=400, help="number of trials of each row")
    print(f"{published()}\n\n{coverage(parser.parse_args().trials)}")
