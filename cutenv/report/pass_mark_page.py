"""Page of pass marks, with figures: methods side by side, proficiency, raters, and the sources of validity."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

from cutenv.report.page import PHONE_WIDTH, label, new_figure, plain_axes, spoken, write_page
from cutenv.report.pass_mark_table import (
    mark_rows,
    method_name,
    observed_text,
    proficient,
    wanted,
    write_pass_marks,
    write_people,
)
from cutenv.report.study_table import amount, correlation_text, in_print
from cutenv.scoring import METRICS
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import (
    PassMark,
    RaterAgreement,
    Separation,
    Standard,
    StandardSetting,
    validity_evidence,
)
from cutenv.scoring.study.estimate import FEWEST_FOR_AN_INTERVAL, FEWEST_PEOPLE
from cutenv.scoring.study.pass_mark import as_shown, passes
from cutenv.scoring.study.reliability import mean_mark
from cutenv.scoring.study.study import NotEstimable, value_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_FAILING, _PASSING, _OTHERS = "#d55e00", "#0072b2", "#6b6b6b"
_FEW_ROWS = 20  # people whose rows have room
_LINES = ("-", "--", "-.", ":")


def curves_figure(setting: StandardSetting, standard: Standard, width: float) -> Figure:
    """Draw each person's mean and the normal curve of each group, with the mark of every method."""
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
    """Draw every cut of every person, filled if it passes, and a ring where proficiency is reached."""
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
    """Draw a metric of every rated cut against its mark, or the mean mark of several raters."""
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
    """Write pass marks as one self-contained page, every person's row as CSV and all numbers as JSON beside it.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    setting : StandardSetting
        What to write.
    progress : callable
        Wrapper of the metrics that shows how far the drawing is.
    language : str
        Language of the page.

    Returns
    -------
    pair of Path
        Paths of the CSV and of the JSON: the page's with their suffixes.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    people, cuts = len(setting.operators), len(setting.cuts)
    write_page(
        path,
        "pass_mark.html",
        language=language,
        setting=setting,
        progress=progress,
        subtitle=f"{cuts} cuts of {people} people{_groups(setting)}. {DISCLAIMER}",
        headline=pass_mark_headline(setting),
        disclaimer=DISCLAIMER,
        fewest=FEWEST_FOR_AN_INTERVAL,
        evidence=validity_evidence(setting),
        meaning=_meaning,
        named=_named,
        marks=partial(_marks, setting),
        warnings=_warnings,
        people=partial(_people, setting),
        who_reaches=partial(_who_reaches, setting),
        rated=_rated,
        agreement=_agreement(setting),
        curves_figure=curves_figure,
        proficiency_figure=proficiency_figure,
        raters_figure=raters_figure,
    )
    table, everything = path.with_suffix(".csv"), path.with_suffix(".json")
    write_people(table, setting)
    write_pass_marks(everything, setting)
    return table, everything


def pass_mark_headline(setting: StandardSetting) -> str:
    """Return the mark of the first metric in a sentence or two, with its errors, or why there is none."""
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


def _named(standard: Standard) -> tuple[str, str]:
    """Return a metric's name and unit for people."""
    return spoken(standard.metric), in_print(standard)[1]


def _meaning(standard: Standard) -> str:
    way = "more is better" if standard.better == "higher" else "less is better"
    if standard.metric == "overall_score":
        return f"Score of one cut from 0 to 100; {way}."
    return f"{METRICS[standard.metric].meaning} ({way})."


def _marks(setting: StandardSetting, standard: Standard) -> list[tuple[str, list[str], bool]]:
    """Return every method's name, its row, and whether proficiency goes by it."""
    chosen = [found is standard.chosen for found in standard.marks.values()]
    return [
        (row.name, row.cells or ["no evidence", "", "", "", ""], own and row.cells != [])
        for row, own in zip(mark_rows(setting, standard), chosen, strict=True)
    ]


def _warnings(standard: Standard) -> list[str]:
    """Return what a reader of the marks has to know: why one has no value or no interval, and whether groups differ."""
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


def _people(setting: StandardSetting, standard: Standard) -> list[tuple[str, list[str]]]:
    rows = []
    for operator, own in standard.proficiency.items():
        mean = amount(standard, float(standard.series[operator].mean()))
        group = [setting.group_of[operator]] if setting.passing else []
        counts = [f"{own.passes} of {own.cuts}", str(own.longest), str(own.reached_at or "no")]
        rows.append((operator, [*group, mean, *counts]))
    return rows


def _who_reaches(setting: StandardSetting, standard: Standard) -> str:
    """Return how many people of each group are proficient."""
    groups = dict.fromkeys(setting.group_of[each] for each in standard.series)
    parts = []
    for group in groups:
        own = [each for who, each in standard.proficiency.items() if setting.group_of[who] == group]
        reached = sum(each.reached_at is not None for each in own)
        parts.append(f"{reached} of {len(own)} people" + (f" of group {group}" if group else ""))
    return ", ".join(parts)


def _rated(standard: Standard, rater: str) -> list[str]:
    """Return rank and linear correlation with a rater's marks and the number of cuts, or why there is none."""
    found = standard.raters[rater]
    if isinstance(found, NotEstimable):
        return [f"no evidence: {found.reason}", "", ""]
    return [correlation_text(found.rank), correlation_text(found.linear), str(found.cuts)]


def _agreement(setting: StandardSetting) -> list[list[str]] | str:
    each = setting.agreement
    if not isinstance(each, RaterAgreement):
        return each.reason
    return [
        ["agreement, ICC(A,1)", correlation_text(each.agreement), "marks taken as they are; it needs one scale"],
        ["consistency, ICC(C,1)", correlation_text(each.consistency), "a severe rater does not count"],
        ["ranks, mean over pairs", correlation_text(each.rank), "only the order counts; for any scales"],
    ]
