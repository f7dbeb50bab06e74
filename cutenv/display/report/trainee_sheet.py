"""Sheet of each trainee of a study, and class list, to print."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv.display.report.page import PHONE_WIDTH, label, new_figure, number, plain_axes, write_page, write_table
from cutenv.records.scoring.score_card import DISCLAIMER, ScoreCard, whole_score
from cutenv.records.scoring.study import Proficiency, StudiedCut, Study, proficiency
from cutenv.records.scoring.study.learning import RECENT, mean_points, next_tries, outcome_counts
from cutenv.records.scoring.study.pass_mark import IN_A_ROW
from cutenv.records.scoring.study.study import OVERALL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OWN, _CLASS = "#0072b2", "0.55"
_FEWEST_OF_CLASS = 3  # people whose mean shows nobody


def write_trainee_sheet(
    folder: Path, study: Study, operator: str, *, mark: float | None = None, language: str = "en"
) -> Path:
    """Write a person's sheet, called after the code; return its path."""
    own = [cut for cut in study.cuts if cut.operator == operator]
    cards = [cut.card for cut in own]
    rest = mean_points([cut.card for cut in study.cuts])
    people = len(study.operators)
    path = folder / f"{operator}.html"
    write_page(
        path,
        "trainee_sheet.html",
        language=language,
        operator=operator,
        subtitle=_subtitle(study, own),
        headline=_headline(study, operator, mark),
        recent=min(RECENT, len(cards)),
        tries=next_tries(cards),
        parts=[
            (part, points, most, number(rest[part][0], 1) if people >= _FEWEST_OF_CLASS else "")
            for part, (points, most) in mean_points(cards[-RECENT:]).items()
        ],
        of_class=people >= _FEWEST_OF_CLASS,
        history=[
            (k, None if isinstance(cut, str) else cut, "" if isinstance(cut, str) else _score(cut.card))
            for k, cut in _attempts(study, operator)
        ],
        scored=any(card.overall_score is not None for card in cards),
        sheet_figure=sheet_figure,
        study=study,
        mark=mark,
        disclaimer=DISCLAIMER,
    )
    return path


def write_class_list(
    folder: Path, study: Study, *, mark: float | None = None, language: str = "en"
) -> tuple[Path, Path]:
    """Write ``class.html`` and ``class.csv``, in English, into a folder; return the paths."""
    rows = [_row(study, operator, mark) for operator in study.operators]
    page, table = folder / "class.html", folder / "class.csv"
    write_table(table, [list(rows[0]), *(list(row.values()) for row in rows)])
    scores = [cut.card.overall_score for cut in study.cuts if cut.card.overall_score is not None]
    mean = f", mean score {number(float(np.mean(scores)), 0)}" if scores else ""
    passing = "" if mark is None else f" Pass mark: {mark:g}, and {IN_A_ROW} passes in a row are proficiency."
    write_page(
        page,
        "class_list.html",
        language=language,
        name=study.name,
        subtitle=f"{len(study.cuts)} cuts of {len(rows)} people{mean}.{passing}",
        rows=rows,
        disclaimer=DISCLAIMER,
    )
    return page, table


def sheet_figure(study: Study, operator: str, mark: float | None, width: float) -> Figure:
    """Draw one person's scores, success filled, above class mean and mark."""
    own = [cut.card for cut in study.cuts if cut.operator == operator]
    figure = new_figure(width, 2.6)
    axes = figure.subplots()
    plain_axes(axes)
    if len(study.operators) >= _FEWEST_OF_CLASS:
        by_number = _by_number(study)
        name = f"mean of {len(study.operators)} people" if by_number else None  # a legend of what is drawn
        axes.plot(range(1, len(by_number) + 1), by_number, color=_CLASS, linewidth=2.0, label=name)
    score = np.array([np.nan if card.overall_score is None else card.overall_score for card in own])
    at = np.array([k for k, cut in _attempts(study, operator) if not isinstance(cut, str)])
    succeeded = np.array([card.outcome.startswith("success") for card in own])
    axes.plot(at, score, color=_OWN, linewidth=1.2, label=label(operator))
    for chosen, filled, name in ((succeeded, "full", "success"), (~succeeded, "none", "no success")):
        if chosen.any() and any(card.outcome for card in own):
            axes.plot(at[chosen], score[chosen], "o", color=_OWN, markersize=7, fillstyle=filled, label=name)
    if mark is not None:
        axes.axhline(mark, color="black", linestyle="--", linewidth=1.2, label=f"pass mark {mark:g}")
    axes.set_ylim(0.0, 102.0)
    axes.set_xlim(0.6, max(int(at[-1]), 2) + 0.4)
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("number of the cut")
    axes.set_ylabel("overall score")
    figure.legend(loc="outside upper left", ncols=2 if width < PHONE_WIDTH else 5, frameon=False, fontsize=9)
    return figure


