"""Progress of a person through a course, counted from the cuts made."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from cutenv._base.language_files import languages, local_moment
from cutenv._base.output import whole_files
from cutenv.people.play.course import WARM_UP, Course, CourseTask, course_name, course_words, marked_numbers
from cutenv.records import load_one, read_metadata
from cutenv.records.scoring import ScoreCard, score
from cutenv.task.registry import TASKS

GIVEN_UP = "given up"
"""End of a cut that the person abandoned: repeated, or the window closed."""


class CourseSpecimen(NamedTuple):
    """Class, seed, and target length [m] or None, of the next cut."""

    specimen_class: str
    seed: int
    target_length: float | None


class CourseProgress:
    """Progress of one person through a course.

    It says which task is next, and whether marks were reached. The person's cuts of this course are looked for in the
    folder of records, and scored again, by the marks that stand in the course now; without one, the cuts so far are
    those that :meth:`count` is told. Files that cannot be read stand in ``unread`` with the reasons, and do not count;
    ``verdicts`` say what the last cut of this session reached, in words of each language.
    """

    def __init__(
        self,
        course: Course,
        operator: str,
        folder: Path | None = None,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self.course = course.for_operator(operator)
        self.operator = operator
        self._clock = clock
        self.unread: list[str] = []
        self.verdicts: dict[str, str] = {}
        self._counted: dict[str, list[bool]] = {task.name: [] for task in self.course.tasks}
        self._begun = dict.fromkeys(self._counted, 0)  # cuts that did not count among them
        self._warmed = 0
        found = []
        for path in whole_files(folder.glob("*.csv")) if folder is not None and folder.is_dir() else ():
            try:
                facts = read_metadata(path)
                if self._is_ours(facts):
                    found.append((str(facts.get("date", "")), path.name, facts, score(load_one(path))))
            except (OSError, ValueError) as error:
                self.unread.append(str(error))
        for _, _, facts, card in sorted(found, key=lambda each: each[:2]):
            if facts["task"] == WARM_UP:
                self.skip(WARM_UP)
            else:
                self.count(facts["task"], marked_numbers(card), str(facts.get("end", "")))

    @property
    def task(self) -> CourseTask | None:
        """Present task: warm-up, then the first open one, else None."""
        task = self._unfinished
        warming = self._warmed < self.course.warm_up and not any(self._begun.values())
        return self.course.warm_up_task if warming and task is not None and not self.waits else task

    @property
    def _unfinished(self) -> CourseTask | None:
        return next((task for task in self.course.tasks if not self._is_over(task)), None)

    @property
    def fresh(self) -> bool:
        """True before the first cut of the course, a warm-up included."""
        return not self._warmed and not any(self._begun.values())

    @property
    def waits(self) -> bool:
        """True while the present task is not open yet."""
        task = self._unfinished
        return task is not None and task.opens is not None and self._clock() < task.opens

    def specimen(self) -> CourseSpecimen:
        """Return the specimen of the next cut.

        A task without seeds draws one at every call. Raises ValueError if the course is done.
        """
        task = self.task
        if task is None:
            raise ValueError(f"course {self.course.name!r} is done: there is no next specimen.")
        seed = task.seeds[self._begun[task.name] % len(task.seeds)] if task.seeds else secrets.randbelow(2**31)
        return CourseSpecimen(task.specimen_class, seed, task.target_length)

    def facts(self, task: CourseTask) -> dict[str, Any]:
        """Return what the record of a task's cut has to note, which restores the progress."""
        facts: dict[str, Any] = {"course": self.course.name, "task": task.name, "feedback": task.feedback}
        facts |= {"practice": True} if task.name == WARM_UP else {}
        return facts | ({"crossover": True} if task.crossover else {})

    def add(self, card: ScoreCard, end: str, task: CourseTask | None = None) -> None:
        """Count a cut of a task, by default the present; set :attr:`verdicts`."""
        task = self.task if task is None else task
        assert task is not None
        numbers = marked_numbers(card)
        if task.name == WARM_UP:
            self.skip(WARM_UP)
            self.verdicts = {language: course_words(language, "warmed up") for language in languages()}
            return
        missed = self.count(task.name, numbers, end)
        self.verdicts = {language: _verdict(task, numbers, end, missed, language) for language in languages()}

    def count(self, name: str, numbers: Mapping[str, float], end: str) -> bool:
        """Count a cut of a task; return whether it misses the requirements."""
        task = next(task for task in self.course.tasks if task.name == name)
        missed = end == GIVEN_UP or bool(task.misses(numbers))
        self._counted[name].append(not missed)
        self._begun[name] += 1
        return missed

    def skip(self, name: str) -> None:
        """Skip an abandoned cut's specimen, and count a warm-up."""
        if name == WARM_UP:
            self._warmed += 1
        else:
            self._begun[name] += 1

    @property
    def verdict(self) -> str:
        """Verdict on the session's last cut, in English, or ""."""
        return self.verdicts.get("en", "")

    def ahead(self, language: str = "en") -> str:
        """Return in words what comes next."""
        task, count = self.task, len(self.course.tasks)
        if task is None:
            reached = sum(map(self._is_done, self.course.tasks))
            told = {"course": course_name(language, self.course.name), "count": count, "reached": reached}
            return course_words(language, "done" if reached == count else "over", **told)
        if task.name == WARM_UP:
            said = course_words(language, "warm-up", nth=self._warmed + 1, of=self.course.warm_up)
            along = TASKS[task.task].along
            return f"{said} {course_words(language, along)}" if along else said
        number, many = self.course.tasks.index(task) + 1, task.repetitions > 1
        so_far = course_words(language, "so far", done=self._in_row(task), times=task.repetitions) if many else ""
        force = course_words(language, task.feedback)
        name = course_name(language, task.name)
        facts = {"number": number, "count": count, "name": name, "so_far": so_far, "force": force}
        said = course_words(language, "ahead", demand=task.demand(language), **facts)
        along = TASKS[task.task].along
        parts = [said, course_words(language, along) if along else ""]
        if task.attempts is not None:
            parts.append(course_words(language, "attempt", nth=len(self._counted[task.name]) + 1, of=task.attempts))
        for key in ("opens", "closes"):
            moment = getattr(task, key)
            if moment is not None and (key == "closes" or self.waits):
                parts.append(course_words(language, key, moment=local_moment(moment, language)))
        return " ".join(filter(None, parts))

    def _is_ours(self, facts: dict[str, Any]) -> bool:
        named = (facts.get("course"), facts.get("operator"))
        return named == (self.course.name, self.operator) and facts.get("task") in (*self._counted, WARM_UP)

    def _in_row(self, task: CourseTask) -> int:
        """Return cuts that count towards repetitions, consecutive with a mark."""
        counted = self._counted[task.name]
        return _longest_end(counted) if task.mark else sum(counted)

    def _is_over(self, task: CourseTask) -> bool:
        used = task.attempts is not None and len(self._counted[task.name]) >= task.attempts
        return used or (task.closes is not None and self._clock() >= task.closes) or self._is_done(task)

    def _is_done(self, task: CourseTask) -> bool:
        counted = self._counted[task.name]
        if not task.mark:
            return sum(counted) >= task.repetitions
        return any(_longest_end(counted[: n + 1]) >= task.repetitions for n in range(len(counted)))


def _verdict(task: CourseTask, numbers: Mapping[str, float], end: str, missed: bool, language: str) -> str:
    if not task.mark:
        return course_words(language, "counts not" if missed else "counts")
    if not missed or task.feedback == "never":  # by how much would be feedback
        return course_words(language, "missed" if missed else "reached")
    misses = (course_words(language, GIVEN_UP),) if end == GIVEN_UP else task.misses(numbers, language)
    return course_words(language, "missed by", misses="; ".join(misses))


def _longest_end(counted: Iterable[bool]) -> int:
    """Return how many at the end are true without a break."""
    length = 0
    for each in counted:
        length = length + 1 if each else 0
    return length
