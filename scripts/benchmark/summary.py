"""Summary of a benchmark as rows and columns of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.aggregate import ALL, UNCHANGED, Line, metric_scores, verdict
from benchmark.protocol import ENTRIES, REFERENCE, Protocol
from cutenv.policy import NULL_POLICIES, ORACLE


@dataclass(frozen=True)
class Column:
    """One column of the table: score in the summary, heading, factor and digits."""

    score: str
    heading: str
    factor: float = 1.0
    digits: int = 2
    statistic: str = "interquartile mean"


COLUMNS = (
    Column("return", "return (IQM)", digits=3),
    Column("success", "success [%]", 100.0, 0, "mean"),
    Column("tip_error_mm", "tip error [mm]"),
    Column("peak_force_N", "peak force [N]"),
    Column("largest_jump_mm", "largest jump [mm]"),
    Column("cost_mm", "cost [mm]"),
    Column("time_s", "time [s]", digits=1),
)


class Table:
    """The summary, indexed by contestant, class, score and statistic."""

    def __init__(self, lines: Sequence[Line], protocol: Protocol, sweeps: Sequence[dict[str, str]]) -> None:
        self.lines, self.protocol, self.sweeps = lines, protocol, sweeps
        self._by_key = {(line.contestant, line.specimen_class, line.score, line.statistic): line for line in lines}
        self.headline = protocol.training_class
        self.contestants = sorted(
            {line.contestant for line in lines},
            key=lambda name: -self._by_key[name, self.headline, "return", "interquartile mean"].interval.value,
        )

    def line(self, name: str, kind: str, score: str, statistic: str = "interquartile mean") -> Line | None:
        """Return one number of the summary, or None."""
        return self._by_key.get((name, kind, score, statistic))

    def shown(self, line: Line | None, factor: float = 1.0, digits: int = 2, sign: str = "") -> str:
        """Format a number with its interval; a dash if there is none."""
        if line is None:
            return "–"
        value, low, high = (factor * number for number in (line.interval.value, line.interval.low, line.interval.high))
        return f"{value:{sign}.{digits}f} [{low:{sign}.{digits}f}, {high:{sign}.{digits}f}]"

    @property
    def script(self) -> str | None:
        """Best script, from which all differences are taken except those of ablations."""
        scores = [line.score for line in self.lines if line.score.startswith("return minus ")]
        names = {score.removeprefix("return minus ") for score in scores} - {REFERENCE}
        return next(iter(names), None)

    def kind(self, name: str) -> str:
        """Return the kind of a contestant."""
        if name in ENTRIES:
            return "ablation" if ENTRIES[name].change else "learned"
        if name == self.script:
            return "best script"
        return "upper bound: sees hidden state" if name == ORACLE else "idle" if name in NULL_POLICIES else "script"

    def difference(self, name: str, other: str, score: str = "return") -> Line | None:
        """Return a paired difference on the headline's specimens."""
        return self.line(name, self.headline, f"{score} minus {other}", "mean")

    def main(self) -> tuple[list[str], list[list[str]]]:
        """Return heading and rows of the main table, the best return first."""
        difference = f"return minus {self.script or 'best script'}"
        columns = [column.heading for column in COLUMNS]
        heading = ["policy", "kind", columns[0], difference, *columns[1:], "training decisions", "training [min]"]
        rows = []
        for name in self.contestants:
            cells = [
                self.shown(self.line(name, self.headline, c.score, c.statistic), c.factor, c.digits) for c in COLUMNS
            ]
            cells.insert(1, self.shown(self.difference(name, self.script or ""), digits=3, sign="+"))
            decisions, minutes = (self.line(name, "", f"training_{what}", "mean") for what in ("decisions", "minutes"))
            cells.append("–" if decisions is None else f"{decisions.interval.value / 1e6:.2f} million")
            cells.append("–" if minutes is None else f"{minutes.interval.value:.1f}")
            rows.append([name, self.kind(name), *cells])
        return heading, rows

    def verdicts(self) -> list[str]:
        """Return one sentence about every learned agent."""
        sentences = []
        for name in self.contestants:
            found = self.difference(name, self.script or "")
            if name in ENTRIES and found is not None:
                by = self.shown(found, digits=3, sign="+")
                sentences.append(f"{name} against {self.script}: {verdict(found.interval)} ({by}).")
        return sentences

    def classes(self) -> tuple[list[str], list[list[str]]]:
        """Return a table of the return on every class of specimens."""
        kinds = [*self.protocol.classes, ALL]
        rows = [
            [name, *(self.shown(self.line(name, kind, "return"), digits=3) for kind in kinds)]
            for name in self.contestants
        ]
        return ["policy", *kinds], rows

    def ablations(self) -> tuple[list[str], list[list[str]]]:
        """Return a table of the cost of each ablation, paired by specimen and training seed."""
        rows = []
        for name, entry in ENTRIES.items():
            found = [self.difference(name, REFERENCE, score) for score in ("return", "success")]
            if entry.change and found[0] is not None:
                cells = [self.shown(found[0], digits=3, sign="+"), self.shown(found[1], 100.0, 1, "+")]
                rows.append([entry.change, name, *cells])
        return ["ablation", "agent", f"return minus {REFERENCE}", "success, percentage points"], rows

    def metrics(self) -> tuple[list[str], list[list[str]]]:
        """Return a table of every metric of the score card."""
        names = metric_scores(self.lines)
        rows = []
        for score in names:
            found = [self.line(name, self.headline, score) for name in self.contestants]
            rows.append(
                [score.removeprefix("metric_"), *("–" if f is None else f"{f.interval.value:.4g}" for f in found)]
            )
        return ["metric", *self.contestants], rows

    def robustness(self) -> tuple[list[str], list[list[str]]]:
        """Return a table of the return with other constants; the first row has those of training."""
        names = [name for name in self.contestants if any(row["contestant"] == name for row in self.sweeps)]
        settings: dict[tuple[str, ...], dict[str, str]] = {}
        for row in self.sweeps:
            number = f"{float(row['return']):.3f} [{float(row['low_95']):.3f}, {float(row['high_95']):.3f}]"
            about = tuple(row[key] for key in ("constant", "unit", "default", "set_to"))
            settings.setdefault(about, {})[row["contestant"]] = number
        rows = []
        for (constant, unit, default, value), own in settings.items():
            about = ["as in training", "–", "–"]
            if constant != UNCHANGED:
                about = [f"{constant} [{unit}]", f"{float(default):.4g}", f"{float(value):.4g}"]
            rows.append([*about, *(own.get(name, "–") for name in names)])
        return ["constant", "in training", "set to", *names], rows
