"""Standing of a policy on the benchmark: its scores on the headline's specimens with intervals, and what it cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv.learning.benchmark_protocol import Protocol
from cutenv.learning.intervals import Interval, interquartile_mean, mean, stratified

RunRows = Sequence[Mapping[str, Any]]
"""Rows of one run, a cut each: ``seed``, ``specimen_class`` and scores, as numbers or as text."""

IQM, MEAN = "interquartile mean", "mean"
STATISTICS: dict[str, Callable[[np.ndarray], np.ndarray]] = {IQM: interquartile_mean, MEAN: mean}
"""Statistics by name."""


@dataclass(frozen=True)
class TableColumn:
    """One column of the table: score, heading, factor and digits, statistic, and whether it is a paired difference."""

    score: str
    heading: str
    factor: float = 1.0
    digits: int = 2
    statistic: str = IQM
    paired: bool = False


TABLE_COLUMNS = (
    TableColumn("return", "return (IQM)", digits=3),
    TableColumn("return", "return (mean)", digits=3, statistic=MEAN),
    TableColumn("return", "minus best script", digits=3, statistic=MEAN, paired=True),
    TableColumn("success", "success [%]", 100.0, 1, MEAN),
    TableColumn("tip_error_mm", "tip error [mm]"),
    TableColumn("peak_force_N", "peak force [N]"),
    TableColumn("largest_jump_mm", "largest run [mm]"),
    TableColumn("cost_mm", "cost [mm]", statistic=MEAN),
    TableColumn("overshoot_mm", "overshoot [mm]", statistic=MEAN),
    TableColumn("time_s", "time [s]", digits=1),
)
"""Columns of the table; one that the cuts lack is left out."""

CUT_MARKS = {100: "100", 1000: "1,000", 10_000: "10,000", math.inf: "all"}
"""Numbers of cuts consumed after which the return in training is told."""


def strata(runs: Sequence[RunRows], score: str) -> list[np.ndarray]:
    """Return an array of shape (runs, specimens) for each tissue, without the specimens that lack the score."""
    cells = [[row.get(score, "") for row in rows] for rows in runs]
    values = np.array([[math.nan if cell == "" else float(cell) for cell in own] for own in cells])
    tissue = np.array([row["specimen_class"] for row in runs[0]])
    known = np.isfinite(values).all(axis=0)
    parts = [values[:, known & (tissue == name)] for name in sorted(set(tissue))]
    return [part for part in parts if part.size]


def paired_difference(runs: Sequence[RunRows], others: Sequence[RunRows], score: str, protocol: Protocol) -> Interval:
    """Return the mean difference on the same specimens, by training run where both have as many; outliers count."""
    pairs = zip(strata(runs, score), strata(others, score), strict=True)
    return stratified([own - theirs for own, theirs in pairs], mean, resamples=protocol.resamples)


def standing(runs: Sequence[RunRows], script: RunRows, protocol: Protocol) -> dict[TableColumn, Interval]:
    """Return the numbers of a policy's row.

    Parameters
    ----------
    runs : sequence of RunRows
        Cuts of the headline's specimens, by training run; a script has one.
    script : RunRows
        Those of the protocol's script.
    protocol : Protocol
        Number of resamples.
    """
    found = {}
    for column in TABLE_COLUMNS:
        if column.paired:
            found[column] = paired_difference(runs, [script], column.score, protocol)
        elif own := strata(runs, column.score):
            found[column] = stratified(own, STATISTICS[column.statistic], resamples=protocol.resamples)
    return found


def shown(interval: Interval | None, factor: float = 1.0, digits: int = 2, sign: str = "") -> str:
    """Format a number with its interval; a dash if there is none."""
    if interval is None:
        return "–"
    value, low, high = (factor * number for number in (interval.value, interval.low, interval.high))
    return f"{value:{sign}.{digits}f} [{low:{sign}.{digits}f}, {high:{sign}.{digits}f}]"


def returns_after(curve: Sequence[Mapping[str, float]]) -> dict[str, float | None]:
    """Return the best return on validation specimens within each number of :data:`CUT_MARKS`, from a learning curve.

    It is None where nothing had been validated by then, and for a curve that does not count cuts.
    """
    points = [(row["cuts"], row["validation_return"]) for row in curve if {"cuts", "validation_return"} <= row.keys()]
    return {
        name: max((value for cuts, value in points if cuts <= mark), default=None) for mark, name in CUT_MARKS.items()
    }
