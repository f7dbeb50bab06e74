"""Pass marks as text, files for other programs, and a page."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import norm

from cutenv._base.result_table import Reason, ResultRow, ResultTable
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
    write_text,
)
from cutenv.display.report.study_page import amount, correlation_text, heading_of, in_print, interval_text
from cutenv.records.scoring import METRICS
from cutenv.records.scoring.score_card import DISCLAIMER
from cutenv.records.scoring.study import (
    ErrorRate,
    Estimate,
    PassMark,
    RaterAgreement,
    Separation,
    Standard,
    StandardSetting,
    validity_evidence,
)
from cutenv.records.scoring.study.estimate import FEWEST_FOR_AN_INTERVAL, FEWEST_PEOPLE
from cutenv.records.scoring.study.pass_mark import Method, as_shown, passes
from cutenv.records.scoring.study.reliability import mean_mark
from cutenv.records.scoring.study.study import NotEstimable, value_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PASS_MARK_SCHEMA = "cutenv-pass-mark/1"
_SMALLEST_SHARE = 0.001  # below it a normal curve of a few people says nothing


def method_name(setting: StandardSetting, standard: Standard, method: Method) -> str:
    """Return a method's name, with the group that must pass."""
    if method not in ("expert mean", "expert mean and SD"):
        return method
    name = f"mean of group {setting.passing}" if setting.passing else "mean of the experts"
    way = "less" if standard.better == "higher" else "plus"
    return name if method == "expert mean" else f"{name} {way} {setting.spread:g} SD"


def mark_text(standard: Standard, mark: Estimate) -> str:
    """Return a mark with its interval, small in tables of pages."""
    factor, _ = in_print(standard)
    digits = 1 if standard.metric == "overall_score" else _digits(factor * mark.value)
    return interval_text(mark, lambda value: number(factor * value, digits))


def observed_text(rate: ErrorRate) -> str:
    """Return how many of a group are judged wrongly."""
    return f"{rate.observed} of {rate.people}" if rate.people else "no group"


def theory_text(rate: ErrorRate) -> str:
    """Return the misjudged share of a group's normal curve [%], with interval."""
    if rate.theoretical is None:
        return rate.no_curve if rate.people else ""
    each = rate.theoretical
    if each.value < _SMALLEST_SHARE and (each.high is None or each.high < _SMALLEST_SHARE):
        return f"< {100.0 * _SMALLEST_SHARE:.1f} %"
    interval = "" if each.low is None or each.high is None else f" [{_percent(each.low)}, {_percent(each.high)}]"
    return f"{_percent(each.value)} %{interval}"


def wanted(standard: Standard, value: float) -> str:
    """Return in words what passes a mark."""
    return f"{amount(standard, value)} or {'more' if standard.better == 'higher' else 'less'}"


def proficient(standard: Standard) -> tuple[int, int]:
    """Return the numbers of proficient people and of all."""
    return sum(each.reached_at is not None for each in standard.proficiency.values()), len(standard.series)


def pass_mark_lines(setting: StandardSetting) -> list[str]:
    """Return the main numbers as text, the first metric in full."""
    first, *others = setting.standards
    groups = f"; group {setting.passing} is to pass" + (f", group {setting.failing} is not" if setting.failing else "")
    lines = [
        f"{setting.name}: {len(setting.cuts)} cuts of {len(setting.operators)} people{groups * bool(setting.passing)}",
        "",
        f"{spoken(first.metric)}, {first.better} is better; each person is the mean of the cuts",
        *(f"  {line}" for line in marks_table(setting, first).lines()),
    ]
    lines += [f"  {_proficiency_line(setting, each)}" for each in (first, *others)]
    lines += _rater_lines(setting)
    notes = {found.mark.note for found in first.marks.values() if isinstance(found, PassMark) and found.mark.note}
    return [*lines, "", *(f"note: {note}" for note in (*sorted(notes), *setting.notes, DISCLAIMER))]


