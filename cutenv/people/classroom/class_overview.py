"""Overview of a class: people, progress, and learning curves as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any, NamedTuple

from cutenv._base.language_files import texts_by_key
from cutenv._base.validation import one_of
from cutenv.display.report.trainee_sheet import class_means
from cutenv.people.classroom.class_store import HandedOutCut, MarkInForce, Place
from cutenv.people.classroom.class_tables import GOING_ON, LEFT, OPEN, SAVED, TAKEN_BACK
from cutenv.people.classroom.lesson import LONGEST_CUT, Lesson, name_of
from cutenv.people.play.course import WARM_UP
from cutenv.records.scoring.study import proficiency

_WIDTH, _HEIGHT, _LEFT, _BELOW, _ABOVE = 400.0, 170.0, 30.0, 22.0, 8.0

Scores = Sequence[int | None]
"""Score of each of a person's cuts, in order; None where a cut has none."""


def score_curve(people: Sequence[Scores], *, mark: float | None = None, label: str = "") -> str:
    """Return an SVG of one person's scores, or several with mean.

    Of one person every cut is a point; the mark is a dashed line. The label, for a screen reader, has no characters
    that mean something in XML. It is "" without any score.
    """
    longest = max((len(scores) for scores in people), default=0)
    if not any(score is not None for scores in people for score in scores):
        return ""
    right = max(longest, 2)

    def x(number: int) -> float:
        return _LEFT + 8 + (_WIDTH - _LEFT - 18) * (number - 1) / (right - 1)

    def y(score: float) -> float:
        return _ABOVE + (_HEIGHT - _ABOVE - _BELOW) * (1.0 - score / 100.0)

    def line(scores: Sequence[float | None], style: str) -> str:
        points = [(x(k), y(score)) for k, score in enumerate(scores, 1) if score is not None]
        drawn = " ".join(f"{at:.1f},{up:.1f}" for at, up in points)
        return f'<polyline points="{drawn}" fill="none" {style}/>' if len(points) > 1 else ""

    parts = []
    for score in (0, 50, 100):
        parts.append(f'<path d="M{_LEFT} {y(score):.1f}H{_WIDTH}" stroke="currentColor" stroke-opacity="0.2"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y(score) + 4:.1f}" text-anchor="end">{score}</text>')
    ticks = range(1, longest + 1, -(-longest // 8))
    parts += [f'<text x="{x(k):.1f}" y="{_HEIGHT - 6:.1f}" text-anchor="middle">{k}</text>' for k in ticks]
    if mark is not None:
        dashed = 'stroke="currentColor" stroke-dasharray="5 4"'
        parts.append(f'<path class="mark" d="M{_LEFT} {y(mark):.1f}H{_WIDTH}" {dashed}/>')
    if len(people) == 1:
        parts.append(line(people[0], 'stroke="var(--accent)" stroke-width="1.5"'))
        parts += [
            f'<circle cx="{x(k):.1f}" cy="{y(score):.1f}" r="3.5" fill="var(--accent)"/>'
            for k, score in enumerate(people[0], 1)
            if score is not None
        ]
    else:
        parts += [line(scores, 'stroke="currentColor" stroke-opacity="0.35"') for scores in people]
        parts += [
            f'<circle cx="{x(1):.1f}" cy="{y(only):.1f}" r="2" fill="currentColor" fill-opacity="0.35"/>'
            for scores in people
            if len(scores) == 1 and (only := scores[0]) is not None
        ]
        parts.append(line(class_means(people), 'class="mean" stroke="var(--accent)" stroke-width="2.5"'))
    about = f'viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" fill="currentColor" font-size="12" role="img" aria-label="{label}"'
    return f'<svg class="curve" {about}>{"".join(parts)}</svg>'


def overview(lesson: Lesson, language: str) -> dict[str, Any]:
    """Return the class list's content in a language: people, curves, pass marks."""
    marks, places = marks_in_force(lesson), lesson.store.places()
    rows = [_shown(lesson, language, marks, places.get(each.code, Place()), each) for each in people_of(lesson)]
    score_word = texts_by_key(language)["score"]
    classes = sorted({row["place"].class_name for row in rows})
    curves = {}
    for name in classes:
        its = [row for row in rows if row["place"].class_name == name]
        only = only_of(row["mark"] for row in its)
        curves[name] = score_curve(
            [row["scores"] for row in its if row["scores"]],
            mark=None if only is None else only.mark,
            label=f"{score_word}, {name}" if name else score_word,
        )
    return {
        "people": rows,
        "marks": {course: mark for course, mark in marks.items() if mark is not None},
        "course": any(row["course"] for row in rows),
        "further": lesson.courses.further(),
        "curves": {name: curve for name, curve in curves.items() if curve},
    }


def marks_in_force(lesson: Lesson) -> dict[str, MarkInForce | None]:
    """Return the pass mark, or None, of every course by name."""
    names = [name_of(lesson.course), *(course.name for course in lesson.courses.further().values())]
    return {name: lesson.store.pass_mark(name) for name in names}


def only_of(marks: Iterable[MarkInForce | None]) -> MarkInForce | None:
    """Return the mark common to all, or None."""
    different = set(marks)
    return different.pop() if len(different) == 1 else None


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


CUTTING, STALLED, LEFT_OFF, HERE, AWAY = "cutting", "stalled", "left off", "here", "away"
"""States of a person now: cuts; has begun a cut and sent none in its time; left one; is signed in; is not."""
_ORDER = (STALLED, CUTTING, LEFT_OFF, HERE, AWAY)
_GRACE = 15.0  # s beyond the longest cut, in which it is sent
_ATTENTION = {state: place for place, state in enumerate(_ORDER)}
LIVE_ORDERS = ("code", "class", "doing", "cuts", "score")
"""Keys by which the live list can be sorted."""


def live_list(
    lesson: Lesson, language: str, *, by: str = "code", class_name: str | None = None
) -> list[dict[str, Any]]:
    """Return what everybody does now, a row each.

    It is sorted by one of :data:`LIVE_ORDERS`; "doing" puts those first who may need help.
    """
    places, present = lesson.store.places(), lesson.store.present()
    rows = []
    for person in people_of(lesson):
        where = places.get(person.code, Place())
        if class_name is not None and where.class_name != class_name:
            continue
        saved = [cut for cut in person.cuts if cut.state == SAVED]
        progress = lesson.progress(person.code, person.cuts, where)
        doing, since = _doing(lesson, person, present)
        rows.append(
            {
                "code": person.code, "class": where.class_name, "course": name_of(lesson.course_of(person.code, where)),
                "doing": doing, "since": since, "cuts": len(saved),
                "score": saved[-1].score if saved else None, "last": saved[-1] if saved else None,
                "ahead": "" if progress is None else progress.ahead(language),
            }
        )  # fmt: skip
    keys = {
        "code": lambda row: row["code"],
        "class": lambda row: (row["class"], row["code"]),
        "doing": lambda row: (_ATTENTION[row["doing"]], row["code"]),
        "cuts": lambda row: (row["cuts"], row["code"]),
        "score": lambda row: (-1 if row["score"] is None else row["score"], row["code"]),
    }
    return sorted(rows, key=keys[one_of("by", by, LIVE_ORDERS)])


def _doing(lesson: Lesson, person: Person, present: Mapping[str, str]) -> tuple[str, float | None]:
    """Return a person's present activity, and its duration [s] or None."""
    made = [cut for cut in person.cuts if cut.state != TAKEN_BACK]
    open_cut = next((cut for cut in made if cut.state == GOING_ON), None)
    if open_cut is not None:
        for_long = (lesson.store.clock() - datetime.fromisoformat(open_cut.begun)).total_seconds()
        if person.code not in present:
            return LEFT_OFF, for_long
        return (CUTTING if for_long <= LONGEST_CUT / 1e3 + _GRACE else STALLED), for_long
    if person.code not in present:
        return AWAY, None
    ended = [cut for cut in made if cut.state not in OPEN]
    return (LEFT_OFF if ended and ended[-1].state == LEFT else HERE), None


def _shown(
    lesson: Lesson, language: str, marks: Mapping[str, MarkInForce | None], place: Place, person: Person
) -> dict[str, Any]:
    progress = lesson.progress(person.code, person.cuts, place)
    course = name_of(lesson.course_of(person.code, place))
    mark = marks.get(course)
    counted = [cut for cut in person.cuts if cut.task != WARM_UP]
    confirmed = [cut.score for cut in counted if cut.state == SAVED]
    made = [0 if cut.state == LEFT else cut.score for cut in counted if cut.state in (SAVED, LEFT)]
    scored = [score for score in made if score is not None]
    label = f"{texts_by_key(language)['score']}, {person.code}"
    found = proficiency(scored, mark.mark, better="higher") if mark is not None and scored else None
    return {
        **person._asdict(),
        "place": place,
        "course": course,
        "mark": mark,
        "scores": confirmed,
        "passes": found,
        "curve": score_curve([confirmed], mark=None if mark is None else mark.mark, label=label) if confirmed else "",
        "ahead": "" if progress is None else progress.ahead(language),
        "unread": [] if progress is None else progress.unread,
    }
