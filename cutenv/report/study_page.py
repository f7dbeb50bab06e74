"""Page of a study of people: separation of groups, reliability of metrics, and their change from cut to cut."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from cutenv.report.page import (
    Html,
    PageSection,
    Row,
    definitions,
    element,
    escaped,
    folded,
    html_table,
    joined,
    number,
    page,
    paragraph,
    picture,
    write_page,
)
from cutenv.report.study_figures import groups_figure, learning_figure, reliability_figure, typeset
from cutenv.report.study_table import correlation, cuts_needed, spread, three_digits, write_cards
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

_BETTER = {"lower": "less is better", "higher": "more is better", "none": "neither way is better"}


def write_study(path: Path, study: Study) -> Path:
    """Write a study as one self-contained page, and every card as a row of a CSV beside it.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    study : Study
        Study to write.

    Returns
    -------
    Path
        Path of the CSV: the page's with the suffix ``.csv``; the unit is in the name of each column that has one.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    sections = [PageSection("metrics", f"Metrics of these {study.who}s", _metrics(study))]
    if study.groups is not None:
        sections.append(PageSection("groups", "Separation of the groups", _groups(study)))
    sections += [
        PageSection("reliability", "Reliability", _reliability(study)),
        PageSection("learning", f"Cut by cut, {study.who} by {study.who}", _learning(study)),
        PageSection("meaning", "What the numbers mean", _meaning(study)),
    ]
    cuts, people = len(study.cuts), len(study.operators)
    groups = [group for group in dict.fromkeys(study.group_of.values()) if group]
    by = f" in {len(groups)} groups ({', '.join(groups)})" if len(groups) > 1 else ""
    subtitle = f"{cuts} cuts of {people} {study.who}s{by}. {DISCLAIMER}"
    write_page(path, page(f"Study: {study.name}", subtitle, _lead(study), sections))
    cards = path.with_suffix(".csv")
    write_cards(cards, study)
    return cards


def study_headline(study: Study) -> str:
    """Return the result for these people in a sentence or two, including what is open."""
    said = []
    separated = [each for each in study.findings if isinstance(each.separation, Separation)]
    if separated and study.groups is not None:
        apart = [each for each in separated if not _holds(each.separation, 0.5)]
        first, second = study.groups
        if apart:
            said.append(
                f"{len(apart)} of {len(separated)} metrics distinguish {first} from {second} "
                "(95 % interval without 0.5). "
                + " ".join(_larger(apart, group, group == first) for group in study.groups).strip()
            )
        else:
            said.append(
                f"None of {len(separated)} metrics distinguishes {first} from {second}: every interval contains 0.5."
            )
    reliable = [(each, each.reliability) for each in study.findings if isinstance(each.reliability, OneWay)]
    if reliable:
        best, found = max(reliable, key=lambda pair: pair[1].single.value)
        said.append(
            f"The most reliable metric of a single cut is {_spoken(best.metric)}, "
            f"ICC {_interval(found.single, 2)}; its mean over {_an(study.who)}'s cuts {_interval(found.mean, 2)}."
        )
    return " ".join(said) or "Too few people or cuts for any statement about people: there are metrics only."


def _lead(study: Study) -> Html:
    return Html(
        f'<div class="verdict '
        f'open">\n{paragraph("For research", "word")}\n{paragraph(study_headline(study), "headline")}\n'
        f"{paragraph(DISCLAIMER + ' Several metrics are looked at, and no interval is widened for that.')}</div>"
    )


def _metrics(study: Study) -> Html:
    groups = [group for group in dict.fromkeys(study.group_of.values()) if group] if study.groups else []
    heads = ["metric", "mean", *groups, f"SD between {study.who}s", f"SD within {_an(study.who)}", "cuts"]
    rows = []
    for found in study.findings:
        mean, between, within = spread(found)
        of_groups = [
            [v.mean() for operator, v in found.series.items() if study.group_of[operator] == group] for group in groups
        ]
        cells = [
            three_digits(mean),
            *("" if not means else three_digits(float(np.mean(means))) for means in of_groups),
            between,
            within,
            str(sum(len(values) for values in found.series.values())),
        ]
        rows.append(Row([_named(found), *(escaped(cell) for cell in cells)]))
    return joined(
        html_table(
            f"Means over {study.who}s, each counting the same; and spread", [escaped(head) for head in heads], rows
        ),
        element("ul", Html("\n".join(f"<li>{escaped(note)}</li>" for note in study.notes)))
        if study.notes
        else Html(""),
    )