def write_people(path: Path, setting: StandardSetting) -> None:
    """Write a CSV row for each metric and person, in SI units."""
    heads = ["operator", "group", "metric", "unit", "mark", "mean"]
    rows: list[list[object]] = [[*heads, "passes", "cuts", "left", "longest_row", "reached_at"]]
    for standard in setting.standards:
        mark = f"{standard.chosen.mark.value:.6g}" if isinstance(standard.chosen, PassMark) else ""
        for operator, values in standard.series.items():
            own = standard.proficiency.get(operator)
            left = len(standard.left.get(operator, ()))
            counts = [None, len(values) + left, left, None, None]
            if own is not None:
                counts = [own.passes, own.cuts, own.left, own.longest, own.reached_at]
            head = [operator, setting.group_of[operator], standard.metric, standard.unit, mark]
            rows.append([*head, f"{float(np.mean(values)):.6g}", *counts])
    write_table(path, rows)


def marks_table(setting: StandardSetting, standard: Standard) -> ResultTable:
    """Return a row for each method of finding a mark; marked: that of proficiency."""
    rows = []
    for method, found in standard.marks.items():
        name = method_name(setting, standard, method)
        if isinstance(found, NotEstimable):
            rows.append(ResultRow(name, [Reason(f"no evidence: {found.reason}"), *[""] * 4]))
            continue
        cells = [mark_text(standard, found.mark)]
        for rate in (found.false_passes, found.false_fails):
            cells += [observed_text(rate), theory_text(rate)]
        rows.append(ResultRow(name, cells, found is standard.chosen))
    unit = f" [{in_print(standard)[1]}]" if in_print(standard)[1] else ""
    errors = (f"false {error}, {how}" for error in ("passes", "fails") for how in ("observed", "in theory"))
    caption = f"Pass marks of {spoken(standard.metric)}{unit}, 95 % intervals over people"
    return ResultTable(caption, ["method", "mark", *errors], rows)


def proficiency_table(setting: StandardSetting, standard: Standard) -> ResultTable:
    """Return a row for each person: mean, passes, proficiency."""
    rows = []
    for operator, own in standard.proficiency.items():
        mean = amount(standard, float(standard.series[operator].mean()))
        group = [setting.group_of[operator]] if setting.passing else []
        counts = [f"{own.passes} of {own.cuts}", str(own.longest), str(own.reached_at or "no")]
        rows.append(ResultRow(operator, [*group, mean, *counts]))
    heads = ["person", *(["group"] if setting.passing else []), "mean", "passes", "longest row", "reached at cut"]
    caption = "Mean of the cuts, passes, longest row of passes, and the cut after which proficiency was reached"
    return ResultTable(caption, heads, rows)


def rater_table(setting: StandardSetting, rater: str) -> ResultTable:
    """Return each metric's correlation with a rater's marks."""
    rows = []
    for standard in setting.standards:
        found = standard.raters[rater]
        if isinstance(found, NotEstimable):
            cells = [Reason(f"no evidence: {found.reason}"), "", ""]
        else:
            cells = [correlation_text(found.rank), correlation_text(found.linear), str(found.cuts)]
        rows.append(ResultRow(heading_of(standard), cells))
    heads = ["metric", "in ranks (Spearman)", "linear (Pearson)", "cuts"]
    return ResultTable(f"Correlation with the marks of {rater}, 95 % intervals over people", heads, rows)


def write_pass_marks(path: Path, setting: StandardSetting) -> None:
    """Write all results as JSON in SI units, or the reasons."""
    content = {
        "schema": PASS_MARK_SCHEMA,
        "name": setting.name,
        "people": len(setting.operators),
        "cuts": len(setting.cuts),
        "passing": setting.passing,
        "failing": setting.failing,
        "in_a_row": setting.in_a_row,
        "metrics": {
            each.metric: {
                "unit": each.unit,
                "better": each.better,
                "marks": {method: _plain(found) for method, found in each.marks.items()},
                "chosen": each.chosen.method if isinstance(each.chosen, PassMark) else None,
                "proficiency": {operator: _plain(own) for operator, own in each.proficiency.items()},
                "reliability": _plain(each.reliability),
                "separation": _plain(each.separation),
                "raters": {rater: _plain(found) for rater, found in each.raters.items()},
            }
            for each in setting.standards
        },
        "agreement_of_raters": _plain(setting.agreement),
        "validity": [_plain(each) for each in validity_evidence(setting)],
        "notes": list(setting.notes),
        "disclaimer": DISCLAIMER,
    }
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _proficiency_line(setting: StandardSetting, standard: Standard) -> str:
    if isinstance(standard.chosen, NotEstimable):
        return f"{spoken(standard.metric)}: no mark, {standard.chosen.reason}"
    reached, people = proficient(standard)
    return (
        f"{spoken(standard.metric)} of {wanted(standard, standard.chosen.mark.value)} ({standard.chosen.method}): "
        f"{reached} of {people} people reach it in {setting.in_a_row} cuts in a row"
    )


