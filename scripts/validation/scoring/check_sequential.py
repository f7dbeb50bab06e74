"""Check the decisions of a sequential comparison by simulated studies, whose truth is known.

    python -m scripts.validation.scoring.check_sequential                       10,000 studies a row; some minutes
    python -m scripts.validation.scoring.check_sequential --studies 500 --block twins

Differences of a pair are drawn with a known mean and bounded as returns are, by 1: normal, heavy-tailed (Student's t
with two degrees of freedom, clipped, its mean then set), drifting (the mean swings from study to study and day to day,
and its average so far is at most what it is said to be), and two-valued (a success more, a success less, or none).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv.scoring.study.sequential import (
    DECISIONS,
    SequentialQuestion,
    corrected,
    fixed_design,
    log_wealth,
    sequential_decisions,
    stops,
)
from scripts.tables import markdown_table

SPREAD = 0.2
"""Standard deviation of a difference on the same specimen, of returns clipped at 0, as of two scripts in simulation."""
SPREAD_APART, TOLD, TOLD_WRONGLY = 0.28, 0.18, 0.09
"""Standard deviation of the difference of two places, and the share of its variance that twins of an opening of 40 mm
explain, as they are, and 30 % too stiff with twice the friction."""
STUDIES = 10_000
"""Number of simulated studies of each row."""
_DAY = 20  # pairs between changes of a drifting mean
_TOGETHER = 1000  # studies drawn at a time, to limit memory
Draw = Callable[[np.random.Generator, tuple[int, int], float], Any]
"""Function that draws differences, shape (studies, pairs), or a tuple of such and their room."""


def normal(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return normal differences, shape (studies, pairs)."""
    return np.clip(rng.normal(mean, SPREAD, shape), -1.0, 1.0)


