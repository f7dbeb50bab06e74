"""Study's numbers and its crossover as text, and its cards as a file."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cutenv._base.unit_table import Unit, shown_unit
from cutenv.report.page import estimate_text, number, significant, spoken, write_table
from cutenv.scoring import METRICS
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import (
    Crossover,
    Estimate,
    Findings,
    Intraclass,
    NotEstimable,
    OneWay,
    Separation,
    Standard,
    Study,
    crossovers,
)

_LONGEST = 100  # number of cuts beyond which nobody would make them
_WORDS = (
    "ICC, the intraclass correlation: the share of a metric's variance that lies between people, and not between the "
    "cuts of one person. 1 is a metric that is always the same for the same person, 0 one that tells nobody from "
    'another. "Cuts for 0.8" is the number of cuts whose mean has an ICC of 0.8.',
    "P, the probability of superiority: how likely the mean of one of the first group is above that of one of the "
    "second. 0.5 is no difference. Hedges' g: difference of the groups' means in standard deviations between people.",
    "Sessions: the ICC of session means. A change of everybody from one session to the next counts against agreement, "
    "and not against consistency.",
)
"""Explanation of what the table shows: reliability, groups, sessions."""


def table_lines(study: Study) -> list[str]:
    """Return the study's numbers as aligned text: metrics by person, reliability, separation, notes."""
    unknown = shared_reason([found.reliability for found in study.findings])
    lines = [
        f"{study.name}: {count(len(study.cuts), 'cut')} of {count(len(study.operators), study.who)}",
        "",
        f"{'metric':24s} {'unit':6s} {'mean':>9s} {'SD between':>11s} {'SD within':>10s}  "
        f"{'ICC of one cut':21s} {'ICC of the mean':21s} {'cuts for 0.8':>12s}",
    ]
    for found in study.findings:
        *correlations, cuts = statistic_cells(found.reliability)
        told = f"{in_columns(correlations, (21, 21))} {cuts:>12s}" if correlations else cuts * (not unknown)
        mean, between, within = spread(found)
        name = f"{spoken(found.metric):24s} {in_print(found)[1]:6s}"
        lines.append(f"{name} {mean:>9s} {between:>11s} {within:>10s}  {told}".rstrip())
    words = list(_WORDS[:1])
    if study.groups is not None:
        words.append(_WORDS[1])
        first, second = study.groups
        lines += ["", f"{'metric':24s} P({first} > {second}){'':4s} Hedges' g"]
        if nothing := shared_reason([found.separation for found in study.findings]):
            lines[-1] = f"no difference of {first} and {second}: {nothing}"
        for found in study.findings * (not nothing):
            lines.append(f"{spoken(found.metric):24s} {in_columns(statistic_cells(found.separation))}")
    if len(study.sessions) > 1:
        words.append(_WORDS[2])
        lines += ["", f"{'metric':24s} {'sessions, agreement':21s} sessions, consistency"]
        for found in study.findings:
            lines.append(f"{spoken(found.metric):24s} {in_columns(statistic_cells(found.retest))}")
    lines += ["", *(line for text in words for line in textwrap.wrap(text, 110, subsequent_indent="  "))]
    notes = [f"no reliability: {unknown.removeprefix('series: ')}"] * bool(unknown)
    return [*lines, "", *(f"note: {note}" for note in (*notes, *study.notes, DISCLAIMER))]


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
        orders = _orders_of(each)
        cells = [_in_unit(estimate, unit) for estimate in (each.difference, each.order, each.carry_over)]
        rows.append(CrossoverRow(name, cells, _excludes_zero(each.difference)))
    return CrossoverRows(rows, (first, second), orders)


def crossover_lines(study: Study) -> list[str]:
    """Return the crossover of a study as aligned text; [] if it has none."""
    crossed = crossover_rows(study)
    if crossed is None:
        return []
    first, second = crossed.conditions
    head = f"{'metric':28s} {f'{first} minus {second}':26s} {'second half minus first':26s} orders apart"
    lines = [in_columns([row.name, *row.cells], (28, 26, 26, 26)).rstrip() for row in crossed.rows]
    said = f"Feedback {first} against {second}, within people. {crossed.orders}".rstrip()
    return ["", said, head, *lines]


def _orders_of(each: Crossover) -> str:
    first, second = each.conditions
    began = f"{each.people[0]} began with {first}, {each.people[1]} with {second}"
    if each.order is None:
        return f"{began}: the difference holds what they learned meanwhile and the other specimens."
    return f"{began}."


def _in_unit(estimate: Estimate | None, unit: Unit) -> str:
    if estimate is None:
        return "not known"
    if estimate.low is None or estimate.high is None:
        return number(unit.from_si(estimate.value), 2)
    low, high = (unit.from_si(end) for end in (estimate.low, estimate.high))
    return estimate_text(unit.from_si(estimate.value), low, high, 2)


def _excludes_zero(estimate: Estimate) -> bool:
    return estimate.low is not None and estimate.high is not None and not estimate.low <= 0.0 <= estimate.high


