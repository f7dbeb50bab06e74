"""Study of people as text, as CSV of cards, as page with figures."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cutenv._base.result_table import ColumnHead, Reason, ResultRow, ResultTable
from cutenv._base.unit_table import Unit, shown_unit
from cutenv.display.report.page import (
    PHONE_WIDTH,
    label,
    new_figure,
    number,
    plain_axes,
    significant,
    spoken,
    write_page,
    write_table,
)
from cutenv.records.scoring import METRICS
from cutenv.records.scoring.score_card import DISCLAIMER
from cutenv.records.scoring.study import (
    Crossover,
    Estimate,
    Findings,
    Intraclass,
    LearningCurve,
    NotEstimable,
    OneWay,
    Separation,
    Standard,
    Study,
    crossovers,
)
from cutenv.records.scoring.study.study import OVERALL, direction_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MAX_CUTS = 100  # number of cuts above which a study is not feasible
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
    """Return a study as text: tables of its page, what they show, notes."""
    lines = [f"{study.name}: {count(len(study.cuts), 'cut')} of {count(len(study.operators), study.who)}"]
    lines += ["", *means_table(study).lines(right=True)]
    words, notes = list(_WORDS[:1]), list(study.notes)
    if unknown := shared_reason([found.reliability for found in study.findings]):
        notes.insert(0, f"no reliability: {unknown.removeprefix('series: ')}")
    else:
        lines += ["", *reliability_table(study).lines()]
    if len(study.sessions) > 1 and not _retested(study):
        reasons = (found.retest.reason for found in study.findings if isinstance(found.retest, NotEstimable))
        notes += [f"no reliability of sessions: {reason}" for reason in dict.fromkeys(reasons)]
    if study.groups is not None:
        words.append(_WORDS[1])
        nothing = shared_reason([found.separation for found in study.findings])
        missing = [f"no difference of {' and '.join(study.groups)}: {nothing}"]
        lines += ["", *(missing if nothing else separation_table(study).lines())]
    words += _WORDS[2:] if _retested(study) else ()
    if (crossed := crossed_conditions(study)) is not None:
        said = f"Feedback {crossed.conditions[0]} against {crossed.conditions[1]}, within people. {crossed.orders}"
        lines += ["", said.rstrip(), *crossed.table.lines()]
    lines += ["", *(line for text in words for line in textwrap.wrap(text, 110, subsequent_indent="  "))]
    return [*lines, "", *(f"note: {note}" for note in (*notes, DISCLAIMER))]


def means_table(study: Study) -> ResultTable:
    """Return means and spread of every metric."""
    groups = _groups(study) if study.groups else []
    heads = ["metric", "mean", *groups, f"SD between {study.who}s", f"SD within {_an(study.who)}", "cuts"]
    rows = [ResultRow(heading_of(found), _means_and_spread(study, groups, found)) for found in study.findings]
    return ResultTable(f"Means over {study.who}s, each counting the same; and spread", heads, rows)


def separation_table(study: Study) -> ResultTable:
    """Return how two groups differ, by metric; marked where the interval of P excludes 0.5."""
    assert study.groups is not None
    first, second = study.groups
    rows = [
        ResultRow(heading_of(found), statistic_cells(found.separation, 2), _apart(found)) for found in study.findings
    ]
    return ResultTable(f"{first} against {second}", ["metric", f"P({first} larger than {second})", "Hedges' g"], rows)


def reliability_table(study: Study) -> ResultTable:
    """Return intraclass correlations of every metric, also of sessions if there are several."""
    retested = _retested(study)
    heads = ["metric", "one cut", f"mean of {_an(study.who)}'s cuts", "cuts for 0.8"]
    heads += ["sessions, agreement", "sessions, consistency"] * retested
    rows = [
        ResultRow(
            heading_of(found),
            statistic_cells(found.reliability, 3) + (statistic_cells(found.retest, 2) if retested else []),
        )
        for found in study.findings
    ]
    return ResultTable("Intraclass correlations, in brackets 95 % intervals", heads, rows)


def people_table(study: Study, found: Findings) -> ResultTable:
    """Return a metric of every person: cuts, mean, SD, first, last, signals."""
    sums = found.cusums if isinstance(found.cusums, Mapping) else {}
    rows = []
    for operator, values in found.series.items():
        cusum = sums.get(operator)
        cells = [
            *([study.group_of[operator]] if study.groups else []),
            str(len(values)),
            digits_of(found, float(values.mean())),
            "" if len(values) < 2 else digits_of(found, float(values.std(ddof=1))),
            digits_of(found, float(values[0])),
            digits_of(found, float(values[-1])),
            "" if cusum is None else str(cusum.reached_at or "no"),
            "" if cusum is None else str(cusum.left_at or "no"),
        ]
        rows.append(ResultRow(operator, cells))
    unit = f" [{in_print(found)[1]}]" if in_print(found)[1] else ""
    signals = "number of the cut at which the sums signal that the target is reached, or left again"
    heads = [study.who, *(["group"] if study.groups else []), "cuts", "mean", "SD", "first", "last", "reached", "left"]
    return ResultTable(f"{spoken(found.metric)}{unit}. Reached, left: {signals}", heads, rows)


class CrossedConditions(NamedTuple):
    """Crossover's table, its two conditions, and who began with which."""

    table: ResultTable
    conditions: tuple[str, str]
    orders: str