def _rater_lines(setting: StandardSetting) -> list[str]:
    first = setting.standards[0]
    lines = []
    for rater, found in first.raters.items():
        told = (
            f"no evidence: {found.reason}"
            if isinstance(found, NotEstimable)
            else f"{correlation_text(found.rank)} in ranks, {correlation_text(found.linear)} linear; {found.cuts} cuts"
        )
        lines.append(f"  {spoken(first.metric)} against {rater}: {told}")
    if isinstance(setting.agreement, RaterAgreement):
        each = setting.agreement
        icc = f"ICC(A,1) {correlation_text(each.agreement)}, for one scale only"
        lines.append(f"  raters with each other: {correlation_text(each.rank)} in ranks; {icc}")
    return ["", *lines] if lines else []


def _plain(found: Any) -> Mapping[str, Any]:
    if isinstance(found, NotEstimable):
        return {"no_evidence": found.reason}
    return dataclasses.asdict(found)


def _percent(share: float) -> str:
    return number(100.0 * share, 1)


def _digits(value: float) -> int:
    """Return the decimals of three significant digits."""
    text = significant(value, 3)
    return len(text.partition(".")[2])


_FAILING, _PASSING, _OTHERS = "#d55e00", "#0072b2", "#6b6b6b"
_FEW_ROWS = 20  # people whose rows have room
_LINES = ("-", "--", "-.", ":")


def curves_figure(setting: StandardSetting, standard: Standard, width: float) -> Figure:
    """Draw people's means, groups' normal curves and the methods' marks."""
    figure = new_figure(width, 3.6 if width < PHONE_WIDTH else 3.3)
    axes = figure.subplots()
    plain_axes(axes, "x")
    factor, _ = in_print(standard)
    groups = [(setting.failing, _FAILING), (setting.passing, _PASSING)]
    means = {
        group: factor * np.array([v.mean() for who, v in standard.series.items() if setting.group_of[who] == group])
        for group, _ in groups
        if group is not None
    }
    marks = {method: found for method, found in standard.marks.items() if isinstance(found, PassMark)}
    known = np.concatenate([*means.values(), factor * np.array([found.mark.value for found in marks.values()])])
    if not means:
        known = np.append(known, [factor * own.mean() for own in standard.series.values()])
    room = 0.35 * (float(np.ptp(known)) or 1.0)
    x = np.linspace(known.min() - room, known.max() + room, 400)
    peak = 0.0
    for group, colour in groups:
        own = means.get(group or "", np.zeros(0))
        if len(own) >= FEWEST_PEOPLE and own.std(ddof=1) > 0.0:
            curve = norm.pdf(x, own.mean(), own.std(ddof=1))
            peak = max(peak, float(curve.max()))
            axes.plot(x, curve, color=colour, linewidth=2.0, label=label(f"{group}, {len(own)} people"))
            axes.fill_between(x, curve, color=colour, alpha=0.15, linewidth=0)
    peak = peak or 1.0
    rows = [*((means[group], colour) for group, colour in groups if group in means)]
    if not rows:
        rows = [(factor * np.array([own.mean() for own in standard.series.values()]), _OTHERS)]
    for row, (own, colour) in enumerate(rows):
        axes.plot(own, np.full(len(own), -(0.07 + 0.08 * row) * peak), "o", color=colour, markersize=4, alpha=0.7)
    for place, (method, found) in enumerate(marks.items()):
        at = factor * found.mark.value
        axes.axvline(
            at,
            color="black",
            linewidth=1.3,
            linestyle=_LINES[place],
            label=label(method_name(setting, standard, method)),
        )
        if found is standard.chosen and found.mark.low is not None and found.mark.high is not None:
            axes.axvspan(factor * found.mark.low, factor * found.mark.high, color="0.5", alpha=0.18, linewidth=0)
    axes.set_ylim(-0.22 * peak, 1.08 * peak)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(_quantity(standard, "mean of each person's cuts"))
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside upper left", ncols=1 if width < PHONE_WIDTH else 3, frameon=False, fontsize=9)
    return figure


