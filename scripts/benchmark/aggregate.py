"""Statistics of a benchmark from its CSV files: interquartile means with intervals, differences, verdicts."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.intervals import Interval, interquartile_mean, mean, stratified
from benchmark.protocol import BEST_FEED, ENTRIES, REFERENCE, SCRIPTED, Protocol, slug
from cutenv.learning.finished_cut import METRIC_PREFIX
from cutenv.learning.result_tables import rows_of
from cutenv.policy import SCRIPTS

HEADLINE = ("return", "success", "tip_error_mm", "cost_mm", "peak_force_N", "largest_jump_mm", "time_s")
"""Scores with an interval for every class; the others have one for the class of the headline."""
ALL = "all"
"""All pure classes together: one stratum each, in which a seed gives one specimen of each."""
MIXTURE = "mixed"
"""Class whose specimens are drawn from the other classes with the same seeds, so no independent evidence."""
UNCHANGED = "none"
"""Value of the constant's name in the rows of sweeps.csv with all constants as in training."""
VERDICTS = {1: "beats it", 0: "does not beat it: level", -1: "does not beat it: worse"}
_SHARES = ("success",)
_NOT_SCORES = ("policy", "seed", "specimen_class", "end", "target_length_mm")

Row = dict[str, str]


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
        raise SystemExit(f"{path} is missing; run scripts/benchmark_agents.py first.")
    return [
        Line(
            row["contestant"], row["specimen_class"], row["score"], row["statistic"],
            Interval(float(row["value"]), float(row["low_95"]), float(row["high_95"])), int(row["cuts"]),
        )
        for row in rows_of(path)
    ]  # fmt: skip


class Cuts:
    """Cuts of one contestant: rows by specimen for every class and training run."""

    def __init__(self, folder: Path, name: str, protocol: Protocol) -> None:
        seeds = [f"-seed{seed}" for seed in protocol.training_seeds] if name in ENTRIES else [""]
        files = {
            kind: [folder / "cuts" / f"{slug(name)}{seed}--{kind}.csv" for seed in seeds] for kind in protocol.classes
        }
        self.by_class = {
            kind: [sorted(rows_of(path), key=lambda row: int(row["seed"])) for path in paths]
            for kind, paths in files.items()
            if all(path.is_file() for path in paths)
        }
        for kind, runs in self.by_class.items():
            for rows in runs:
                if [int(row["seed"]) for row in rows] != list(protocol.test_seeds):
                    raise SystemExit(f"{name!r} cut other specimens of class {kind} than the protocol; cut them again.")

    def scores(self, kind: str) -> list[str]:
        """Return the names of the numbers that are known for a class."""
        return [name for name in self.by_class[kind][0][0] if name not in _NOT_SCORES]

    def strata(self, kind: str, score: str) -> list[np.ndarray]:
        """Return an array of shape (runs, specimens) for each tissue of a class, without those that lack the score."""
        runs = self.by_class[kind]
        values = np.array([[float(row[score] or "nan") for row in rows] for rows in runs])
        tissue = np.array([row["specimen_class"] for row in runs[0]])
        known = np.isfinite(values).all(axis=0)
        parts = [values[:, known & (tissue == name)] for name in sorted(set(tissue))]
        return [part for part in parts if part.size]


def summary(folder: Path, protocol: Protocol) -> list[Line]:
    """Compute every number of the table."""
    every = {name: Cuts(folder, name, protocol) for name in (*ENTRIES, *SCRIPTED)}
    headline = protocol.training_class
    known = {name: cuts for name, cuts in every.items() if headline in cuts.by_class}
    if not known:
        raise SystemExit(f"{folder} contains no cuts of class {headline}; run scripts/benchmark_agents.py first.")
    lines = [line for name, cuts in known.items() for line in _own(name, cuts, protocol)]
    returns = {line.contestant: line.interval.value for line in lines if _is(line, headline, "return", "mean")}
    scripts = [name for name in (BEST_FEED, *SCRIPTS) if name in known]
    if scripts:
        script = max(scripts, key=returns.__getitem__)
        for name in known:
            if name != script:
                lines += _differences(name, known[name], script, known[script], protocol)
    if REFERENCE in known:
        for name, entry in ENTRIES.items():
            if name in known and entry.change:
                lines += _differences(name, known[name], REFERENCE, known[REFERENCE], protocol)
    for name in known:
        if name in ENTRIES:
            lines += _costs(folder, name, protocol)
    return lines


def _is(line: Line, kind: str, score: str, statistic: str) -> bool:
    return (line.specimen_class, line.score, line.statistic) == (kind, score, statistic)


