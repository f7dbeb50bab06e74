"""Statistics of a benchmark from its kept cuts: interquartile means with intervals, differences, verdicts."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.learning.benchmark import CUT_MARKS, IQM, MEAN, Protocol, paired_difference, standing, strata
from cutenv.agents.learning.statistics import Interval, rows_of, stratified
from scripts.benchmarks.leaderboard.kept_cuts import KeptRun, Row, read_runs
from scripts.benchmarks.leaderboard.protocol import ENTRIES, REFERENCE

ALL = "all"  # all pure classes together: one stratum each, in which a seed gives one specimen of each
MIXTURE = "mixed"
"""Class whose specimens are drawn from the other classes with the same seeds, so no independent evidence."""
UNCHANGED = "none"  # value of the constant's name in the rows of sweeps.csv with all constants as in training
VERDICTS = {1: "beats it", 0: "does not beat it: level", -1: "does not beat it: worse"}
AFTER = "return after {} cuts"  # score of the return in training


@dataclass(frozen=True)
class Line:
    """One number of the summary, with its interval."""

    contestant: str
    specimen_class: str
    score: str
    statistic: str
    interval: Interval
    cuts: int

    def as_row(self) -> dict[str, Any]:
        """Return the number as a row of summary.csv."""
        own = dataclasses.asdict(self)
        found = own.pop("interval")
        return {**own, "value": found["value"], "low_95": found["low"], "high_95": found["high"]}


def read_summary(path: Path) -> list[Line]:
    """Read the result of :func:`summary` from its file."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; run scripts/benchmarks/leaderboard/benchmark_agents.py first.")
    return [
        Line(
            row["contestant"], row["specimen_class"], row["score"], row["statistic"],
            Interval(float(row["value"]), float(row["low_95"]), float(row["high_95"])), int(row["cuts"]),
        )
        for row in rows_of(path)
    ]  # fmt: skip


def summary(every: Mapping[str, Sequence[KeptRun]], protocol: Protocol) -> list[Line]:
    """Compute every number of the table, of whatever runs there are."""
    if protocol.script not in every:
        raise SystemExit(f"there are no cuts of {protocol.script!r}; cut them: --only {protocol.script!r}")
    headline = protocol.training_class
    of_all = every[protocol.script][0].by_class[headline]
    lines: list[Line] = []
    for name, runs in every.items():
        cuts = [run.by_class[headline] for run in runs]
        script = runs[0].by_class.get(protocol.script, of_all)  # an entry has specimens of its own
        for column, interval in standing(cuts, script, protocol).items():
            score = f"{column.score} minus {protocol.script}" if column.paired else column.score
            if name != protocol.script or not column.paired:
                lines.append(Line(name, headline, score, column.statistic, interval, len(cuts) * len(script)))
        lines += _by_class(name, runs, protocol)
        lines += _of_training(name, runs)
        if name in ENTRIES and ENTRIES[name].change:
            lines += _ablation(name, runs, every.get(REFERENCE, ()), protocol)
    return lines


def _by_class(name: str, runs: Sequence[KeptRun], protocol: Protocol) -> list[Line]:
    """Return the return on the other classes, and on all pure ones together."""
    own = {
        kind: [run.by_class[kind] for run in runs]
        for kind in protocol.classes
        if all(kind in run.by_class for run in runs)
    }
    lines = []
    for kind, cuts in own.items():
        if kind != protocol.training_class:
            found = stratified(strata(cuts, "return"), resamples=protocol.resamples)
            lines.append(Line(name, kind, "return", IQM, found, sum(map(len, cuts))))
    pure = [part for kind, cuts in own.items() if kind != MIXTURE for part in strata(cuts, "return")]
    if len(own) == len(protocol.classes) and len(pure) > 1:
        found = stratified(pure, same_specimens=True, resamples=protocol.resamples)
        lines.append(Line(name, ALL, "return", IQM, found, sum(part.size for part in pure)))
    return lines