def proficiency_figure(setting: StandardSetting, standard: Standard, width: float) -> Figure:
    """Draw every cut, filled if passed, ringed where proficiency is reached."""
    assert isinstance(standard.chosen, PassMark)
    mark = standard.chosen.mark.value
    people = [*standard.series]
    tall = 0.2 if len(people) <= _FEW_ROWS else 0.15
    figure = new_figure(width, 1.1 + tall * len(people))
    axes = figure.subplots()
    plain_axes(axes, "x")
    colours = _colours(setting)
    for row, (operator, values) in enumerate(standard.series.items()):
        colour = colours.get(setting.group_of[operator], _OTHERS)
        shown, least = as_shown(standard.metric, values, mark)
        before = list(standard.left.get(operator, ()))
        passed = np.insert(passes(shown, least, standard.better), before, False)
        left = np.insert(np.zeros(len(values), bool), before, True)
        number = np.arange(1, len(passed) + 1)
        for chosen, sign in ((passed, "o"), (left, "x"), (~passed & ~left, "o")):
            filled = "full" if chosen is passed else "none"
            axes.plot(number[chosen], np.full(chosen.sum(), -row), sign, color=colour, markersize=5, fillstyle=filled)
        at = standard.proficiency[operator].reached_at
        if at is not None:
            axes.plot(at, -row, "o", color="black", markersize=9, fillstyle="none", markeredgewidth=1.3)
    axes.set_yticks(-np.arange(len(people)), [label(each) for each in people], fontsize=8 if tall > 0.15 else 7)
    axes.set_ylim(-len(people) + 0.3, 0.7)
    axes.set_xlim(0.4, max(each.cuts for each in standard.proficiency.values()) + 0.6)
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("number of the cut")
    return figure


def raters_figure(setting: StandardSetting, standard: Standard, width: float) -> Figure:
    """Draw a metric of rated cuts against the raters' marks."""
    figure = new_figure(width, 3.4)
    axes = figure.subplots()
    factor, _ = in_print(standard)
    table = np.array([[cut.marks.get(rater, np.nan) for rater in setting.raters] for cut in setting.cuts])
    mark = mean_mark(table) if len(setting.raters) > 1 else table[:, 0]
    value = np.array(
        [np.nan if v is None else v for v, _ in (value_of(cut.card, standard.metric) for cut in setting.cuts)]
    )
    colours = _colours(setting)
    for group in dict.fromkeys(setting.group_of.values()):
        own = np.array([cut.group == group for cut in setting.cuts])
        axes.plot(
            mark[own], factor * value[own], "o", color=colours.get(group, _OTHERS), markersize=4.5, alpha=0.7,
            markeredgewidth=0, label=label(group or "each cut"),
        )  # fmt: skip
    one = f"mark by {setting.raters[0]}" if len(setting.raters) == 1 else "mean mark of the raters [SD of each rater]"
    axes.set_xlabel(label(one))
    axes.set_ylabel(_quantity(standard))
    plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return figure


def _colours(setting: StandardSetting) -> dict[str, str]:
    groups = ((setting.failing, _FAILING), (setting.passing, _PASSING))
    return {group: colour for group, colour in groups if group is not None}


def _quantity(standard: Standard, of: str = "") -> str:
    _, unit = in_print(standard)
    unit = f" [{unit}]" if unit else ""
    return label(f"{spoken(standard.metric)}{unit}" + (f", {of}" if of else ""))


