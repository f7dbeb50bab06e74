"""Page of a study of people: separation of groups, reliability of metrics, and their change from cut to cut."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from cutenv.report.page import spoken, write_page
from cutenv.report.study_figures import groups_figure, learning_figure, reliability_figure
from cutenv.report.study_table import (
    amount,
    correlation_text,
    count,
    crossover_rows,
    digits_of,
    in_print,
    shared_reason,
    spread,
    statistic_cells,
    write_cards,
)
from cutenv.scoring import METRICS
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import (
    Estimate,
    Findings,
    Intraclass,
    LearningCurve,
    NotEstimable,
    OneWay,
    Separation,
    Study,
)
from cutenv.scoring.study.study import OVERALL, direction_of

_BETTER = {"lower": "less is better", "higher": "more is better", "none": "neither way is better"}


def write_study(
    path: Path,
    study: Study,
    *,
    progress: Callable[[Iterable[Findings]], Iterable[Findings]] = iter,
    language: str = "en",
) -> Path:
    """Write a study as one self-contained page, and every card as a row of a CSV beside it.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    study : Study
        Study to write.
    progress : callable
        Wrapper of the metrics that shows how far the drawing is.
    language : {"en", "de"}
        Language of the page.

    Returns
    -------
    Path
        Path of the CSV: the page's with the suffix ``.csv``; the unit is in the name of each column that has one.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    cuts, people = count(len(study.cuts), "cut"), count(len(study.operators), study.who)
    groups = [group for group in dict.fromkeys(study.group_of.values()) if group]
    by = f" in {len(groups)} groups ({', '.join(groups)})" if len(groups) > 1 else ""
    write_page(
        path,
        "study.html",
        language=language,
        study=study,
        subtitle=f"{cuts} of {people}{by}. {DISCLAIMER}",
        headline=study_headline(study),
        disclaimer=DISCLAIMER,
        meaning=_meaning,
        progress=progress,
        groups=groups if study.groups else [],
        retested=any(isinstance(found.retest, Intraclass) for found in study.findings),
        an=_an(study.who),
        apart=_apart,
        without_groups=shared_reason([found.separation for found in study.findings]),
        without_reliability=shared_reason([found.reliability for found in study.findings]),
        caption=_caption,
        changes=_changes,
        means_and_spread=partial(_means_and_spread, study, groups if study.groups else []),
        people=partial(_people, study),
        statistic_cells=statistic_cells,
        unit=lambda found: in_print(found)[1],
        groups_figure=groups_figure,
        learning_figure=learning_figure,
        crossed=crossover_rows(study),
        reliability_figure=reliability_figure,
    )
    cards = path.with_suffix(".csv")
    write_cards(cards, study)
    return cards


def study_headline(study: Study) -> str:
    """Return the result for these people in a sentence or two, including what is open."""
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


def _people(study: Study, found: Findings) -> list[tuple[str, list[str]]]:
    """Return every person's name and row: group, cuts, mean, SD, first, last, and the cuts at which the sums signal."""
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
        rows.append((operator, cells))
    return rows


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
    """Return a sentence that names the metrics that are larger in a group; "" if there are none."""
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
    """Return an estimate within a sentence."""
    return correlation_text(each).replace("[", "(").replace(",", " to").replace("]", ")")
