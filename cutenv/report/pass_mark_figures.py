"""Figures of pass marks: the groups' curves with the marks, people's passes cut by cut, and a metric against raters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

from cutenv.report.figure import PHONE_WIDTH, label, new_figure, plain_axes
from cutenv.report.page import spoken
from cutenv.report.pass_mark_table import method_name
from cutenv.report.study_table import in_print
from cutenv.scoring.study import PassMark, Standard, StandardSetting
from cutenv.scoring.study.estimate import FEWEST_PEOPLE
from cutenv.scoring.study.pass_mark import passes
from cutenv.scoring.study.raters import mean_mark
from cutenv.scoring.study.standard_setting import as_shown
from cutenv.scoring.study.study import value_of

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
        number, passed = np.arange(1, len(values) + 1), passes(shown, least, standard.better)
        axes.plot(number[passed], np.full(passed.sum(), -row), "o", color=colour, markersize=5)
        axes.plot(number[~passed], np.full((~passed).sum(), -row), "o", color=colour, markersize=5, fillstyle="none")
        at = standard.proficiency[operator].reached_at
        if at is not None:
            axes.plot(at, -row, "o", color="black", markersize=9, fillstyle="none", markeredgewidth=1.3)
    axes.set_yticks(-np.arange(len(people)), [label(each) for each in people], fontsize=8 if tall > 0.15 else 7)
    axes.set_ylim(-len(people) + 0.3, 0.7)
    axes.set_xlim(0.4, max(map(len, standard.series.values())) + 0.6)
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