def _attempts(study: Study, operator: str) -> list[tuple[int, StudiedCut | str]]:
    """Return a person's numbered cuts; for an abandoned cut, the person's code."""
    return [(k, cut) for k, cut in study.attempts() if operator == (cut if isinstance(cut, str) else cut.operator)]


def _by_number(study: Study) -> list[float]:
    """Return mean scores by cut number, where enough people made it."""
    return class_means(
        [
            [None if isinstance(cut, str) else cut.card.overall_score for _, cut in _attempts(study, each)]
            for each in study.operators
        ]
    )


def class_means(people: Sequence[Sequence[float | None]]) -> list[float]:
    """Return mean scores by cut number while three people or more remain."""
    means: list[float] = []
    for there in zip_longest(*people):
        scores = [score for score in there if score is not None]
        if len(scores) < _FEWEST_OF_CLASS:
            break
        means.append(float(np.mean(scores)))
    return means


def _subtitle(study: Study, own: Sequence[StudiedCut]) -> str:
    days = sorted({cut.date[:10] for cut in own if cut.date})
    when = "" if not days else f", {days[0]}" + (f" to {days[-1]}" if len(days) > 1 else "")
    many = f"{len(own)} cut{'s' * (len(own) > 1)}"
    left = len(study.left.get(own[0].operator, ()))
    many += f", {left} more begun and left" if left else ""
    group = f", group {own[0].group}" if own[0].group else ""
    return f"{study.name}{group}: {many}{when}"


def _headline(study: Study, operator: str, mark: float | None) -> str:
    cards = [cut.card for cut in study.cuts if cut.operator == operator]
    scores = [card.overall_score for card in cards if card.overall_score is not None]
    if not scores:
        return f"No overall score: {cards[-1].no_score}."
    last = scores[-RECENT:]
    said = [f"Last score {number(scores[-1], 0)} of 100"]
    said += [f"mean of the last {len(last)} cuts {number(float(np.mean(last)), 0)}"] if len(scores) > 1 else []
    said += [f"best {number(max(scores), 0)}"] if len(scores) > 1 else []
    counts = outcome_counts(cards)
    succeeded = f" {counts['success']} of {sum(counts.values())} cuts succeeded." if counts else ""
    return f"{', '.join(said)}.{succeeded}{_passes(study, operator, scores, mark)}"


def _passes(study: Study, operator: str, scores: Sequence[float], mark: float | None) -> str:
    if mark is None:
        return ""
    own = _proficiency(study, operator, scores, mark)
    row = "not yet" if own.reached_at is None else f"reached with cut {own.reached_at}"
    return f" {own.passes} of {own.cuts} pass at {mark:g}; {IN_A_ROW} in a row: {row}."


def _proficiency(study: Study, operator: str, scores: Sequence[float], mark: float) -> Proficiency:
    """Return a person's passes by the rounded scores; a left cut passes none."""
    left = study.left_among(OVERALL).get(operator, ())
    return proficiency([whole_score(score) for score in scores], mark, better="higher", left=left)


def _row(study: Study, operator: str, mark: float | None) -> dict[str, Any]:
    cards = [cut.card for cut in study.cuts if cut.operator == operator]
    scores = [card.overall_score for card in cards if card.overall_score is not None]
    row: dict[str, Any] = {study.who: operator}
    if any(study.group_of.values()):
        row["group"] = study.group_of[operator]
    row |= {
        "cuts": len(cards),
        **({"begun and left": len(study.left.get(operator, ()))} if any(study.left.values()) else {}),
        "last score": number(scores[-1], 0) if scores else "",
        "mean": number(float(np.mean(scores)), 0) if scores else "",
        "best": number(max(scores), 0) if scores else "",
    }
    for name in ("success", "missed", "beyond a limit"):
        row[name] = outcome_counts(cards).get(name, "")
    if mark is not None:
        own = _proficiency(study, operator, scores, mark) if scores else None
        row["passes"] = "" if own is None else own.passes
        row["proficient at cut"] = "" if own is None else own.reached_at or "not yet"
    return row


def _score(card: ScoreCard) -> str:
    return "" if card.overall_score is None else number(card.overall_score, 0)
