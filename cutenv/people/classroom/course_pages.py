"""Page on which the teacher edits a course, and its form."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from typing import Any
from urllib.parse import quote

from starlette.datastructures import FormData
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from cutenv.agents.policy import ORACLE, experts
from cutenv.people.classroom.class_courses import COURSE_FILE
from cutenv.people.classroom.class_site import Pages, download, text_of
from cutenv.people.classroom.lesson import name_of
from cutenv.people.play.course import (
    FEEDBACK,
    MARKED_METRICS,
    SHIPPED_COURSES,
    Course,
    course_content,
    course_of,
    course_toml,
    course_words,
    named_course,
    task_content,
)
from cutenv.sim.tissue.drawn_lines import KINDS
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.registry import tasks_with

NEW = "+"
"""Key of a further course that is not kept yet; no course's file is called so."""
_EMPTY: Mapping[str, Any] = {"name": "", "about": "", "warm_up": 0, "demonstration": False}
_MOST_TASKS, _MARKS = 50, 3
_WHOLE, _NUMBER = re.compile(r"[+-]?\d{1,12}"), re.compile(r"[+-]?\d{1,12}([.,]\d{1,9})?")


class CoursePages(Pages):
    """Pages and answers for the course."""

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route = self._site.teachers_route
        return [
            route("GET", "/teacher/course", self.edit),
            route("POST", "/teacher/course", self.keep, max_fields=20 * _MOST_TASKS),
            route("GET", f"/teacher/{COURSE_FILE}", self.file),
        ]  # fmt: skip

    def page(self, content: Mapping[str, Any], key: str = "", trouble: str = "") -> Response:
        """Return the page, filled with a course file's content if any.

        ``key`` is that of a further course, :data:`NEW` for one that has none yet, or "" for that of the class.
        """
        courses = self._lesson.courses
        language = self._site.language
        tasks = [_shown(task) for task in content.get("task", [])]
        return self._site.page(
            "teacher_course.html", 422 if trouble else 200, trouble=trouble, content=dict(_EMPTY) | dict(content),
            tasks=[*tasks, _shown({})], root="../", kinds=tasks_with("hand"), classes=CLASSES,
            lines=(*KINDS, "mixed"), rules={rule: course_words(language, rule) for rule in FEEDBACK},
            metrics=_metrics(language), edited=key != NEW and courses.file(key).is_file(), key=key, new=NEW,
            further=courses.further(), course_name=name_of(courses.main),
            agents={kind: [name for name in experts(kind) if name != ORACLE] for kind in tasks_with("hand")},
            shipped={name: named_course(name).name for name in SHIPPED_COURSES},
        )  # fmt: skip

    def edit(self, request: Request, _: FormData) -> Response:
        """Show the course, or one that is shipped, to be edited."""
        chosen = request.query_params.get("from", "")
        key = self._key(request.query_params.get("course", ""))
        present = None if key == NEW else self._lesson.courses.of(key)
        course = named_course(chosen) if chosen in SHIPPED_COURSES else present
        return self.page({} if course is None else _content(course), key)

    def _key(self, given: str) -> str:
        """Return the key of an existing course; LookupError for another."""
        if given not in ("", NEW) and given not in self._lesson.courses.further():
            raise LookupError("There is no such course.")
        return given

    def keep(self, _: Request, form: FormData) -> Response:
        """Put the form's course into force, or withdraw it."""
        key, courses = self._key(text_of(form, "course")), self._lesson.courses
        if form.get("do") == "withdraw":
            self._lesson.drop_course(key)
            return RedirectResponse("course", 303)
        content = _content_of(form)
        if form.get("do") == "add":
            return self.page(content, key)
        try:
            course = course_of(content)
            kept_as = courses.new_key(course.name) if key == NEW else key
            courses.set(course, kept_as)
        except (TypeError, ValueError) as error:
            return self.page(content, key, str(error))
        return RedirectResponse(f"course?course={quote(kept_as)}" if kept_as else "course", 303)

    def file(self, request: Request, _: FormData) -> Response:
        """Send the course as its file."""
        key = request.query_params.get("course", "")
        course = self._lesson.courses.of(self._key(key)) if key != NEW else None
        if course is None:
            raise LookupError("There is no course.")
        return download(course_toml(course).encode(), self._lesson.courses.file(key).name, "application/toml")