def write_pass_mark_page(
    path: Path,
    setting: StandardSetting,
    *,
    progress: Callable[[Iterable[Standard]], Iterable[Standard]] = iter,
    language: str = "en",
) -> tuple[Path, Path]:
    """Write a self-contained page, rows of people (CSV), numbers (JSON).

    Return the paths of CSV and JSON, the page's with their suffixes; ``progress`` wraps the metrics, to show how far
    the drawing is.
    """
    people, cuts = len(setting.operators), len(setting.cuts)
    write_page(
        path,
        "pass_mark.html",
        *(heading_of, marks_table, proficiency_table, rater_table, curves_figure, proficiency_figure, raters_figure),
        language=language,
        setting=setting,
        progress=progress,
        subtitle=f"{cuts} cuts of {people} people{_groups(setting)}. {DISCLAIMER}",
        headline=pass_mark_headline(setting),
        disclaimer=DISCLAIMER,
        fewest=FEWEST_FOR_AN_INTERVAL,
        evidence=validity_evidence(setting),
        meaning=_meaning,
        warnings=_warnings,
        who_reaches=partial(_who_reaches, setting),
        agreement=_agreement(setting),
    )
    table, everything = path.with_suffix(".csv"), path.with_suffix(".json")
    write_people(table, setting)
    write_pass_marks(everything, setting)
    return table, everything


def pass_mark_headline(setting: StandardSetting) -> str:
    """Return the first metric's mark in words, or why none."""
    first = setting.standards[0]
    name = spoken(first.metric).capitalize()
    if isinstance(first.chosen, NotEstimable):
        return f"{name}: no evidence for a pass mark. {first.chosen.reason.capitalize()}."
    found = first.chosen
    interval = ""
    if found.mark.low is not None and found.mark.high is not None:
        interval = f" (95 % interval {amount(first, found.mark.low)} to {amount(first, found.mark.high)})"
    elif found.method != "set by the teacher":
        interval = " (too few people for an interval)"
    way = found.method if found.method == "set by the teacher" else f"by {method_name(setting, first, found.method)}"
    said = [f"{name}: {wanted(first, found.mark.value)} passes, {way}{interval}."]
    if found.false_passes.people and found.false_fails.people:
        said.append(
            f"{observed_text(found.false_passes)} people of group {setting.failing} would pass, and "
            f"{observed_text(found.false_fails)} of group {setting.passing} would fail."
        )
    reached, people = proficient(first)
    said.append(f"{reached} of {people} people reach it in {setting.in_a_row} cuts in a row.")
    return " ".join(said)


def _groups(setting: StandardSetting) -> str:
    if setting.passing is None:
        return ""
    return f": group {setting.passing} is to pass" + (f", group {setting.failing} is not" if setting.failing else "")


def _meaning(standard: Standard) -> str:
    way = "more is better" if standard.better == "higher" else "less is better"
    if standard.metric == "overall_score":
        return f"Score of one cut from 0 to 100; {way}."
    return f"{METRICS[standard.metric].meaning} ({way})."


def _warnings(standard: Standard) -> list[str]:
    """Return warnings: why values or intervals are missing, whether groups differ."""
    notes = (
        f"no evidence: {each.reason}" if isinstance(each, NotEstimable) else each.mark.note
        for each in standard.marks.values()
    )
    said = list(dict.fromkeys(note for note in notes if note))
    if isinstance(standard.separation, Separation):
        P = standard.separation.superiority
        if P.low is not None and not P.excludes(0.5):
            said.append("the groups may not differ: the interval of the probability of superiority holds 0.5")
    return said


def _who_reaches(setting: StandardSetting, standard: Standard) -> str:
    groups = dict.fromkeys(setting.group_of[each] for each in standard.series)
    parts = []
    for group in groups:
        own = [each for who, each in standard.proficiency.items() if setting.group_of[who] == group]
        reached = sum(each.reached_at is not None for each in own)
        parts.append(f"{reached} of {len(own)} people" + (f" of group {group}" if group else ""))
    return ", ".join(parts)


def _agreement(setting: StandardSetting) -> list[list[str]] | str:
    each = setting.agreement
    if not isinstance(each, RaterAgreement):
        return each.reason
    return [
        ["agreement, ICC(A,1)", correlation_text(each.agreement), "marks taken as they are; it needs one scale"],
        ["consistency, ICC(C,1)", correlation_text(each.consistency), "a severe rater does not count"],
        ["ranks, mean over pairs", correlation_text(each.rank), "only the order counts; for any scales"],
    ]