def crossed_conditions(study: Study) -> CrossedConditions | None:
    """Return a crossover's table, marked where 0 is excluded; None without two conditions."""
    found = crossovers(study)
    conditions = tuple(sorted({cut.condition for cut in study.cuts if cut.condition}))
    if len(conditions) != 2:
        return None
    first, second = conditions
    orders = ""
    rows = []
    for metric, each in found.items():
        unit = shown_unit(study.cuts[0].card.unit(metric)) if metric in METRICS else Unit("1", "1")
        heading = spoken(metric) if unit.sign == "1" else (spoken(metric), typeset(unit.sign))
        if isinstance(each, NotEstimable):
            rows.append(ResultRow(heading, [Reason(each.reason), "", ""]))
            continue
        orders = _orders_of(each)
        cells = [_in_unit(estimate, unit) for estimate in (each.difference, each.order, each.carry_over)]
        rows.append(ResultRow(heading, cells, _excludes_zero(each.difference)))
    caption = f"{first} minus {second}, within {study.who}s; 95 % intervals"
    table = ResultTable(caption, ["metric", "difference", "second half minus first", "orders apart"], rows)
    return CrossedConditions(table, (first, second), orders)


def heading_of(found: Findings | Standard) -> ColumnHead:
    """Return a metric's name, with any unit."""
    unit = in_print(found)[1]
    return (spoken(found.metric), unit) if unit else spoken(found.metric)


def _groups(study: Study) -> list[str]:
    return [group for group in dict.fromkeys(study.group_of.values()) if group]


def _retested(study: Study) -> bool:
    return any(isinstance(found.retest, Intraclass) for found in study.findings)


def _orders_of(each: Crossover) -> str:
    first, second = each.conditions
    began = f"{each.people[0]} began with {first}, {each.people[1]} with {second}"
    if each.order is None:
        return f"{began}: the difference holds what they learned meanwhile and the other specimens."
    return f"{began}."


def _in_unit(estimate: Estimate | None, unit: Unit) -> str:
    if estimate is None:
        return "not known"
    return interval_text(estimate, lambda value: number(unit.from_si(value), 2))


def _excludes_zero(estimate: Estimate) -> bool:
    return estimate.low is not None and estimate.high is not None and not estimate.low <= 0.0 <= estimate.high


def shared_reason(found: Sequence[object]) -> str:
    """Return the common reason why statistics are missing, or ""."""
    reasons = {each.reason if isinstance(each, NotEstimable) else "" for each in found}
    return reasons.pop() if len(reasons) == 1 else ""


def count(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}{'s' * (number != 1)}"


def write_cards(path: Path, study: Study) -> None:
    """Write a CSV row for each cut: operator and available metrics."""
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
    """Return a unit for names: N/s is N_per_s, unlike N s."""
    return unit.removeprefix("1").replace("/", "_per_").replace(" ", "_").strip("_")


def typeset(unit: str) -> str:
    """Return a unit in print typography."""
    return unit.replace("s2", "s\u00b2")


