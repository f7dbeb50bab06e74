"""Result of a cut as the page shows it: score and points, whether it passes, and what comes next in the course."""

from __future__ import annotations

import dataclasses
from typing import Any

from cutenv.classroom.class_store import MarkInForce
from cutenv.play.course_progress import CourseProgress
from cutenv.play.course_words import COURSE_WORDS
from cutenv.scoring import ScoreCard
from cutenv.scoring.score_card import whole_score


def shown_card(
    card: ScoreCard, progress: CourseProgress | None, *, hidden: bool = False, mark: MarkInForce | None = None
) -> dict[str, Any]:
    """Return what the page shows of a card, whether it passes the ``mark``, and what comes next.

    Of a card that is to be ``hidden`` nothing is shown but whether it passes.
    """
    overall = None if card.overall_score is None else whole_score(card.overall_score)  # what is shown decides
    return {
        "pass_mark": None if mark is None else mark.mark,
        "passed": None if mark is None or overall is None else overall >= mark.mark,
        "score": None if hidden else overall,
        "outcome": "" if hidden else card.outcome,
        "points": [] if hidden else [dataclasses.asdict(each) for each in card.points],
        "verdict": {} if progress is None else progress.verdicts,
        "ahead": ahead_words(progress),
        "done": progress is not None and progress.task is None,
    }


def ahead_words(progress: CourseProgress | None) -> dict[str, str]:
    """Return what comes next in a course, by language; empty without a course."""
    return {} if progress is None else {language: progress.ahead(language) for language in COURSE_WORDS}
