"""Find pass marks from several people's records, with error rates and raters' agreement."""

from __future__ import annotations

import argparse
import functools
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv._base.output import watched
from cutenv.commands.options import add_study_options, command_parser, reports_errors

if TYPE_CHECKING:  # what scores is slow to import, and --help does not need it
    from cutenv.records.scoring.study.pass_mark import Method

METHOD_NAMES: Mapping[str, Method] = {
    "contrasting-groups": "contrasting groups",
    "expert-mean": "expert mean",
    "expert-sd": "expert mean and SD",
}
"""Spelling of the methods on the command line."""


@reports_errors("pass-mark")
def main(argv: Sequence[str]) -> int:
    """Find pass marks; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    from cutenv._base.validation import in_range
    from cutenv.commands.studied_cuts import check_page, studied_cuts, study_name
    from cutenv.display.report.pass_mark_page import pass_mark_lines, write_pass_mark_page
    from cutenv.records import load_operators
    from cutenv.records.scoring.study import StandardSetting
    from cutenv.records.scoring.study.pass_mark import check_metrics, other_group

    check_page(arguments.out)
    given = _given(arguments.mark or ())
    check_metrics(arguments.metric or ())
    in_range("--sd", arguments.sd, 0.1, 4.0, "1", "In standard deviations; 1 or 2 is usual.")
    in_range("--in-a-row", arguments.in_a_row, 1, 100, "1")
    if arguments.operators is None and (arguments.raters or arguments.passing or arguments.failing):
        raise ValueError("groups and raters' marks stand in a table: name it with --operators.")
    rows = None if arguments.operators is None else load_operators(arguments.operators, raters=arguments.raters or ())
    if arguments.passing is not None or not given:
        other_group([row.group for row in rows or ()], arguments.passing, arguments.failing)
    name = study_name(arguments)
    cuts, refused, left = studied_cuts(arguments, rows)
    print("working out marks and their intervals ...", file=sys.stderr, flush=True)
    setting = StandardSetting(
        name=name,
        cuts=cuts,
        left=left,
        passing=arguments.passing,
        failing=arguments.failing,
        metrics=tuple(arguments.metric or ()),
        given=given,
        method=METHOD_NAMES[arguments.method],
        spread=arguments.sd,
        in_a_row=arguments.in_a_row,
        best_mark=arguments.best_mark,
    )
    print("\n".join(pass_mark_lines(setting)))
    for each in refused:
        print(f"note: left out: {each.name}: {each.reason}")
    if arguments.out is not None:
        drawn = functools.partial(watched, description="drawing", unit="metric")
        people, everything = write_pass_mark_page(arguments.out, setting, progress=drawn, language=arguments.language)
        print(f"\npage: {arguments.out}\npeople: {people}\neverything: {everything}")
    return 0


def _given(marks: Sequence[str]) -> dict[str, float]:
    """Return a teacher's marks by metric, in its unit."""
    from cutenv._base.validation import one_of
    from cutenv.records.scoring import METRICS
    from cutenv.records.scoring.study.study import OVERALL

    given: dict[str, float] = {}
    for text in marks:
        head, separator, tail = text.partition("=")
        name, value = (head.strip(), tail.strip()) if separator else (OVERALL, head.strip())
        one_of("--mark", name, (OVERALL, *METRICS))
        length = name != OVERALL and METRICS[name].unit == "m"
        try:
            amount = float(value.removesuffix("mm")) * (1e-3 if length else 1.0)
        except ValueError:
            amount = float("nan")
        if not abs(amount) < float("inf") or length != value.endswith("mm"):
            unit = "mm" if length else ""
            raise ValueError(f"--mark {text!r} is no mark; write {'' if name == OVERALL else f'{name}='}NUMBER{unit}.")
        if name in given:
            raise ValueError(f"--mark gives {name} twice; give one mark.")
        given[name] = amount
    return given


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "pass-mark",
        __doc__,
        examples=(
            "records/ --operators class.csv --passing expert --out marks.html",
            "records/ --operators class.csv --mark 60 --mark tip_error=3mm",
            "records/ --operators class.csv --passing expert --raters rater_a rater_b",
        ),
        note=textwrap.fill(
            "Training feedback for research; not validated for assessment or credentialing of people. What a mark may "
            "decide is for the people who use it to judge.",
            100,
        ),
    )
    add = parser.option
    add_study_options(parser, columns="group, session, order, and a column of marks for each rater")
    add("--out FILE.html", "page to write; people as .csv and everything as .json beside it", Path)
    add("--passing GROUP", "group that is to pass, such as expert")
    add("--failing GROUP", "group that is not to pass; of two groups the other one by default")
    add(
        "--metric NAME",
        "overall_score or the name of a metric; give it again for more; default the score and its leading metrics",
        action="append",
    )
    add(
        "--mark [METRIC=]NUMBER",
        "mark that you set: 60 for the overall score, tip_error=3mm for a metric; give it again for more",
        action="append",
    )
    add(
        "--method",
        "method whose mark proficiency is counted by, where you set none; default contrasting-groups. All methods "
        "are shown side by side",
        "contrasting-groups",
        choices=tuple(METHOD_NAMES),
    )
    add(
        "--sd NUMBER",
        "distance of expert-sd from the mean of the passing group, in standard deviations; default 1",
        1.0,
    )
    add("--in-a-row CUTS", "consecutive passes that are proficiency; default 2", 2)
    add("--raters COLUMN", "columns of the table with raters' marks, on any scale", nargs="+")
    add(
        "--best-mark",
        "end of the raters' scale that is best; default highest",
        "highest",
        choices=("highest", "lowest"),
    )
    return parser