def _content(course: Course) -> dict[str, Any]:
    return course_content(course) | {"task": [task_content(task) for task in course.tasks]}


def _metrics(language: str) -> dict[str, str]:
    return {
        key: f"{course_words(language, about.name)}{'' if about.unit.sign == '1' else f' [{about.unit.sign}]'} "
        + ("≥" if about.more else "≤")
        for key, about in MARKED_METRICS.items()
    }


def _shown(task: Mapping[str, Any]) -> dict[str, Any]:
    """Return a task for its form fields: seeds as text, marks as pairs."""
    marks: list[tuple[str, Any]] = [(key, _plain(limit)) for key, limit in task.get("mark", {}).items()]
    shown = dict.fromkeys(_FIELDS, "") | {key: _plain(value) for key, value in task.items()}
    shown["seeds"] = ", ".join(map(str, task.get("seeds", ())))
    return shown | {"marks": marks + [("", "")] * max(_MARKS - len(marks), 1)}


def _moment(text: str) -> datetime | str:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return text


def _plain(value: Any) -> Any:
    if isinstance(value, datetime):
        return f"{value.astimezone():%Y-%m-%dT%H:%M}"
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _content_of(form: FormData) -> dict[str, Any]:
    """Return a form as course file content; invalid numbers stay text, refused later."""
    tasks = []
    for k in range(_MOST_TASKS):
        given = {name: text_of(form, f"{k}-{name}").strip() for name in ("name", "place", "task", "line", *_TEXTS)}
        if not given["name"] or form.get(f"{k}-drop"):
            continue
        task: dict[str, Any] = {"name": given["name"]}
        task |= {name: given[name] for name in ("specimen_class", "feedback") if given[name]}
        kind = given["task"] or "gentle"
        task |= {} if kind == "gentle" else {"task": kind}
        task |= {"line": given["line"]} if kind == "path" and given["line"] else {}
        task |= {name: _number(given[name]) for name in _NUMBERS if given[name]}
        task |= {name: _moment(given[name]) for name in ("opens", "closes") if given[name]}
        if given["seeds"]:
            task["seeds"] = [_number(seed) for seed in re.split(r"[,;\s]+", given["seeds"].strip(",; "))]
        names, limits = form.getlist(f"{k}-mark"), form.getlist(f"{k}-limit")
        mark = {str(name): _number(str(limit).strip()) for name, limit in zip(names, limits, strict=False) if name}
        task |= {"mark": mark} if mark else {}
        task |= {"expert": given["expert"]} if given["expert"] else {}
        task |= {"crossover": True} if form.get(f"{k}-crossover") else {}
        place = _number(given["place"])
        tasks.append((place if isinstance(place, int | float) else k + 1, k, task))
    ordered = [task for *_, task in sorted(tasks, key=lambda each: each[:2])]
    before: dict[str, Any] = {"demonstration": True} if form.get("demonstration") else {}
    before |= {"warm_up": _number(warm_up)} if (warm_up := text_of(form, "warm_up").strip()) else {}
    return {"name": text_of(form, "name").strip(), "about": text_of(form, "about").strip(), **before, "task": ordered}


_FIELDS = (
    "name", "task", "line", "specimen_class", "feedback", "target_length_mm", "repetitions", "crossover", "attempts",
    "expert", "opens", "closes",
)  # fmt: skip
_NUMBERS = ("target_length_mm", "repetitions", "attempts")
_TEXTS = ("expert", "specimen_class", "feedback", "seeds", "opens", "closes", *_NUMBERS)


def _number(text: str) -> int | float | str:
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text.replace(",", ".")) if _NUMBER.fullmatch(text) else text
