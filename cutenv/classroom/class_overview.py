"""Overview of a class: everybody with cuts and progress, and learning curves as drawings in the page's own colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from cutenv._base.document import texts_by_key
from cutenv.classroom.class_store import HandedOutCut, MarkInForce, Place
from cutenv.classroom.class_tables import LEFT, SAVED
from cutenv.classroom.lesson import Lesson
from cutenv.scoring.study import proficiency

_WIDTH, _HEIGHT, _LEFT, _BELOW, _ABOVE = 400.0, 170.0, 30.0, 22.0, 8.0
_FEWEST_OF_CLASS = 3  # people whose mean shows nobody

Scores = Sequence[int | None]
"""Score of each of a person's cuts, in order; None where a cut has none."""


def score_curve(people: Sequence[Scores], *, mark: float | None = None, label: str = "") -> str:
    """Return an SVG of one person's scores, or of those of several, thin, with their mean.

    Parameters
    ----------
    people : sequence of sequence of int or None
        Scores of each person's cuts; of one person every cut is a point.
    mark : float, optional
        Pass mark, a dashed line.
    label : str
        Description for a screen reader, without characters that mean something in XML.

    Returns
    -------
    str
        The drawing; "" if nobody has a score.
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


def class_means(people: Sequence[Scores]) -> list[float | None]:
    """Return the mean score by the number of the cut, as far as three people or more made it."""
    means: list[float | None] = []
    for k in range(max(map(len, people), default=0)):
        there = [score for scores in people if k < len(scores) and (score := scores[k]) is not None]
        if len(there) < _FEWEST_OF_CLASS:
            break
        means.append(sum(there) / len(there))
    return means


def overview(lesson: Lesson, language: str) -> dict[str, Any]:
    """Return what the list of the class shows, in a language: people, a curve for each class, and the pass mark."""
    mark, places = lesson.pass_mark, lesson.store.places()
    rows = [_shown(lesson, language, mark, places.get(each.code, Place()), each) for each in people_of(lesson)]
    score_word = texts_by_key(language)["score"]
    classes = sorted({row["place"].class_name for row in rows})
    curves = {
        name: score_curve(
            [row["scores"] for row in rows if row["place"].class_name == name and row["scores"]],
            mark=None if mark is None else mark.mark,
            label=f"{score_word}, {name}" if name else score_word,
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
    progress = lesson.progress(person.code, person.cuts)
    confirmed = [cut.score for cut in person.cuts if cut.state == SAVED]
    made = [0 if cut.state == LEFT else cut.score for cut in person.cuts if cut.state in (SAVED, LEFT)]
    scored = [score for score in made if score is not None]
    label = f"{texts_by_key(language)['score']}, {person.code}"
    found = proficiency(scored, mark.mark, better="higher") if mark is not None and scored else None
    return {
        **person._asdict(),
        "place": place,
        "scores": confirmed,
        "passes": found,
        "curve": score_curve([confirmed], mark=None if mark is None else mark.mark, label=label) if confirmed else "",
        "ahead": "" if progress is None else progress.ahead(language),
        "unread": [] if progress is None else progress.unread,
    }