def shared_reason(found: Sequence[object]) -> str:
    """Return the reason why none of several statistics could be computed, if it is one and the same, else ""."""
    reasons = {each.reason if isinstance(each, NotEstimable) else "" for each in found}
    return reasons.pop() if len(reasons) == 1 else ""


def count(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}{'s' * (number != 1)}"


def write_cards(path: Path, study: Study) -> None:
    """Write a row for each cut: its operator, and every metric; empty where a cut has none, as one that was left."""
    names = list(study.cuts[0].card.metrics)
    units = {name: study.cuts[0].card.unit(name) for name in names}
    heads = [name if unit == "1" else f"{name}_{_suffix(unit)}" for name, unit in units.items()]
    fixed = ["record", study.who, "group", "session", "number", "state", "force_unit", "tip_source"]
    rows: list[list[object]] = [[*fixed, *heads]]
    for place, cut in study.attempts():
        if isinstance(cut, str):
            rows.append(["", cut, study.group_of.get(cut, ""), "", place, "left", *[""] * (2 + len(heads))])
            continue
        card = cut.card
        values = [card.metrics[name].value for name in names]
        head = [card.name, cut.operator, cut.group, cut.session, place, "finished", card.force_unit, card.tip_source]
        rows.append([*head, *("" if value is None else f"{value:.6g}" for value in values)])
    write_table(path, rows)


def _suffix(unit: str) -> str:
    """Return a unit as a part of a name: N/s is N_per_s, in distinction to N s."""
    return unit.removeprefix("1").replace("/", "_per_").replace(" ", "_").strip("_")


def typeset(unit: str) -> str:
    """Return a unit in print typography."""
    return unit.replace("s2", "s\u00b2")


def in_print(found: Findings | Standard) -> tuple[float, str]:
    """Return the factor and the unit in which a metric is shown to people: lengths in mm, pure numbers without unit."""
    unit = shown_unit(found.unit)
    return unit.from_si(1.0), "" if unit.sign == "1" else typeset(unit.sign)


def amount(found: Findings | Standard, value: float) -> str:
    """Return a value of a metric with its unit, see :func:`digits_of`."""
    return f"{digits_of(found, value)} {in_print(found)[1]}".rstrip()


def digits_of(found: Findings | Standard, value: float) -> str:
    """Return a value of a metric as people read it: lengths in mm, scores with one decimal."""
    return number(value, 1) if found.metric == "overall_score" else three_digits(in_print(found)[0] * value)


def spread(found: Findings) -> tuple[str, str, str]:
    """Return the mean over people, and standard deviations between and within them as text, "" if not known."""
    mean = digits_of(found, float(np.mean([float(values.mean()) for values in found.series.values()])))
    if isinstance(found.reliability, OneWay):
        told = found.reliability
        return mean, digits_of(found, told.between_sd), digits_of(found, told.within_sd)
    return mean, "", digits_of(found, found.scale) if found.scale > 0.0 else ""


def cuts_needed(told: OneWay) -> str:
    """Return the number of cuts whose mean would reach a reliability of 0.8, in words if it is out of reach."""
    cuts = told.cuts_for(0.8)
    if math.isinf(cuts):
        return "none will do"
    return f"more than {_LONGEST}" if cuts > _LONGEST else str(max(1, math.ceil(cuts)))


def statistic_cells(found: OneWay | Separation | Intraclass | NotEstimable) -> list[str]:
    """Return the estimates of a statistic as text, or the reason why there are none.

    Of reliability the correlation of one cut, of the mean, and the cuts needed for 0.8; of a separation superiority and
    difference; of sessions agreement and consistency.
    """
    if isinstance(found, NotEstimable):
        return [found.reason]
    if isinstance(found, Separation):
        return [interval_text(found.superiority), interval_text(found.difference)]
    if isinstance(found, Intraclass):
        return [correlation_text(found.agreement), correlation_text(found.consistency)]
    return [correlation_text(found.single), correlation_text(found.mean), cuts_needed(found)]


def in_columns(cells: Sequence[str], widths: Sequence[int] = (21, 0)) -> str:
    """Return cells as columns of these widths, for the terminal."""
    return " ".join(f"{cell:{width}s}" for cell, width in zip(cells, widths, strict=False))


def correlation(value: float) -> str:
    """Return a correlation as text; those of means have no lower bound, and values below -1 have no meaning."""
    return f"< {number(-1.0, 0)}" if value < -1.0 else number(value, 2)


def correlation_text(each: Estimate) -> str:
    """Return a correlation as text, with its interval if there is one."""
    if each.low is None or each.high is None:
        return correlation(each.value)
    return f"{correlation(each.value)} [{correlation(each.low)}, {correlation(each.high)}]"


def interval_text(each: Estimate) -> str:
    """Return a value as text, with its interval if there is one."""
    if each.low is None or each.high is None:
        return number(each.value, 2)
    return estimate_text(each.value, each.low, each.high, 2)


def three_digits(value: float) -> str:
    """Return three significant digits in print typography."""
    return significant(value, 3)
