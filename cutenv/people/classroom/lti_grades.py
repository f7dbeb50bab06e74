"""Confirmed grades sent to learning platforms by a thread, with retries."""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import NamedTuple
from urllib.parse import urlsplit

from sqlalchemy.exc import SQLAlchemyError

from cutenv.people.classroom.class_tables import SAVED
from cutenv.people.classroom.lesson import Lesson
from cutenv.people.classroom.lti_keys import AccessTokens
from cutenv.people.classroom.lti_people import GradeRow, LtiPeople
from cutenv.people.classroom.lti_platforms import (
    Platform,
    PlatformFile,
    PlatformRefused,
    PlatformUnreachable,
    asked,
    checked_address,
)
from cutenv.people.play.course_progress import GIVEN_UP

SCORE_SCOPE = "https://purl.imsglobal.org/spec/lti-ags/scope/score"
"""Scope of the Assignment and Grade Services that the class asks for, and no other of them."""
HIGHEST_GRADE = 100
"""Highest grade."""
_EVERY, _MAX_WAIT = 2.0, 600.0  # [s] between two looks; at most so long after failures of a platform
_HELD_BACK = 60.0  # [s] after which a grade that waits for the end of a course is looked at again
_REFUSED_FOR_GOOD = (400, 403, 404, 405, 409, 410, 413, 415, 422)  # what another attempt would not change


class Grade(NamedTuple):
    """Grade of a person, 0 to 100, and whether it is complete."""

    score: int
    done: bool


def grade_of(lesson: Lesson, code: str, task: str = "") -> Grade | None:
    """Return a person's grade; None if there is none yet.

    Of one task it is the best score of the cuts of this task that the server saved, of the course the mean over its
    tasks, of which one without a cut counts 0, and without a course the best score. Cuts of other programs, given up
    ones and those without a score count for nothing. While a course is going on, nothing is said of a task whose
    feedback is hidden, nor of a course with such a task. Raises OSError if a record cannot be read now.
    """
    progress = lesson.progress(code)
    if progress is not None and progress.unread:
        raise OSError(f"a record cannot be read ({progress.unread[0]})")
    course = "" if progress is None else progress.course.name
    best: dict[str, int] = {}
    for cut in lesson.store.cuts(code):
        if cut.state == SAVED and cut.ended != GIVEN_UP and cut.course == course and cut.score is not None:
            best[cut.task] = max(best.get(cut.task, 0), cut.score)
    if progress is None:
        return Grade(max(best.values()), True) if best else None
    tasks = progress.course.tasks
    counted = [each for each in tasks if not task or each.name == task]
    if not any(each.name in best for each in counted):
        return None
    if progress.task is not None and any(each.feedback == "never" for each in counted):
        return None
    ahead = () if progress.task is None else tasks[tasks.index(progress.task) :]
    done = not any(each in counted for each in ahead)
    return Grade(round(sum(best.get(each.name, 0) for each in counted) / len(counted)), done)


class GradeCourier:
    """Thread that sends grades to the platforms after each saved cut.

    In the comment on each grade, ``{code}`` stands for the code of the person. ``troubles`` are, by key of a platform,
    what prevents its grades now; they are tried again.
    """

    def __init__(
        self, lesson: Lesson, people: LtiPeople, file: PlatformFile, tokens: AccessTokens, said: str = "{code}"
    ) -> None:
        self._lesson, self._people, self._file, self._tokens, self._said = lesson, people, file, tokens, said
        self.troubles: dict[tuple[str, str], str] = {}
        self._waits: dict[tuple[str, str], tuple[float, float]] = {}  # how long, and until when
        self._held: dict[tuple[str, str], tuple[int, float]] = {}  # of which cuts, and until when
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="grades", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def send_again(self) -> None:
        """Retry refused grades, and failed platforms, at once."""
        self._people.send_again()
        self._waits.clear()
        self._held.clear()

    def close(self) -> None:
        """Stop within the awaited answer; unsent grades stay in the database."""
        self._end.set()

    def _run(self) -> None:
        before: dict[tuple[str, str], str] = {}
        while not self._end.wait(_EVERY):
            try:
                self.deliver()
            except SQLAlchemyError as error:
                print(f"note: grades: the class's database cannot be read ({error})", file=sys.stderr, flush=True)
                self._end.wait(60.0)
            for key in (key for key, trouble in self.troubles.items() if before.get(key) != trouble):
                print(f"note: grades: {self.troubles[key]}; it is tried again", file=sys.stderr, flush=True)
            before = dict(self.troubles)

    def deliver(self) -> None:
        """Send due grades, except to platforms that failed recently."""
        for row in self._people.grades(due=True):
            if self._end.is_set():
                return
            key = (row.issuer, row.client_id)
            if time.monotonic() >= self._waits.get(key, (0.0, 0.0))[1]:
                self._deliver_one(row, key)

    def _deliver_one(self, row: GradeRow, key: tuple[str, str]) -> None:
        platform = next(iter(self._file.find(row.issuer, [row.client_id])), None)
        if platform is None:
            return self._people.refused(row, "the class is registered with this platform no more")
        held, until = self._held.get(row[:2], (-1, 0.0))
        if held == row.cuts and time.monotonic() < until:
            return None
        try:
            grade = grade_of(self._lesson, row.code, row.task)
        except (OSError, ValueError):  # the person's page says so
            grade = None
        if grade is None:
            self._held[row[:2]] = (row.cuts, time.monotonic() + _HELD_BACK)
            return None
        try:
            checked_address("line item", row.line_item, local=platform.is_local)
        except ValueError as error:
            return self._people.refused(row, str(error))
        try:
            self._send(platform, row, grade)
        except PlatformRefused as error:
            if error.status == 401:  # the next attempt asks for a new token
                self._tokens.forget(platform, SCORE_SCOPE)
            if error.status not in _REFUSED_FOR_GOOD:
                return self._failed(key, str(error))
            self._people.refused(row, str(error))
        except (OSError, ValueError) as error:  # the platform cannot be reached, or the class's key be read
            return self._failed(key, str(error))
        else:
            self._people.sent(row, grade.score)
        self.troubles.pop(key, None)
        self._waits.pop(key, None)
        return None

    def _failed(self, key: tuple[str, str], trouble: str) -> None:
        wait = min(2.0 * self._waits.get(key, (0.5 * _EVERY, 0.0))[0], _MAX_WAIT)
        self._waits[key] = (wait, time.monotonic() + wait)
        self.troubles[key] = trouble

    def _send(self, platform: Platform, row: GradeRow, grade: Grade) -> None:
        try:
            token = self._tokens.find(platform, SCORE_SCOPE)
        except PlatformRefused as error:  # of every person's grade, and so not for good
            raise PlatformUnreachable(str(error)) from None
        place = urlsplit(row.line_item)
        url = place._replace(path=f"{place.path.rstrip('/')}/scores", fragment="").geturl()
        content = {
            "userId": row.subject,
            "timestamp": self._lesson.store.clock().isoformat(timespec="microseconds"),
            "scoreGiven": grade.score,
            "scoreMaximum": HIGHEST_GRADE,
            "activityProgress": "Completed" if grade.done else "InProgress",
            "gradingProgress": "FullyGraded",
            "comment": self._said.format(code=row.code),
        }
        headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/vnd.ims.lis.v1.score+json"}
        asked(url, json.dumps(content).encode(), headers)
