"""Study records of several people: reliability, groups, learning, personal sheets."""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv._base.output import watched
from cutenv.commands import options

if TYPE_CHECKING:
    from cutenv.display.report.decision_page import DecisionReport
    from cutenv.records.scoring.study import Study
    from cutenv.records.scoring.study.sequential import SequentialQuestion

_SCALE = 100.0  # largest overall score
_NOTABLE_DIFFERENCE = 5.0  # smallest difference of scores that matters, by default


@options.reports_errors("study", ImportError)
def main(argv: Sequence[str]) -> int:
    """Study; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    from cutenv._base.validation import in_range, one_of
    from cutenv.commands.studied_cuts import check_page, studied_cuts, study_name
    from cutenv.display.report.study_page import table_lines, write_study
    from cutenv.display.report.trainee_sheet import write_class_list, write_trainee_sheet
    from cutenv.records import load_operators
    from cutenv.records.scoring import METRICS
    from cutenv.records.scoring.study import Study
    from cutenv.records.scoring.study.study import OVERALL

    check_page(arguments.out)
    for metric in arguments.metric or ():
        one_of("--metric", metric, (OVERALL, *METRICS))
    if arguments.mark is not None:
        in_range("--mark", arguments.mark, 0.0, 100.0, "1", "Give an overall score, such as 60.")
    if arguments.sheets is not None:
        options.made_folder("--sheets", arguments.sheets)
    question = options.question_given(arguments, smallest=_NOTABLE_DIFFERENCE, reach=_SCALE)
    rows = None if arguments.operators is None else load_operators(arguments.operators)
    name = study_name(arguments)
    cuts, refused, left = studied_cuts(arguments, rows)
    print("working out reliability, groups and learning ...", file=sys.stderr, flush=True)
    study = Study(
        name=name,
        cuts=cuts,
        left=left,
        metrics=tuple(arguments.metric or ()),
        groups=None if arguments.groups is None else tuple(arguments.groups),
        target_group=arguments.criterion_group,
        target=_criterion(arguments),
    )
    print("\n".join(table_lines(study)))
    if arguments.until is not None:
        for k, report in enumerate(_decided(study, question, arguments.mark)):
            every = f"note: {report.remarks[0]}"  # holds for each person, and is said once
            print("\n".join(["", *(line for line in report.lines() if k == 0 or line != every)]))
    for each in refused:
        print(f"note: left out: {each.name}: {each.reason}")
    if arguments.out is not None:
        drawn = functools.partial(watched, description="drawing", unit="metric")
        cards = write_study(arguments.out, study, progress=drawn, language=arguments.language)
        print(f"\npage: {arguments.out}\ncards: {cards}")
    if arguments.sheets is not None:
        for operator in watched(study.operators, "drawing", "sheet"):
            write_trainee_sheet(arguments.sheets, study, operator, mark=arguments.mark, language=arguments.language)
        page, table = write_class_list(arguments.sheets, study, mark=arguments.mark, language=arguments.language)
        print(f"\nclass list: {page} and {table}\nsheets: {len(study.operators)} beside it")
    return 0


def _decided(study: Study, question: SequentialQuestion, mark: float | None) -> list[DecisionReport]:
    """Return decisions for people against the mark, or between groups.

    People are compared by their means, in the order of the table: the first of one group with the first of the other.
    """
    import numpy as np

    from cutenv.display.report.decision_page import ComparedOutcome, DecisionReport
    from cutenv.records.scoring.study.study import OVERALL, value_of

    scores: dict[str, list[float]] = {}
    for cut in study.cuts:
        value, _ = value_of(cut.card, OVERALL)
        if value is not None:
            scores.setdefault(cut.operator, []).append(value)

    def report(first: str, second: str, differences: list[float], pairs: str, *notes: str) -> DecisionReport:
        outcome = ComparedOutcome(
            name=OVERALL.replace("_", " "), differences=np.array(differences[: question.most]), question=question
        )
        return DecisionReport(
            first=first, second=second, outcomes=[outcome], rows=[], pair=pairs[:-1], pairs=pairs, notes=notes
        )

    if mark is not None:
        return [
            report(who, f"the mark {mark:g}", [value - mark for value in own], "cuts") for who, own in scores.items()
        ]
    if study.groups is None:
        raise ValueError("--until decided compares people with --mark, or two groups: give --mark or --groups.")
    means = [
        [float(np.mean(own)) for who, own in scores.items() if study.group_of[who] == group] for group in study.groups
    ]
    pairs = list(zip(*means, strict=False))
    alone = abs(len(means[0]) - len(means[1]))
    verb = "has" if alone == 1 else "have"
    notes = [f"{alone} of the larger group {verb} no partner yet; not counted"] * bool(alone)
    return [report(*study.groups, [a - b for a, b in pairs], "pairs of people", *notes)]


def _criterion(arguments: argparse.Namespace) -> float | None:
    """Return the target of the learning curves, in SI units."""
    from cutenv._base.unit_table import shown_unit
    from cutenv.records.scoring import METRICS
    from cutenv.records.scoring.study.study import OVERALL

    value: float | None = arguments.criterion
    if value is None or len(arguments.metric or ()) != 1 or arguments.metric[0] == OVERALL:
        return value
    return shown_unit(METRICS[arguments.metric[0]].unit.replace("F", "N")).to_si(value)


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "study",
        __doc__,
        examples=(
            "cuts/ --out study.html --sheets sheets",
            "records/ --operators operators.csv --metric tip_error --criterion 3",
            "records/ --operators operators.csv --criterion-group expert --target-length 80mm --mark 60",
        ),
        note="Training feedback for research; not validated for assessment or credentialing of people.",
    )
    add = parser.option
    options.add_study_options(parser, columns="group, session, order")
    add("--out FILE.html", "page to write; every card beside it as .csv", Path)
    add(
        "--sheets FOLDER",
        "folder for a page to print for each person, with history and what to try next, and for the class list",
        Path,
    )
    add("--mark SCORE", "pass mark of the overall score, for the sheets and the class list", float)
    add(
        "--metric NAME",
        "overall_score or the name of a metric; give it again for more; default the score and its leading metrics",
        action="append",
    )
    add("--groups NAME", "two groups to compare, if there are more than two", nargs=2)
    add("--criterion-group NAME", "group whose mean is the target value of the learning curves")
    add(
        "--criterion VALUE",
        "target value of the learning curves itself, in the unit in which the one --metric is shown: mm, N, s",
        float,
    )
    options.add_question(parser, unit="cut or person", smallest=f"{_NOTABLE_DIFFERENCE:g} points", most=10_000)
    return parser