def _own(name: str, cuts: Cuts, protocol: Protocol) -> list[Line]:
    """Return a contestant's own scores."""
    lines = []

    def add(kind: str, score: str, strata: Sequence[np.ndarray], *, same_specimens: bool = False) -> None:
        if not strata:
            return
        count = sum(part.size for part in strata)
        for statistic in _statistics(score):
            found = stratified(strata, statistic, same_specimens=same_specimens, resamples=protocol.resamples)
            lines.append(Line(name, kind, score, _NAMES[statistic], found, count))

    for kind in cuts.by_class:
        for score in cuts.scores(kind) if kind == protocol.training_class else HEADLINE:
            add(kind, score, cuts.strata(kind, score))
    pure = [kind for kind in cuts.by_class if kind != MIXTURE]
    if len(cuts.by_class) == len(protocol.classes) and len(pure) > 1:
        for score in ("return", "success"):
            add(ALL, score, [part for kind in pure for part in cuts.strata(kind, score)], same_specimens=True)
    return lines


def _statistics(score: str) -> list[Any]:
    if score in _SHARES:
        return [mean]
    return [interquartile_mean, mean] if score == "return" else [interquartile_mean]


_NAMES = {interquartile_mean: "interquartile mean", mean: "mean"}


def _differences(name: str, cuts: Cuts, other_name: str, other: Cuts, protocol: Protocol) -> list[Line]:
    """Return means of differences paired by specimen, and by training seed where both learn; outliers count."""
    lines = []
    for score in ("return", "success"):
        pairs = zip(
            cuts.strata(protocol.training_class, score), other.strata(protocol.training_class, score), strict=True
        )
        strata = [own - theirs for own, theirs in pairs]
        found = stratified(strata, mean, resamples=protocol.resamples)
        count = sum(part.size for part in strata)
        label = f"{score} minus {other_name}"
        lines.append(Line(name, protocol.training_class, label, "mean", found, count))
    return lines


def _costs(folder: Path, name: str, protocol: Protocol) -> list[Line]:
    """Return decisions and minutes of training, discarded ones included: mean, minimum and maximum over the runs."""
    runs = [folder / "runs" / f"{slug(name)}-seed{seed}" for seed in protocol.training_seeds]
    facts = [json.loads((run / "run.json").read_text()) for run in runs if (run / "run.json").is_file()]
    if len(facts) < len(runs):
        return []  # the cuts were kept, but not the runs
    shown = [float(own["arguments"]["demonstrations"]) for own in facts]
    tried = [0.0 if own["agent"] == "behaviour cloning" else _tried(run) for own, run in zip(facts, runs, strict=True)]
    found = {
        "training_decisions": [a + b for a, b in zip(shown, tried, strict=True)],
        "training_minutes": [own["training_minutes"] for own in facts],
    }
    return [
        Line(name, "", score, "mean", Interval(float(np.mean(own)), float(min(own)), float(max(own))), len(own))
        for score, own in found.items()
    ]


def _tried(run: Path) -> float:
    """Return the number of decisions of the whole training, not only up to the kept checkpoint."""
    curve = rows_of(run / "learning_curve.csv")
    return float(curve[-1]["decisions"]) if curve else 0.0


def sweep_lines(folder: Path, protocol: Protocol) -> list[dict[str, Any]]:
    """Return interquartile means of the return with other constants, one row per contestant and setting.

    The first rows have all constants as in training, on the same specimens, the first of ``cuts/``: a loss is the
    difference from these.
    """
    from benchmark.robustness import settings

    swept: list[dict[str, Any]] = []
    for setting in settings():
        by_name: dict[str, dict[str, list[Row]]] = {}
        for row in rows_of(folder / "sweeps" / f"{setting.name}.csv"):
            by_name.setdefault(row["policy"].rpartition(", seed ")[0] or row["policy"], {}).setdefault(
                row["policy"], []
            ).append(row)
        about = {"constant": setting.constant, "unit": setting.unit}
        about |= {"default": setting.default, "set_to": setting.value}
        swept += [_sweep_line(name, list(runs.values()), about, protocol) for name, runs in by_name.items()]
    unchanged = []
    for name in dict.fromkeys(line["contestant"] for line in swept):
        runs = Cuts(folder, name, protocol).by_class.get(protocol.training_class)
        if runs is not None:  # otherwise only the sweeps were kept
            first = [rows[: protocol.sweep_specimens] for rows in runs]
            about = {"constant": UNCHANGED, "unit": "", "default": "", "set_to": ""}
            unchanged.append(_sweep_line(name, first, about, protocol))
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


def disagreements(one: Sequence[Line], other: Sequence[Line]) -> tuple[list[str], int]:
    """Return the numbers in which two summaries of one protocol differ beyond their intervals, and the number compared.

    Only numbers that both have are compared: the headline's scores, the differences, and the return of every class.
    The cost of training is not: it depends on the machine.
    """

    def keyed(lines: Sequence[Line]) -> Mapping[tuple[str, ...], Interval]:
        kept = (line for line in lines if line.score in HEADLINE or " minus " in line.score)
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


def metric_scores(lines: Sequence[Line]) -> list[str]:
    """Return the score card's columns that are in the summary, in order."""
    return list(dict.fromkeys(line.score for line in lines if line.score.startswith(METRIC_PREFIX)))