def _groups(study: Study) -> Html:
    assert study.groups is not None, "there is a separation"
    first, second = study.groups
    rows = []
    for found in study.findings:
        if isinstance(found.separation, NotEstimable):
            cells = [_said(found.separation.reason), escaped("")]
        else:
            cells = [_cell(found.separation.superiority, 2), _cell(found.separation.difference, 2)]
        apart = isinstance(found.separation, Separation) and not _holds(found.separation, 0.5)
        rows.append(Row([_named(found), *cells], "own" if apart else ""))
    heads = [escaped(text) for text in ("metric", f"P({first} larger than {second})", "Hedges' g")]
    return joined(
        paragraph(
            f"Each {study.who} is one value, the mean of the cuts: cuts of one {study.who} are alike, and intervals "
            f"over cuts would be too narrow. P is the probability that one of group {first} has a larger mean than one "
            f"of group {second}: 0.5 is no separation, 0 and 1 are full. In marked rows the interval excludes 0.5."
        ),
        html_table(f"{first} against {second}, 95 % intervals", heads, rows),
        picture(
            partial(groups_figure, study),
            f"Means of {study.who}s by group, a panel for each metric",
            escaped(f"A mark for each {study.who}'s mean; the line is the group's. P with its 95 % interval below."),
        ),
    )


def _reliability(study: Study) -> Html:
    retest = any(isinstance(found.retest, Intraclass) for found in study.findings)
    heads = ["metric", "one cut", f"mean of {_an(study.who)}'s cuts", "cuts for 0.8"]
    heads += ["sessions, agreement", "sessions, consistency"] if retest else []
    rows = []
    for found in study.findings:
        if isinstance(found.reliability, NotEstimable):
            cells = [_said(found.reliability.reason), escaped(""), escaped("")]
        else:
            told = found.reliability
            cells = [_correlation(told.single), _correlation(told.mean), escaped(cuts_needed(told))]
        if retest and isinstance(found.retest, Intraclass):
            cells += [_correlation(found.retest.agreement), _correlation(found.retest.consistency)]
        elif retest:
            assert isinstance(found.retest, NotEstimable)
            cells += [_said(found.retest.reason), escaped("")]
        rows.append(Row([_named(found), *cells]))
    parts = [
        paragraph(
            f"Share of the variance that is between {study.who}s, by one-way analysis of variance: of one cut, and of "
            f"{_an(study.who)}'s mean. 1 is a metric that is always the same for the same {study.who}, 0 one that "
            "does not distinguish them; below 0 is chance. Beside it the number of cuts whose mean would reach 0.8."
            + " Groups that differ add to it: within one group it is less."
            * (study.groups is not None)
        ),
        html_table("Intraclass correlations, 95 % intervals", [escaped(head) for head in heads], rows),
    ]
    if any(isinstance(found.reliability, OneWay) for found in study.findings):
        parts.append(
            picture(
                partial(reliability_figure, study),
                "Intraclass correlations of every metric with their intervals",
                escaped("Intervals by the F distribution; an end below -1 is drawn at -1."),
            )
        )
    return joined(*parts)


def _learning(study: Study) -> Html:
    parts = [
        paragraph(
            f"Above, each {study.who}'s cuts and their mean. Below, the learning curve CUSUM: every {study.who} begins "
            "at 0, taken to be one standard deviation of single cuts beyond the target; cuts at the target let the sum "
            "grow, worse ones let it fall. Where it passes the line the target counts as reached (a dot): after 8 cuts "
            "on average for one that is there, and by mistake once in 335 cuts for one that is not."
        )
    ]
    for found in study.findings:
        about = METRICS[found.metric]
        changes = " ".join(_change(group, curve, found) for group, curve in found.curves.items())
        parts.append(element("h3", Html(f"{_named(found)}")))
        parts.append(paragraph(f"{about.meaning} ({about.formula}; {_BETTER[about.direction]}.) {changes}".rstrip()))
        parts.append(
            picture(
                partial(learning_figure, study, found),
                f"{_spoken(found.metric)} by number of the cut, and its learning curve CUSUM",
                escaped(_caption(found)),
            )
        )
        parts.append(folded(f"{_spoken(found.metric)} of every {study.who}", _people(study, found)))
    return joined(*parts)


def _people(study: Study, found: Findings) -> Html:
    sums = found.cusums if isinstance(found.cusums, Mapping) else {}
    heads = [study.who, *(["group"] if study.groups else []), "cuts", "mean", "SD", "first", "last", "reached", "left"]
    rows = []
    for operator, values in found.series.items():
        cusum = sums.get(operator)
        cells = [
            *([study.group_of[operator]] if study.groups else []),
            str(len(values)),
            three_digits(float(values.mean())),
            "" if len(values) < 2 else three_digits(float(values.std(ddof=1))),
            three_digits(float(values[0])),
            three_digits(float(values[-1])),
            "" if cusum is None else str(cusum.reached_at or "no"),
            "" if cusum is None else str(cusum.left_at or "no"),
        ]
        rows.append(Row([escaped(operator), *(escaped(cell) for cell in cells)]))
    caption = "Reached, left: number of the cut at which the sums signal that the target is reached, or left again"
    return html_table(f"{_spoken(found.metric)}{_in_unit(found)}. {caption}", [escaped(head) for head in heads], rows)


