"""Summary of a benchmark as rows and columns of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cutenv.agents.learning.benchmark import (
    CUT_MARKS,
    ENTRY_KINDS,
    IQM,
    MEAN,
    OF_SCRIPT,
    TABLE_COLUMNS,
    Protocol,
    TableColumn,
    shown,
)
from cutenv.agents.policy import NULL_POLICIES, ORACLE
from scripts.benchmarks.leaderboard.aggregate import AFTER, ALL, UNCHANGED, Line, verdict
from scripts.benchmarks.leaderboard.protocol import ENTRIES, FEWEST_SEEDS, REFERENCE, SCRIPTED

Heading, Rows = list[str], list[list[str]]
BOUND, IDLE = "upper bound: sees hidden state", "idle"
_ORDER = (*ENTRY_KINDS, BOUND, IDLE)
_OUT_OF_COMPETITION = (BOUND, IDLE)
AS_BEGUN = "no better than its start"
_NOTHING = "–"


class Table:
    """The summary, indexed by contestant, class, score and statistic.

    ``contestants`` are all of them, the best return first; ``rows`` those who have a row, by kind and then by return:
    of several whose cuts are equal, the first.
    """

    def __init__(
        self,
        lines: Sequence[Line],
        protocol: Protocol,
        sweeps: Sequence[dict[str, str]],
        facts: Mapping[str, Sequence[Mapping[str, Any]]],
    ) -> None:
        self.lines, self.protocol, self.sweeps, self.facts = lines, protocol, sweeps, facts
        self._by_key = {(line.contestant, line.specimen_class, line.score, line.statistic): line for line in lines}
        self.headline = protocol.training_class
        self.contestants = sorted(
            {line.contestant for line in lines},
            key=lambda name: (-self._by_key[name, self.headline, "return", IQM].interval.value, name),
        )
        self._equals: dict[Any, list[str]] = {}
        for name in self.contestants:
            cuts = sorted((str(own["training_seed"]), own["cuts"]) for own in facts.get(name, ()))
            self._equals.setdefault(tuple(cuts) or name, []).append(name)
        self._equal_to = {name: names for names in self._equals.values() for name in names}
        self.rows = [name for name in self.contestants if self._equal_to[name][0] == name]
        self.rows.sort(key=lambda name: _ORDER.index(self.kind(name)))
        self.columns = [column for column in TABLE_COLUMNS if any(self._of(name, column) for name in self.contestants)]

    def line(self, name: str, kind: str, score: str, statistic: str = IQM) -> Line | None:
        """Return one number of the summary, or None."""
        return self._by_key.get((name, kind, score, statistic))

    def _of(self, name: str, column: TableColumn) -> Line | None:
        score = f"{column.score} minus {self.protocol.script}" if column.paired else column.score
        return self.line(name, self.headline, score, column.statistic)

    @staticmethod
    def shown(line: Line | None, factor: float = 1.0, digits: int = 2, sign: str = "") -> str:
        """Format a number with its interval; a dash if there is none."""
        return shown(None if line is None else line.interval, factor, digits, sign)

    def kind(self, name: str) -> str:
        """Return the kind of a contestant."""
        if name in ENTRIES:
            return ENTRIES[name].kind
        if name not in SCRIPTED:
            return str(self.facts[name][0]["kind"])
        return BOUND if name == ORACLE else IDLE if name in NULL_POLICIES else OF_SCRIPT

    def named(self, name: str) -> str:
        """Return the names of all whose cuts are this contestant's."""
        return ", ".join(self._equal_to[name])

    def as_begun(self, name: str) -> bool:
        """Return True if validation threw all training away.

        It is recorded of newer runs.  Else it shows where two learners cut equally to the last digit: they have nothing
        in common but the clone of the demonstrations from which both begin.
        """
        trained = [other for other in self._equal_to[name] if other in ENTRIES]
        recorded = [own.get("kept_its_start", False) for own in self.facts.get(name, ())]
        return len(trained) > 1 or (name in ENTRIES and bool(recorded) and all(recorded))

    def difference(self, name: str, other: str, score: str = "return") -> Line | None:
        """Return a paired difference on the headline's specimens."""
        return self.line(name, self.headline, f"{score} minus {other}", MEAN)

    def competitors(self) -> list[str]:
        """Return those who have a rank, by kind, the best of each first."""
        return [name for name in self.rows if self.kind(name) not in _OUT_OF_COMPETITION and not self.as_begun(name)]

    def not_yet_run(self) -> list[str]:
        """Return the agents that take part, but of which no seed is done."""
        return [name for name in ENTRIES if name not in self.contestants]

    def seeds(self, name: str) -> str:
        """Return how many training runs there are, of how many; a star marks too few."""
        if name in SCRIPTED:
            return _NOTHING
        done = len(self.facts.get(name, ()))
        wanted = len(ENTRIES[name].training_seeds(self.protocol)) if name in ENTRIES else max(done, FEWEST_SEEDS)
        return f"{done}" if done >= wanted else f"{done} of {wanted}{' *' if done else ''}"

    def main(self) -> tuple[Heading, Rows]:
        """Return heading and rows of the main table, by kind, the best return first; each kind has its ranks."""
        each = [[name for name in self.competitors() if self.kind(name) == kind] for kind in ENTRY_KINDS]
        ranks = {name: f"{rank}" for own in each for rank, name in enumerate(own, 1)}
        heading = ["rank", "policy", "kind", "seeds", *(self._heading(column) for column in self.columns)]
        rows = [
            [ranks.get(name, _NOTHING), self.named(name), self._shown_kind(name), self.seeds(name)]
            + [self._cell(name, column) for column in self.columns]
            for name in self.rows
        ]
        empty = [_NOTHING] * len(self.columns)
        for name in self.not_yet_run():
            rows.append([_NOTHING, name, f"{self.kind(name)}, not yet run", self.seeds(name), *empty])
        return heading, rows

    def _shown_kind(self, name: str) -> str:
        return f"{self.kind(name)}; {AS_BEGUN}" if self.as_begun(name) else self.kind(name)

    def _heading(self, column: TableColumn) -> str:
        return f"{column.score} minus {self.protocol.script}" if column.paired else column.heading

    def _cell(self, name: str, column: TableColumn) -> str:
        return self.shown(self._of(name, column), column.factor, column.digits, "+" if column.paired else "")

    def origins(self) -> tuple[Heading, Rows]:
        """Return a table of authors, dates and code, and of the return after numbers of cuts consumed."""
        marks = [f"after {mark} cuts" for mark in CUT_MARKS.values()]
        heading = ["policy", "author", "date", "code", "training decisions", "training [min]", *marks]
        rows = []
        for name in self.contestants:
            told = self.facts.get(name, ())
            cells = [", ".join(sorted({str(own[key]) for own in told})) for key in ("author", "date", "code")]
            decisions, minutes = (self.line(name, "", f"training_{what}", MEAN) for what in ("decisions", "minutes"))
            cells.append(_NOTHING if decisions is None else f"{decisions.interval.value / 1e6:.2f} million")
            cells.append(_NOTHING if minutes is None else f"{minutes.interval.value:.1f}")
            after = [self.line(name, "", AFTER.format(mark), MEAN) for mark in CUT_MARKS.values()]
            rows.append([name, *(cell or _NOTHING for cell in cells), *(self.shown(own, digits=3) for own in after)])
        return heading, rows

    def verdicts(self) -> list[str]:
        """Return one sentence about every agent, learned here or submitted."""
        sentences = []
        for name in self.rows:
            found = self.difference(name, self.protocol.script)
            if name not in SCRIPTED and found is not None:
                by = self.shown(found, digits=3, sign="+")
                as_begun = f"{AS_BEGUN}, which " if self.as_begun(name) else ""
                sentences.append(
                    f"{self.named(name)} against {self.protocol.script}: {as_begun}{verdict(found.interval)} ({by})."
                )
        return sentences

    def classes(self) -> tuple[Heading, Rows]:
        """Return a table of the return on every class of specimens."""
        kinds = [*self.protocol.classes, ALL]
        rows = [
            [self.named(name), *(self.shown(self.line(name, kind, "return"), digits=3) for kind in kinds)]
            for name in self.rows
        ]
        return ["policy", *kinds], rows

    def ablations(self) -> tuple[Heading, Rows]:
        """Return a table of the cost of each ablation, paired by specimen and training seed."""
        rows = []
        for name, entry in ENTRIES.items():
            found = [self.difference(name, REFERENCE, score) for score in ("return", "success")]
            if entry.change and found[0] is not None:
                cells = [self.shown(found[0], digits=3, sign="+"), self.shown(found[1], 100.0, 1, "+")]
                rows.append([entry.change, name, *cells])
        return ["ablation", "agent", f"return minus {REFERENCE}", "success, percentage points"], rows

    def robustness(self) -> tuple[Heading, Rows]:
        """Return a table of the return with other constants; the first row has those of training."""
        names = [name for name in self.contestants if any(row["contestant"] == name for row in self.sweeps)]
        settings: dict[tuple[str, ...], dict[str, str]] = {}
        for row in self.sweeps:
            number = f"{float(row['return']):.3f} [{float(row['low_95']):.3f}, {float(row['high_95']):.3f}]"
            about = tuple(row[key] for key in ("constant", "unit", "default", "set_to"))
            settings.setdefault(about, {})[row["contestant"]] = number
        rows = []
        for (constant, unit, default, value), own in settings.items():
            told = ["as in training", _NOTHING, _NOTHING]
            if constant != UNCHANGED:
                told = [f"{constant} [{unit}]", f"{float(default):.4g}", f"{float(value):.4g}"]
            rows.append([*told, *(own.get(name, _NOTHING) for name in names)])
        return ["constant", "in training", "set to", *names], rows