def in_print(found: Findings | Standard) -> tuple[float, str]:
    """Return the factor and unit of a metric as shown, such as mm."""
    unit = shown_unit(found.unit)
    return unit.from_si(1.0), "" if unit.sign == "1" else typeset(unit.sign)


def amount(found: Findings | Standard, value: float) -> str:
    """Return a metric's value with unit, see :func:`digits_of`."""
    return f"{digits_of(found, value)} {in_print(found)[1]}".rstrip()


def digits_of(found: Findings | Standard, value: float) -> str:
    """Return a metric's value as text: lengths in mm, scores with one decimal."""
    return number(value, 1) if found.metric == "overall_score" else three_digits(in_print(found)[0] * value)


def spread(found: Findings) -> tuple[str, str, str]:
    """Return mean, deviations between and within people as text, or ""."""
    mean = digits_of(found, float(np.mean([float(values.mean()) for values in found.series.values()])))
    if isinstance(found.reliability, OneWay):
        told = found.reliability
        return mean, digits_of(found, told.between_sd), digits_of(found, told.within_sd)
    return mean, "", digits_of(found, found.scale) if found.scale > 0.0 else ""


def cuts_needed(reliability: OneWay) -> str:
    """Return the cuts needed for a reliability of 0.8, as text."""
    cuts = reliability.cuts_for(0.8)
    if math.isinf(cuts):
        return "none will do"
    return f"more than {_MAX_CUTS}" if cuts > _MAX_CUTS else str(max(1, math.ceil(cuts)))


def statistic_cells(found: OneWay | Separation | Intraclass | NotEstimable, columns: int) -> list[str]:
    """Return a cell for each of ``columns``: a statistic's estimates, or why there are none.

    Of reliability the correlation of one cut, of the mean, and the cuts needed for 0.8; of a separation superiority and
    difference; of sessions agreement and consistency.
    """
    if isinstance(found, NotEstimable):
        return [Reason(found.reason), *[""] * (columns - 1)]
    if isinstance(found, Separation):
        return [interval_text(found.superiority), interval_text(found.difference)]
    if isinstance(found, Intraclass):
        return [correlation_text(found.agreement), correlation_text(found.consistency)]
    return [correlation_text(found.single), correlation_text(found.mean), cuts_needed(found)]


def correlation(value: float) -> str:
    """Return a correlation as text; a value below -1 becomes "< -1"."""
    return f"< {number(-1.0, 0)}" if value < -1.0 else number(value, 2)


def interval_text(each: Estimate, shown: Callable[[float], str] = lambda value: number(value, 2)) -> str:
    """Return a value as text, with any interval."""
    if each.low is None or each.high is None:
        return shown(each.value)
    return f"{shown(each.value)} [{shown(each.low)}, {shown(each.high)}]"


def correlation_text(each: Estimate) -> str:
    """Return a correlation as text, with any interval."""
    return interval_text(each, correlation)


def three_digits(value: float) -> str:
    """Return three significant digits in print typography."""
    return significant(value, 3)


_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_MARKERS = ("o", "s", "D", "^", "v", "P")
_TARGET = "#6b6b6b"


