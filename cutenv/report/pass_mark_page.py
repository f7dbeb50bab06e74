"""Page of pass marks: methods side by side, proficiency, raters, and the sources of validity."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from cutenv.report.page import spoken, write_page
from cutenv.report.pass_mark_figures import curves_figure, proficiency_figure, raters_figure
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
    RaterAgreement,
    Separation,
    Standard,
    StandardSetting,
    validity_evidence,
)
from cutenv.scoring.study.bootstrap import FEWEST_FOR_AN_INTERVAL
from cutenv.scoring.study.study import NotEstimable


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
    language : {"en", "de"}
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