def _ablation(name: str, runs: Sequence[KeptRun], others: Sequence[KeptRun], protocol: Protocol) -> list[Line]:
    """Return differences from the reference, paired by specimen and by the training seeds that both have."""
    both = {run.facts["training_seed"] for run in runs} & {run.facts["training_seed"] for run in others}
    if not both:
        return []
    own, theirs = (
        [run.by_class[protocol.training_class] for run in several if run.facts["training_seed"] in both]
        for several in (runs, others)
    )
    return [
        Line(
            name, protocol.training_class, f"{score} minus {REFERENCE}", MEAN,
            paired_difference(own, theirs, score, protocol), len(both) * protocol.specimens,
        )
        for score in ("return", "success")
    ]  # fmt: skip


def _of_training(name: str, runs: Sequence[KeptRun]) -> list[Line]:
    """Return decisions and minutes of training, and the return on the way: mean, minimum and maximum over the runs."""
    values: dict[str, list[Any]] = {
        key: [run.facts.get(key) for run in runs] for key in ("training_decisions", "training_minutes")
    }
    for mark in CUT_MARKS.values():
        values[AFTER.format(mark)] = [run.facts.get("returns_after_cuts", {}).get(mark) for run in runs]
    return [
        Line(name, "", score, MEAN, Interval(float(np.mean(own)), float(min(own)), float(max(own))), len(own))
        for score, own in values.items()
        if None not in own
    ]


def sweep_lines(folder: Path, protocol: Protocol) -> list[dict[str, Any]]:
    """Return interquartile means of the return with other constants, one row per contestant and setting.

    The first rows have all constants as in training, on the same specimens, the first of ``cuts/``: a loss is the
    difference from these.
    """
    from scripts.benchmarks.leaderboard.robustness import settings

    every, swept = read_runs(folder, protocol), []
    for setting in settings():
        by_name: dict[str, dict[str, list[Row]]] = {}
        for row in rows_of(folder / "sweeps" / f"{setting.name}.csv"):
            by_name.setdefault(row["policy"].rpartition(", seed ")[0] or row["policy"], {}).setdefault(
                row["policy"], []
            ).append(row)
        about = {"constant": setting.constant, "unit": setting.unit}
        about |= {"default": setting.default, "set_to": setting.value}
        swept += [_sweep_line(name, list(runs.values()), about, protocol) for name, runs in by_name.items()]
    about = {"constant": UNCHANGED, "unit": "", "default": "", "set_to": ""}
    unchanged = [
        _sweep_line(
            name, [run.by_class[protocol.training_class][: protocol.sweep_specimens] for run in every[name]], about,
            protocol,
        )
        for name in dict.fromkeys(line["contestant"] for line in swept)
        if name in every
    ]  # fmt: skip
    return unchanged + swept


def _sweep_line(
    name: str, runs: Sequence[Sequence[Row]], about: Mapping[str, Any], protocol: Protocol
) -> dict[str, Any]:
    values = np.array([[float(row["return"]) for row in rows] for rows in runs])
    found = stratified([values], resamples=min(protocol.resamples, 500))
    numbers = {"return": found.value, "low_95": found.low, "high_95": found.high, "cuts": values.size}
    return {"contestant": name, **about, **numbers}


def verdict(difference: Interval) -> str:
    """Return the verdict on an agent against the best script, from the interval of the paired difference."""
    return VERDICTS[1 if difference.low > 0.0 else -1 if difference.high < 0.0 else 0]


def disagreements(one: Iterable[Line], other: Iterable[Line]) -> tuple[list[str], int]:
    """Return the numbers in which two summaries of one protocol differ beyond their intervals, and the number compared.

    Only numbers that both have are compared.  The cost of training is not: it depends on the machine.
    """

    def keyed(lines: Iterable[Line]) -> Mapping[tuple[str, ...], Interval]:
        kept = (line for line in lines if line.specimen_class)
        return {(line.contestant, line.specimen_class, line.score, line.statistic): line.interval for line in kept}

    first, second = keyed(one), keyed(other)
    both = sorted(first.keys() & second.keys())
    apart = [
        f"{', '.join(key)}: [{first[key].low:.4g}, {first[key].high:.4g}] "
        f"and [{second[key].low:.4g}, {second[key].high:.4g}]"
        for key in both
        if not first[key].meets(second[key])
    ]
    return apart, len(both)