def learning_figure(study: Study, found: Findings, width: float) -> Figure:
    """Draw a metric by cut number and operator, above learning CUSUMs."""
    phone = width < PHONE_WIDTH
    summed = isinstance(found.cusums, Mapping)
    figure = new_figure(width, (5.4 if phone else 5.0) if summed else 3.0)
    panels = figure.subplots(2 if summed else 1, 1, sharex=True, squeeze=False)[:, 0]
    colours = _colours(study)
    factor, _ = in_print(found)
    told: set[str] = set()
    for operator, values in found.series.items():
        group = study.group_of[operator]
        number = np.arange(1, len(values) + 1)
        name = (group or f"each {study.who}") if group not in told else None
        told.add(group)
        panels[0].plot(
            number, factor * values, ".-", color=colours[group], linewidth=0.8, markersize=4, alpha=0.4,
            label=None if name is None else label(name),
        )  # fmt: skip
    seen = panels[0].get_ylim()  # that of the cuts: an interval may reach to where no cut can be
    for group, curve in found.curves.items():
        if not isinstance(curve, LearningCurve):
            continue
        name = f"mean{label(f' of {group}') * bool(group)}"
        if curve.low is not None and curve.high is not None:
            low, high = factor * curve.low, factor * curve.high
            panels[0].fill_between(curve.number, low, high, color=colours[group], alpha=0.2, linewidth=0)
            name += ", 95 % interval"
        panels[0].plot(curve.number, factor * curve.mean, color=colours[group], linewidth=2.4, label=name)
    panels[0].set_ylim(min(seen[0], factor * found.target), max(seen[1], factor * found.target))
    panels[0].axhline(
        factor * found.target, color=_TARGET, linestyle="--", linewidth=1.2, label=label(f"target: {found.target_is}")
    )
    panels[0].set_ylabel(_quantity(found))
    if isinstance(found.cusums, Mapping):
        for operator, sums in found.cusums.items():
            colour = colours[study.group_of[operator]]
            number = np.arange(len(sums.reaching) + 1)  # 0: before the first cut
            panels[1].plot(number, np.append(0.0, sums.reaching), "-", color=colour, linewidth=1.1, alpha=0.7)
            if sums.reached_at is not None:
                at = sums.reached_at
                panels[1].plot(at, sums.reaching[at - 1], "o", color=colour, markersize=6, markeredgecolor="white")
        threshold = next(iter(found.cusums.values())).threshold
        panels[1].axhline(threshold, color=_TARGET, linestyle=":", linewidth=1.4)
        panels[1].annotate(
            "target reached", (0.0, threshold), (4, 3), ("axes fraction", "data"), textcoords="offset points",
            fontsize=8, color=_TARGET,
        )  # fmt: skip
        panels[1].set_ylabel("learning curve CUSUM [SD]")
    panels[-1].set_xlabel("number of the cut")
    panels[-1].xaxis.get_major_locator().set_params(integer=True)
    for axes in panels:
        plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=1 if phone else 3, frameon=False, fontsize=9)
    return figure


def groups_figure(study: Study, width: float) -> Figure:
    """Draw means by group and metric, with probability of superiority."""
    phone = width < PHONE_WIDTH
    across = 2 if phone else 3
    findings = study.findings
    down = math.ceil(len(findings) / across)
    figure = new_figure(width, 0.5 + 2.25 * down)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    colours = _colours(study)
    groups = list(dict.fromkeys(study.group_of.values()))
    for axes, found in zip(panels, findings, strict=False):
        for place, group in enumerate(groups):
            own = [v.mean() for operator, v in found.series.items() if study.group_of[operator] == group]
            means = in_print(found)[0] * np.sort(own)
            shift = 0.09 * (np.arange(len(means)) % 5 - 2)
            marker = _MARKERS[place % len(_MARKERS)]
            axes.plot(place + shift, means, marker, color=colours[group], markersize=5, alpha=0.75, markeredgewidth=0)
            if len(means):
                axes.plot([place - 0.32, place + 0.32], [means.mean()] * 2, color="black", linewidth=1.4)
        axes.set_xticks(range(len(groups)), [label(group) for group in groups], fontsize=8)
        axes.set_xlim(-0.6, len(groups) - 0.4)
        axes.tick_params(axis="y", labelsize=8)
        axes.set_title(_quantity(found).replace(" [", "\n["), fontsize=9, loc="left")
        if isinstance(found.separation, Separation):
            axes.set_xlabel(f"P = {interval_text(found.separation.superiority)}".replace(" [", "\n["), fontsize=8)
        plain_axes(axes)
    for axes in panels[len(findings) :]:
        axes.remove()
    return figure


