"""Crossover of a study as rows of text, for the terminal and the page."""

from __future__ import annotations

from typing import NamedTuple

from cutenv._base.unit_table import Unit, shown_unit
from cutenv.report.page import estimate_text, number, spoken
from cutenv.report.study_table import aligned
from cutenv.scoring import METRICS
from cutenv.scoring.study import Crossover, Estimate, NotEstimable, Study, crossovers


class CrossoverRow(NamedTuple):
    """Metric with its unit, its three estimates as text, and whether the difference excludes 0."""

    name: str
    cells: list[str]
    apart: bool


class CrossoverRows(NamedTuple):
    """Rows of a crossover, the two conditions, and a sentence on the orders."""

    rows: list[CrossoverRow]
    conditions: tuple[str, str]
    orders: str


def crossover_rows(study: Study) -> CrossoverRows | None:
    """Return the crossover of a study as text; None if no cut has a condition, or they are not two."""
    found = crossovers(study)
    conditions = tuple(sorted({cut.condition for cut in study.cuts if cut.condition}))
    if len(conditions) != 2:
        return None
    first, second = conditions
    orders = ""
    rows = []
    for metric, each in found.items():
        unit = shown_unit(study.cuts[0].card.unit(metric)) if metric in METRICS else Unit("1", "1")
        sign = unit.sign.replace("s2", "s²")
        name = spoken(metric) + (f" [{sign}]" if sign != "1" else "")
        if isinstance(each, NotEstimable):
            rows.append(CrossoverRow(name, [each.reason, "", ""], False))
            continue
        orders = _orders(each)
        cells = [_text(estimate, unit) for estimate in (each.difference, each.order, each.carry_over)]
        rows.append(CrossoverRow(name, cells, _excludes_zero(each.difference)))
    return CrossoverRows(rows, (first, second), orders)


def crossover_lines(study: Study) -> list[str]:
    """Return the crossover of a study as aligned text; [] if it has none."""
    crossed = crossover_rows(study)
    if crossed is None:
        return []
    first, second = crossed.conditions
    head = f"{'metric':28s} {f'{first} minus {second}':26s} {'second half minus first':26s} orders apart"
    lines = [aligned([row.name, *row.cells], (28, 26, 26, 26)).rstrip() for row in crossed.rows]
    said = f"Feedback {first} against {second}, within people. {crossed.orders}".rstrip()
    return ["", said, head, *lines]


def _orders(each: Crossover) -> str:
    first, second = each.conditions
    began = f"{each.people[0]} began with {first}, {each.people[1]} with {second}"
    if each.order is None:
        return f"{began}: the difference holds what they learned meanwhile and the other specimens."
    return f"{began}."


def _text(estimate: Estimate | None, unit: Unit) -> str:
    if estimate is None:
        return "not known"
    if estimate.low is None or estimate.high is None:
        return number(unit.from_si(estimate.value), 2)
    low, high = (unit.from_si(end) for end in (estimate.low, estimate.high))
    return estimate_text(unit.from_si(estimate.value), low, high, 2)


def _excludes_zero(estimate: Estimate) -> bool:
    return estimate.low is not None and estimate.high is not None and not estimate.low <= 0.0 <= estimate.high
