"""Overview of a class: everybody with cuts and progress, and a learning curve of each class."""

from __future__ import annotations

from typing import Any, NamedTuple

from cutenv.classroom.class_store import SAVED, HandedOutCut, MarkInForce, Place
from cutenv.classroom.lesson import Lesson
from cutenv.classroom.score_curve import score_curve
from cutenv.scoring.study import proficiency


def overview(lesson: Lesson, language: str) -> dict[str, Any]:
    """Return what the list of the class shows, in a language: people, a curve for each class, and the pass mark."""
    mark, places = lesson.pass_mark, lesson.store.places()
    rows = [_shown(lesson, language, mark, places.get(each.code, Place()), each) for each in people_of(lesson)]
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


class Person(NamedTuple):
    """Code of a person, True if they consented, and their cuts."""

    code: str
    consented: bool
    cuts: list[HandedOutCut]


def people_of(lesson: Lesson) -> list[Person]:
    """Return everybody with their cuts."""
    by_code: dict[str, list[HandedOutCut]] = {}
    for cut in lesson.store.cuts():
        by_code.setdefault(cut.code, []).append(cut)
    return [Person(code, consented, by_code.get(code, [])) for code, consented in lesson.store.codes()]


def _shown(lesson: Lesson, language: str, mark: MarkInForce | None, place: Place, person: Person) -> dict[str, Any]:
    progress = lesson.progress(person.code)
    confirmed = [cut.score for cut in person.cuts if cut.state == SAVED]
    scored = [score for score in confirmed if score is not None]
    found = proficiency(scored, mark.mark, better="higher") if mark is not None and scored else None
    return {
        **person._asdict(),
        "place": place,
        "scores": confirmed,
        "passes": found,
        "curve": score_curve([confirmed], mark=None if mark is None else mark.mark) if confirmed else "",
        "ahead": "" if progress is None else progress.ahead(language),
    }