def reliability_figure(study: Study, width: float) -> Figure:
    """Draw reliability of cuts, means and sessions, by metric, with intervals."""
    phone = width < PHONE_WIDTH
    findings = [found for found in study.findings if _estimates(found)]
    tall = 0.62 if phone else 0.5
    figure = new_figure(width, 1.1 + tall * len(findings))
    axes = figure.subplots()
    told: set[str] = set()
    for row, found in enumerate(findings):
        estimates = _estimates(found)
        for k, (name, colour, marker, each) in enumerate(estimates):
            place = -row - 0.22 * (k - 0.5 * (len(estimates) - 1)) - 0.12 * phone
            if each.low is not None and each.high is not None:
                low = max(each.low, -1.0)  # the lower end of a mean's interval is unbounded
                axes.plot([low, each.high], [place, place], color=colour, linewidth=2.2, solid_capstyle="butt")
            axes.plot(
                max(each.value, -1.0), place, marker, color=colour, markersize=6,
                label=None if name in told else name,
            )  # fmt: skip
            told.add(name)
    names = [_quantity(found).partition(" [")[0] for found in findings]
    if phone:  # names beside the dots would leave no room for the dots
        axes.set_yticks([])
        for row, name in enumerate(names):
            axes.annotate(name, (0.0, -row), (2, 9), ("axes fraction", "data"), textcoords="offset points", fontsize=8)
    else:
        axes.set_yticks(-np.arange(len(findings)), names)
    axes.set_ylim(-len(findings) + 0.4, 0.6)
    axes.set_xlim(left=max(-1.0, min(-0.1, axes.get_xlim()[0])), right=1.02)
    axes.axvline(0.0, color="0.6", linewidth=0.8, zorder=0.5)
    axes.set_xlabel("intraclass correlation (ICC)")
    plain_axes(axes, "x")
    figure.legend(loc="outside upper left", ncols=1 if phone else 3, frameon=False, fontsize=9)
    return figure


def _estimates(found: Findings) -> Sequence[tuple[str, str, str, Estimate]]:
    shown: list[tuple[str, str, str, Estimate]] = []
    if isinstance(found.reliability, OneWay):
        shown.append(("single cuts, ICC(1)", _COLOURS[0], "o", found.reliability.single))
        shown.append(("means of one's cuts, ICC(k)", _COLOURS[1], "s", found.reliability.mean))
    if isinstance(found.retest, Intraclass):
        shown.append(("session means, agreement, ICC(A,1)", _COLOURS[2], "D", found.retest.agreement))
    return shown


def _colours(study: Study) -> dict[str, str]:
    groups = dict.fromkeys(study.group_of.values())
    return {group: _COLOURS[i % len(_COLOURS)] for i, group in enumerate(groups)}


def _quantity(found: Findings) -> str:
    _, unit = in_print(found)
    return label(spoken(found.metric)) + (f" [{unit}]" if unit else "")


_TABLES = (heading_of, means_table, separation_table, reliability_table, people_table)
_FIGURES = (groups_figure, learning_figure, reliability_figure)
_BETTER = {"lower": "less is better", "higher": "more is better", "none": "neither way is better"}


def write_study(
    path: Path,
    study: Study,
    *,
    progress: Callable[[Iterable[Findings]], Iterable[Findings]] = iter,
    language: str = "en",
) -> Path:
    """Write a study as one self-contained page, its cards as CSV.

    Return the path of the CSV, whose columns name their units; ``progress`` wraps the metrics, to show how far the
    drawing is.
    """
    cuts, people = count(len(study.cuts), "cut"), count(len(study.operators), study.who)
    groups = _groups(study)
    by = f" in {len(groups)} groups ({', '.join(groups)})" if len(groups) > 1 else ""
    write_page(
        path,
        "study.html",
        *_TABLES,
        *_FIGURES,
        language=language,
        study=study,
        subtitle=f"{cuts} of {people}{by}. {DISCLAIMER}",
        headline=study_headline(study),
        disclaimer=DISCLAIMER,
        meaning=_meaning,
        progress=progress,
        retested=_retested(study),
        an=_an(study.who),
        without_groups=shared_reason([found.separation for found in study.findings]),
        without_reliability=shared_reason([found.reliability for found in study.findings]),
        caption=_caption,
        changes=_changes,
        crossed=crossed_conditions(study),
    )
    cards = path.with_suffix(".csv")
    write_cards(cards, study)
    return cards


