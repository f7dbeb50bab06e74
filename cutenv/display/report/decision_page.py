"""Report of a sequential comparison: decision, intervals, what it saved, pairs."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.imports import optional_import
from cutenv._base.output import atomic_write
from cutenv.display.report.page import (
    PHONE_WIDTH,
    estimate_text,
    label,
    new_figure,
    plain_axes,
    write_page,
    write_table,
)
from cutenv.records.scoring.study.sequential import (
    DECISIONS,
    SequentialDecision,
    SequentialQuestion,
    confidence_sequence,
    fixed_design,
    sequential_decisions,
    stops,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE, TABLE, PARQUET = "decision.html", "pairs.csv", "pairs.parquet"
"""Files that :func:`write_decision` makes."""
_COLOURS = {"better": "#0072b2", "worse": "#d55e00", "equivalent": "#009e73", "undecided": "#6b6b6b"}
_KINDS: dict[SequentialDecision, str] = {"better": "good", "worse": "bad", "equivalent": "good", "undecided": "open"}


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedOutcome:
    """One outcome of all pairs."""

    name: str
    differences: Array  # first minus second, pair by pair, shape (n,)
    question: SequentialQuestion
    room: Array | float = 0.0  # how much farther each can reach, by a correction

    @functools.cached_property
    def decision(self) -> tuple[int, SequentialDecision]:
        """Pairs up to the first decision, or all, and the decision."""
        if not len(self.differences):
            return 0, "undecided"
        at, said = stops(sequential_decisions(self.differences, self.question, self.room))
        return int(at), DECISIONS[int(said)]

    @functools.cached_property
    def sequence(self) -> tuple[Array, Array]:
        """Ends of the interval after every pair, shape (n,) each."""
        return confidence_sequence(self.differences, self.question, self.room)

    @property
    def estimate(self) -> str:
        """Mean difference after all pairs, with its interval."""
        if not len(self.differences):
            return "not known"
        low, high = (float(ends[-1]) for ends in self.sequence)
        return estimate_text(float(self.differences.mean()), low, high, 3)


@dataclass(frozen=True, kw_only=True, eq=False)
class DecisionReport:
    """Content of a report."""

    first: str
    second: str
    outcomes: Sequence[ComparedOutcome]  # the first one decides
    rows: Sequence[Mapping[str, Any]]  # raw pairs, or what was compared of each
    pair: str = "pair of cuts"  # what one difference costs
    pairs: str = "pairs of cuts"
    notes: Sequence[str] = field(default_factory=tuple)

    @property
    def decision(self) -> SequentialDecision:
        """The decision."""
        return self.outcomes[0].decision[1]

    @property
    def headline(self) -> str:
        """The decision as a sentence."""
        leading, (at, said) = self.outcomes[0], self.outcomes[0].decision
        about = f"{leading.name}, after {at} {self.pairs}"
        if said == "equivalent":
            return f"{self.first} and {self.second} are equivalent within {leading.question.smallest:g} in {about}."
        if said == "undecided":
            return f"{self.first} against {self.second} is undecided in {about}."
        return f"{self.first} is {said} than {self.second} in {about}."

    @property
    def remarks(self) -> list[str]:
        """Sentences on what the numbers mean, and the notes."""
        leading = self.outcomes[0]
        question, spent = leading.question, len(leading.differences)
        said = [
            f"A decision is wrong with a probability of {question.error:g} at most, however often one looks and "
            "whenever one stops: for differences of any distribution within their bounds, with no normal curve "
            "assumed, and for means that drift."
        ]
        if spent > 1 and (sd := float(leading.differences.std(ddof=1))) > 0.0:
            fixed = fixed_design(sd, question)
            saved = "" if self.decision == "undecided" else f": {fixed - spent} saved" * (spent < fixed)
            said.append(
                f"{spent} {self.pairs} were spent; with this spread, a fixed design that finds {question.smallest:g} "
                f"with a power of 0.9 by a t test takes {fixed}{saved}."
            )
        if len(self.outcomes) > 1:
            said.append(f"{leading.name} alone decides; every other interval has its own error of {question.error:g}.")
        return [*said, *self.notes]

    def lines(self) -> list[str]:
        """Return the lines of a summary for the terminal."""
        rows = [f"  {each.name:12s} {each.estimate:28s} {each.decision[1]}" for each in self.outcomes]
        level = 100.0 * (1.0 - self.outcomes[0].question.error)
        return [
            self.headline,
            f"mean of {self.first} minus {self.second}, {level:g} % interval that holds at any time:",
            *rows,
            *(f"note: {remark}" for remark in self.remarks),
        ]


def sequence_figure(outcome: ComparedOutcome, width: float) -> Figure:
    """Draw the mean difference after every pair, with the indifference band."""
    figure = new_figure(width, 3.6 if width < PHONE_WIDTH else 3.2)
    axes = figure.subplots()
    plain_axes(axes)
    number = np.arange(1, len(outcome.differences) + 1)
    low, high = outcome.sequence
    smallest, (at, said) = outcome.question.smallest, outcome.decision
    axes.axhspan(-smallest, smallest, color="0.5", alpha=0.15, linewidth=0)
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.fill_between(number, low, high, step="post", color="#0072b2", alpha=0.2, linewidth=0)
    axes.step(number, np.cumsum(outcome.differences) / number, where="post", color="#0072b2", linewidth=1.5)
    axes.plot(number, outcome.differences, ".", color="0.4", markersize=3, alpha=0.6)
    axes.axvline(at, color=_COLOURS[said], linewidth=1.3, linestyle="--", label=label(f"{said}, after {at}"))
    axes.set_xlabel("pairs")
    axes.set_ylabel(label(f"difference of {outcome.name}"))
    reach = outcome.question.reach
    axes.set_ylim(-reach, reach)
    figure.legend(loc="outside upper left", frameon=False, fontsize=9)
    return figure


def _shown(value: object) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def write_decision(folder: Path, report: DecisionReport) -> list[Path]:
    """Write the page and the raw pairs, as CSV and Parquet; return the paths."""
    names = list(dict.fromkeys(name for row in report.rows for name in row))
    write_table(folder / TABLE, [names, *([row.get(name) for name in names] for row in report.rows)])
    arrow = optional_import("pyarrow", "pyarrow", "Parquet")
    parquet = optional_import("pyarrow.parquet", "pyarrow", "Parquet")
    with atomic_write(folder / PARQUET) as part:
        parquet.write_table(arrow.table({name: [row.get(name) for row in report.rows] for name in names}), part)
    write_page(
        folder / PAGE,
        "decision.html",
        report=report,
        kind=_KINDS[report.decision],
        names=names,
        cells=[(row.get(names[0]), [_shown(row.get(name)) for name in names[1:]]) for row in report.rows],
        sequence_figure=sequence_figure,
    )
    return [folder / PAGE, folder / TABLE, folder / PARQUET]
