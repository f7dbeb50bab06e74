"""Numbers of pass marks as text for the terminal and the page, and as files for other programs."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cutenv.report.page import number, significant, spoken, write_table, write_text
from cutenv.report.study_table import amount, correlation_text, in_columns, in_print
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import (
    ErrorRate,
    Estimate,
    PassMark,
    RaterAgreement,
    Standard,
    StandardSetting,
    validity_evidence,
)
from cutenv.scoring.study.pass_mark import Method
from cutenv.scoring.study.study import NotEstimable

PASS_MARK_SCHEMA = "cutenv-pass-mark/1"
_SMALLEST_SHARE = 0.001  # below it a normal curve of a few people says nothing


def method_name(setting: StandardSetting, standard: Standard, method: Method) -> str:
    """Return a method's name for people, with the name of the group that is to pass."""
    if method not in ("expert mean", "expert mean and SD"):
        return method
    name = f"mean of group {setting.passing}" if setting.passing else "mean of the experts"
    way = "less" if standard.better == "higher" else "plus"
    return name if method == "expert mean" else f"{name} {way} {setting.spread:g} SD"


def mark_text(standard: Standard, mark: Estimate) -> str:
    """Return a mark with its interval; tables of pages show the interval in small type."""
    factor, _ = in_print(standard)
    digits = 1 if standard.metric == "overall_score" else _digits(factor * mark.value)
    shown = number(factor * mark.value, digits)
    if mark.low is not None and mark.high is not None:
        shown += f" [{number(factor * mark.low, digits)}, {number(factor * mark.high, digits)}]"
    return shown


def observed_text(rate: ErrorRate) -> str:
    """Return how many of a group are judged wrongly."""
    return f"{rate.observed} of {rate.people}" if rate.people else "no group"


def theory_text(rate: ErrorRate) -> str:
    """Return the share of a group's normal curve that is judged wrongly, in percent, with its interval."""
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
    """Return how many people reach proficiency, and how many there are."""
    return sum(each.reached_at is not None for each in standard.proficiency.values()), len(standard.series)


def pass_mark_lines(setting: StandardSetting) -> list[str]:
    """Return the main numbers as lines of text: the first metric in full, the others by their mark."""
    first, *others = setting.standards
    groups = f"; group {setting.passing} is to pass" + (f", group {setting.failing} is not" if setting.failing else "")
    lines = [
        f"{setting.name}: {len(setting.cuts)} cuts of {len(setting.operators)} people{groups * bool(setting.passing)}",
        "",
        f"{spoken(first.metric)}, {first.better} is better; each person is the mean of the cuts",
        f"  {'method':31s} {'mark, 95 % interval':24s} {'false passes, in theory':35s} false fails, in theory",
    ]
    for name, cells, reason in mark_rows(setting, first):
        told = f"no evidence: {reason}" if not cells else in_columns(cells, (24, 12, 22, 12, 22))
        lines.append(f"  {name:31s} {told}".rstrip())
    lines += [f"  {_proficiency_line(setting, each)}" for each in (first, *others)]
    lines += _rater_lines(setting)
    notes = {found.mark.note for found in first.marks.values() if isinstance(found, PassMark) and found.mark.note}
    return [*lines, "", *(f"note: {note}" for note in (*sorted(notes), *setting.notes, DISCLAIMER))]


def write_people(path: Path, setting: StandardSetting) -> None:
    """Write a row for each metric and person as CSV, in SI units: mean, passes, and the cut that reached the goal."""
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


class MarkRow(NamedTuple):
    """Method's name and cells: the mark, then false passes and false fails, each observed and in theory."""

    name: str
    cells: list[str]
    reason: str
    """Reason why there is no mark; "" if there is one."""


def mark_rows(setting: StandardSetting, standard: Standard) -> list[MarkRow]:
    """Return a row for each method by which a mark was looked for."""
    rows = []
    for method, found in standard.marks.items():
        name = method_name(setting, standard, method)
        if isinstance(found, NotEstimable):
            rows.append(MarkRow(name, [], found.reason))
            continue
        cells = [mark_text(standard, found.mark)]
        for rate in (found.false_passes, found.false_fails):
            cells += [observed_text(rate), theory_text(rate)]
        rows.append(MarkRow(name, cells, ""))
    return rows


def write_pass_marks(path: Path, setting: StandardSetting) -> None:
    """Write everything that was found as JSON, in SI units; what could not be found is a reason."""
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