def study_headline(study: Study) -> str:
    """Return the study's result in words, with what is open."""
    said = []
    separated = [each for each in study.findings if isinstance(each.separation, Separation)]
    if separated and study.groups is not None:
        apart = [each for each in separated if _apart(each)]
        first, second = study.groups
        if all(_value_alone(each.separation) for each in separated):
            said.append(f"Too few {study.who}s to say whether {first} and {second} differ beyond these people.")
        elif apart:
            said.append(
                f"{len(apart)} of {len(separated)} metrics distinguish {first} from {second} "
                "(95 % interval without 0.5). "
                + " ".join(_larger(apart, group, group == first) for group in study.groups).strip()
            )
        else:
            said.append(
                f"None of {len(separated)} metrics distinguishes {first} from {second}: every interval contains 0.5."
            )
    reliable = [
        (each.metric, each.reliability)
        for each in study.findings
        if isinstance(each.reliability, OneWay) and each.reliability.single.low is not None
    ]
    overall = dict(reliable).get(OVERALL)
    if overall is not None and overall.single.value > 0.0:
        said.append(
            f"Reliability of the overall score, ICC: {_interval(overall.single)} of one cut, {_interval(overall.mean)} "
            f"of the mean of {_an(study.who)}'s cuts."
        )
    elif overall is not None:
        said.append(
            f"The overall score of one cut says next to nothing about who made it, ICC {_interval(overall.single)}."
        )
    if reliable:
        best, found = max(reliable, key=lambda pair: pair[1].single.value)
        said.append(
            f"The most reliable metric of a single cut is {spoken(best)}, "
            f"ICC {_interval(found.single)}; its mean over {_an(study.who)}'s cuts {_interval(found.mean)}."
        )
    return " ".join(said) or f"Too few {study.who}s or cuts for a statement beyond these people."


def _means_and_spread(study: Study, groups: Sequence[str], found: Findings) -> list[str]:
    mean, between, within = spread(found)
    of_groups = [
        [v.mean() for operator, v in found.series.items() if study.group_of[operator] == group] for group in groups
    ]
    return [
        mean,
        *("" if not means else digits_of(found, float(np.mean(means))) for means in of_groups),
        between,
        within,
        str(sum(len(values) for values in found.series.values())),
    ]


def _caption(found: Findings) -> str:
    target = f"Target {amount(found, found.target)} ({found.target_is})"
    if isinstance(found.cusums, NotEstimable):
        return f"{target}. No cumulative sums: {found.cusums.reason}."
    reached = sum(each.reached_at is not None for each in found.cusums.values())
    deviation = f"standard deviation of single cuts {amount(found, found.scale)}"
    return f"{target}; {deviation}. {reached} of {len(found.cusums)} reach it."


def _change(group: str, curve: LearningCurve | NotEstimable, found: Findings) -> str:
    if isinstance(curve, NotEstimable):
        return ""
    interval = ""
    if curve.change_low is not None and curve.change_high is not None:
        low, high = float(curve.change_low[-1]), float(curve.change_high[-1])
        open_ = ", an interval that holds 0" if low <= 0.0 <= high else ""
        interval = f" ({digits_of(found, low)} to {digits_of(found, high)}){open_}"
    return (
        f"{_of(group)} the first cut to number {curve.number[-1]} ({curve.people[-1]} of them, paired) it changes by "
        f"{amount(found, float(curve.change[-1]))}{interval}."
    )


def _changes(found: Findings) -> str:
    return " ".join(_change(group, curve, found) for group, curve in found.curves.items())


def _apart(found: Findings) -> bool:
    return isinstance(found.separation, Separation) and found.separation.superiority.excludes(0.5)


def _value_alone(told: Separation | NotEstimable) -> bool:
    return isinstance(told, Separation) and told.superiority.low is None


def _larger(apart: list[Findings], group: str, is_first: bool) -> str:
    """Return a sentence on metrics larger in a group, or ""."""
    names = [
        spoken(each.metric)
        for each in apart
        if isinstance(each.separation, Separation) and (each.separation.superiority.value > 0.5) is is_first
    ]
    return f"Larger in {group}: {', '.join(names)}." if names else ""


def _of(group: str) -> str:
    return f"In {group}, from" if group else "From"


def _an(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _meaning(found: Findings) -> str:
    better = _BETTER[direction_of(found.metric)]
    if found.metric == OVERALL:
        return f"Score of one cut from 0 to 100, the sum of its points ({better})."
    about = METRICS[found.metric]
    return f"{about.meaning} ({about.formula}; {better}.)"


def _interval(each: Estimate) -> str:
    return correlation_text(each).replace("[", "(").replace(",", " to").replace("]", ")")
