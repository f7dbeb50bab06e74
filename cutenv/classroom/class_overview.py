"""Overview of a class: everybody with cuts and progress, and a learning curve of each class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cutenv.classroom.class_store import SAVED, HandedOutCut, MarkInForce, Place
from cutenv.classroom.lesson import Lesson
from cutenv.classroom.score_curve import score_curve
from cutenv.scoring.study import proficiency


def overview(lesson: Lesson, language: str) -> dict[str, Any]:
    """Return what the list of the class shows, in a language: people, a curve for each class, and the pass mark."""
    mark, places = lesson.pass_mark, lesson.store.places()
    rows = [_person(lesson, language, mark, places.get(each[0], Place()), *each) for each in people_of(lesson)]
    classes = sorted({row["place"].class_name for row in rows})
    curves = {
        name: score_curve(
            [row["scores"] for row in rows if row["place"].class_name == name and row["scores"]],
            mark=None if mark is None else mark.mark,
        )
        for name in classes
    }
    return {"people": rows, "mark": mark, "course": lesson.course_name} | {
        "curves": {name: curve for name, curve in curves.items() if curve}
    }


def people_of(lesson: Lesson) -> list[tuple[str, bool, list[HandedOutCut]]]:
    """Return everybody's code, whether they consented, and their cuts."""
    by_code: dict[str, list[HandedOutCut]] = {}
    for cut in lesson.store.cuts():
        by_code.setdefault(cut.code, []).append(cut)
    return [(code, consented, by_code.get(code, [])) for code, consented in lesson.store.codes()]


def _person(
    lesson: Lesson,
    language: str,
    mark: MarkInForce | None,
    place: Place,
    code: str,
    consented: bool,
    cuts: Sequence[HandedOutCut],
) -> dict[str, Any]:
    progress = lesson.progress(code)
    confirmed = [cut.score for cut in cuts if cut.state == SAVED]
    scored = [score for score in confirmed if score is not None]
    found = proficiency(scored, mark.mark, better="higher") if mark is not None and scored else None
    return {
        "code": code,
        "consented": consented,
        "cuts": cuts,
        "place": place,
        "scores": confirmed,
        "passes": found,
        "curve": score_curve([confirmed], mark=None if mark is None else mark.mark) if confirmed else "",
        "ahead": "" if progress is None else progress.ahead(language),
    }