def heavy(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return differences most of which are small and some as large as can be: half of the variance is in the tail."""
    found = np.clip(0.1 * rng.standard_t(2, shape), mean - 1.0, 1.0 - mean)
    tail = max(abs(mean - 1.0), 1.0 - mean)
    return np.clip(found, -tail, tail) + mean


def drifting(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return differences whose mean is lower on one day and higher on the next: on average at most ``mean``."""
    day = np.arange(shape[1]) // _DAY
    swing = np.where(day % 2 == 0, -0.15, 0.15) * rng.uniform(0.2, 1.0, (shape[0], 1))
    return np.clip(rng.normal(mean, SPREAD, shape) + swing, -1.0, 1.0)


def two_valued(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return differences of success: three in ten pairs differ."""
    u = rng.random(shape)
    return (u < 0.5 * (0.3 + mean)).astype(float) - (u > 1.0 - 0.5 * (0.3 - mean))


KINDS: dict[str, Draw] = {"normal": normal, "heavy-tailed": heavy, "drifting": drifting, "two-valued": two_valued}


def studied(draw: Draw, mean: float, question: SequentialQuestion, studies: int, seed: int) -> dict[str, Any]:
    """Return what many studies decide, whether their intervals held the mean at every time, and the t tests."""
    rng = np.random.default_rng(seed)
    at, said, left, spread, peeked, fixed_said = [], [], [], [], [], []
    for first in range(0, studies, _TOGETHER):
        drawn = draw(rng, (min(_TOGETHER, studies - first), question.most), mean)
        found, room = drawn if isinstance(drawn, tuple) else (drawn, 0.0)
        stop, decision = stops(sequential_decisions(found, question, room))
        at.append(stop)
        said.append(decision)
        sides = [log_wealth(side * found, side * mean, question.reach + room) >= question.bar for side in (1.0, -1.0)]
        left.append((sides[0] | sides[1]).any(axis=1))
        spread.append(found.std(axis=1, ddof=1))
        t = _t(found)
        critical = student.isf(0.5 * question.error, np.arange(1, found.shape[1] + 1) - 1.0)
        peeked.append((np.abs(t[:, 9:]) > critical[9:]).any(axis=1))
        n = min(fixed_design(float(found.std()), question), question.most)
        fixed_said.append(np.abs(t[:, n - 1]) > critical[n - 1])
    decided = np.concatenate(said)
    return {
        "shares": {name: float(np.mean(decided == k)) for k, name in enumerate(DECISIONS)},
        "median": float(np.median(np.concatenate(at))),
        "left": float(np.mean(np.concatenate(left))),
        "spread": float(np.mean(np.concatenate(spread))),
        "peeked": float(np.mean(np.concatenate(peeked))),
        "fixed": float(np.mean(np.concatenate(fixed_said))),
    }


def _t(found: Array) -> Array:
    """Return Student's t after every pair, shape (studies, pairs)."""
    n = np.arange(1, found.shape[1] + 1)
    mean = np.cumsum(found, axis=1) / n
    variance = np.maximum(np.cumsum(found**2, axis=1) / n - mean**2, 1e-12) * n / np.maximum(n - 1, 1)
    t: Array = mean / np.sqrt(variance / n)
    return t


def decision_rows(studies: int) -> list[list[str]]:
    """Return the rows of the table of decisions."""
    rows = []
    for kind, draw in KINDS.items():
        for mean in (0.0, 0.05, 0.1):
            question = SequentialQuestion(most=800 if kind == "two-valued" else 500)
            found = studied(draw, mean, question, studies, seed=len(rows))
            shares, fixed = found["shares"], fixed_design(found["spread"], question)
            wrong = shares["worse"] + (shares["better"] if mean == 0.0 else 0.0)
            wrong += shares["equivalent"] if mean >= question.smallest else 0.0
            saved = f"{100.0 * (1.0 - found['median'] / fixed):.0f} %" if mean == 0.1 else ""
            rows.append(
                [
                    kind, f"{mean:g}", _percent(wrong), _percent(found["left"]), _percent(shares["better"]),
                    _percent(shares["equivalent"]), f"{found['median']:.0f}", f"{fixed}", saved,
                    _percent(found["fixed"]), _percent(found["peeked"]),
                ]
            )  # fmt: skip
    return rows


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def apart(told: float, bias: float = 0.0) -> Draw:
    """Return what draws differences of two places, corrected by forecasts that explain a share of their variance."""

    def draw(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> tuple[Array, Array]:
        covariates = np.clip(np.sqrt(told) * SPREAD_APART * rng.standard_normal(shape), -1.0, 1.0)
        rest = np.sqrt(1.0 - told) * SPREAD_APART * rng.standard_normal(shape)
        coin = rng.choice((-1.0, 1.0), shape)
        found = np.clip(mean + coin * (covariates + rest), -1.0, 1.0)
        return corrected(found, coin * np.clip(covariates + bias, -1.0, 1.0))

    return draw


def twin_rows(studies: int) -> list[list[str]]:
    """Return the rows of the table of twins: none, a right one, wrong ones."""
    cases: list[tuple[str, Draw]] = [
        ("none", apart(0.0)),
        ("fitted to the opening", apart(TOLD)),
        ("30 % too stiff, twice the friction", apart(TOLD_WRONGLY)),
        ("tells nothing", apart(0.0, bias=0.2)),
        ("explains half", apart(0.5)),
    ]
    rows = []
    for name, draw in cases:
        cells = []
        for mean in (0.0, 0.05, 0.1):
            question = SequentialQuestion(most=800)
            found = studied(draw, mean, question, studies, seed=17)
            shares = found["shares"]
            if mean == 0.0:
                cells += [_percent(shares["better"] + shares["worse"]), f"{found['spread']:.3f}"]
            else:
                cells += [_percent(shares["better"]), f"{found['median']:.0f}"]
        rows.append([name, *cells])
    return rows


def decision_table(studies: int = STUDIES) -> str:
    """Return the table of decisions as Markdown."""
    header = [
        "differences", "mean", "wrong decision", "interval ever wrong", "better", "equivalent", "median pairs",
        "fixed design", "saved", "fixed t test: differ", "t test after every pair: differ",
    ]  # fmt: skip
    return markdown_table(header, decision_rows(studies))


def twin_table(studies: int = STUDIES) -> str:
    """Return the table of twins as Markdown."""
    header = [
        "twin", "wrong at 0", "SD of a difference", "better at 0.05", "median pairs", "better at 0.1", "median pairs ",
    ]  # fmt: skip
    return markdown_table(header, twin_rows(studies))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES, metavar="N", help=f"default {STUDIES}")
    parser.add_argument("--block", choices=("decisions", "twins"), help="print one table alone")
    arguments = parser.parse_args()
    tables = {"decisions": decision_table, "twins": twin_table}
    print("\n\n".join(tables[name](arguments.studies) for name in tables if arguments.block in (None, name)))


if __name__ == "__main__":
    main()