def _caption(found: Findings) -> str:
    target = f"Target {three_digits(found.target)}{_unit(found)} ({found.target_is})"
    if isinstance(found.cusums, NotEstimable):
        return f"{target}. No cumulative sums: {found.cusums.reason}."
    reached = sum(each.reached_at is not None for each in found.cusums.values())
    deviation = f"standard deviation of single cuts {three_digits(found.scale)}{_unit(found)}"
    return f"{target}; {deviation}. {reached} of {len(found.cusums)} reach it."


def _change(group: str, curve: LearningCurve | NotEstimable, found: Findings) -> str:
    if isinstance(curve, NotEstimable):
        return ""
    change = Estimate(value=float(curve.change[-1]), low=float(curve.change_low[-1]), high=float(curve.change_high[-1]))
    open_ = ", an interval that holds 0" if change.low <= 0.0 <= change.high else ""
    return (
        f"{_of(group)} the first cut to number {curve.number[-1]} ({curve.people[-1]} of them, paired) it changes by "
        f"{three_digits(change.value)}{_unit(found)} "
        f"({three_digits(change.low)} to {three_digits(change.high)}){open_}."
    )


def _meaning(study: Study) -> Html:
    entries = [
        ("Metrics", "cutenv.scoring: functions of one cut. Without a reference set they make no claim of skill."),
        (
            "ICC",
            "Intraclass correlation. McGraw & Wong 1996; Thomas & Hultquist 1978 for unequal numbers of cuts. The "
            "spread within is taken to be alike for all, and about normal.",
        ),
        (
            "Agreement, consistency",
            "Of session means: a shift of everybody between sessions (learning) counts against agreement, and not "
            "against consistency.",
        ),
        ("P", "Probability of superiority, Mann-Whitney's U over mn, the area under the ROC curve. Newcombe 2006."),
        ("Hedges' g", f"Difference of the groups' means over the standard deviation between their {study.who}s."),
        ("Learning curve CUSUM", "Biau & Porcher 2010, one-sided: slack 0.5, threshold 4 standard deviations."),
        ("Left", "Page's CUSUM, the other way round: cuts are worse than the target by more than half a deviation."),
        ("Target", "What the sums are taken against; it is a level of this study, not of skill, unless it was given."),
    ]
    return joined(definitions(entries), paragraph(DISCLAIMER))


def _holds(told: Separation | NotEstimable, value: float) -> bool:
    return isinstance(told, Separation) and told.superiority.low <= value <= told.superiority.high


def _larger(apart: list[Findings], group: str, is_first: bool) -> str:
    """Return a sentence that names the metrics that are larger in a group; "" if there are none."""
    names = [
        _spoken(each.metric)
        for each in apart
        if isinstance(each.separation, Separation) and (each.separation.superiority.value > 0.5) is is_first
    ]
    return f"Larger in {group}: {', '.join(names)}." if names else ""


def _of(group: str) -> str:
    return f"In {group}, from" if group else "From"


def _an(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _named(found: Findings) -> Html:
    unit = f' <span class="unit">[{escaped(typeset(found.unit))}]</span>' if found.unit != "1" else ""
    return Html(f"{escaped(_spoken(found.metric))}{unit}")


def _spoken(metric: str) -> str:
    return metric.replace("_", " ")


def _unit(found: Findings) -> str:
    return "" if found.unit == "1" else f" {typeset(found.unit)}"


def _in_unit(found: Findings) -> str:
    return "" if found.unit == "1" else f" [{typeset(found.unit)}]"


def _cell(each: Estimate, digits: int) -> Html:
    interval = f"[{number(each.low, digits)}, {number(each.high, digits)}]"
    return Html(f'{number(each.value, digits)} <span class="interval">{interval}</span>')


def _correlation(each: Estimate) -> Html:
    interval = f"[{correlation(each.low)}, {correlation(each.high)}]"
    return Html(f'{escaped(correlation(each.value))} <span class="interval">{escaped(interval)}</span>')


def _said(reason: str) -> Html:
    return Html(f'<span class="interval" style="white-space:normal">{escaped(reason)}</span>')


def _interval(each: Estimate, digits: int) -> str:
    return f"{number(each.value, digits)} ({number(each.low, digits)} to {number(each.high, digits)})"
