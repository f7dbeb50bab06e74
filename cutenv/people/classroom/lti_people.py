"""Learning platforms' people in the database: codes and grade columns."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from datetime import timedelta
from typing import NamedTuple

from sqlalchemy import ColumnElement, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from cutenv.people.classroom.class_store import ClassStore, written
from cutenv.people.classroom.class_tables import CUTS, LTI_COURSES, LTI_GRADES, LTI_NONCES, LTI_PEOPLE, SAVED

_IDENTIFIERS = ("issuer", "deployment", "subject")  # of a person
_LONGEST_TROUBLE = 300
_REMEMBERED = timedelta(hours=2)  # longer than any launch is accepted


class Learner(NamedTuple):
    """Person sent by a platform, as stored: no name.

    ``issuer``, ``deployment`` and ``subject`` are the platform's identifiers and ``client_id`` that of the class there.
    ``class_name`` is the short name of the platform's course, "" without one that fits.  ``line_item`` is the address
    of a column of its gradebook, "" without one, and ``task`` the task whose grade goes there, "" for the course.
    """

    issuer: str
    client_id: str
    deployment: str
    subject: str
    class_name: str = ""
    line_item: str = ""
    task: str = ""


class GradeRow(NamedTuple):
    """Grade column of a person, and what was ``sent``, None before the first."""

    code: str
    line_item: str
    issuer: str
    client_id: str
    subject: str
    task: str
    counted: int
    cuts: int
    sent: int | None
    since: str
    trouble: str


class LtiPeople:
    """People of learning platforms, and the places of their grades."""

    def __init__(self, store: ClassStore) -> None:
        self._store = store

    def use_once(self, nonce: str) -> bool:
        """Mark a launch as used; return False if it was."""
        now = self._store.clock()
        digest = hashlib.sha256(nonce.encode()).hexdigest()
        self._store.run(delete(LTI_NONCES).where(LTI_NONCES.c.expires < written(now)))
        try:
            self._store.run(insert(LTI_NONCES).values(nonce=digest, expires=written(now + _REMEMBERED)))
        except IntegrityError:
            return False
        return True

    def code_of(self, learner: Learner) -> str | None:
        """Return a person's code, None for a new one."""
        mine = (getattr(LTI_PEOPLE.c, name) == getattr(learner, name) for name in _IDENTIFIERS)
        return next((row.code for row in self._store.rows(select(LTI_PEOPLE.c.code).where(*mine))), None)

    def codes(self, issuer: str) -> dict[str, list[str]]:
        """Return codes of a platform's people by its identifier of them."""
        mine = select(LTI_PEOPLE.c.subject, LTI_PEOPLE.c.code).where(LTI_PEOPLE.c.issuer == issuer)
        found: dict[str, list[str]] = {}
        for subject, code in self._store.rows(mine.order_by(LTI_PEOPLE.c.code)):
            found.setdefault(subject, []).append(code)
        return found

    def note_members_url(self, issuer: str, client_id: str, course: str, members_url: str) -> None:
        """Note the address of a course's member list, or ""."""
        values = {"issuer": issuer, "client_id": client_id, "course": course, "members_url": members_url}
        if self.members_url(issuer, client_id, course) == members_url:
            return
        with suppress(IntegrityError):  # another launch at this moment
            former = delete(LTI_COURSES).where(_is_course(issuer, client_id, course))
            self._store.run(former, insert(LTI_COURSES).values(**values))

    def members_url(self, issuer: str, client_id: str, course: str) -> str | None:
        """Return the member list's address, "" or, before any launch, None."""
        wanted = select(LTI_COURSES.c.members_url).where(_is_course(issuer, client_id, course))
        return next((row.members_url for row in self._store.rows(wanted)), None)

    def enter(self, learner: Learner) -> str:
        """Return a person's code, new if necessary, and note the grade column."""
        code = self.code_of(learner)
        if code is None:
            code = self._new_code(learner)
        if learner.line_item:
            self._note_line_item(code, learner)
        return code

    def _new_code(self, learner: Learner) -> str:
        (made,) = self._store.add_codes(1)
        identifiers = {name: getattr(learner, name) for name in _IDENTIFIERS}
        try:
            self._store.run(insert(LTI_PEOPLE).values(code=made, **identifiers))
        except IntegrityError:  # entered a second time at this moment
            self._store.delete(made)
            return self.code_of(learner) or self._new_code(learner)
        with suppress(ValueError):  # a name of a course may be none of a class
            self._store.put([made], class_name=learner.class_name)
        return made

    def _note_line_item(self, code: str, learner: Learner) -> None:
        mine = (LTI_GRADES.c.code == code) & (LTI_GRADES.c.line_item == learner.line_item)
        now = {"client_id": learner.client_id, "task": learner.task}
        with self._store.engine.begin() as connection:
            row = connection.execute(select(LTI_GRADES).where(mine)).first()
            if row is not None and row.task != learner.task:  # the link leads to another task now
                connection.execute(update(LTI_GRADES).where(mine).values(counted=0))
            if row is not None:
                connection.execute(update(LTI_GRADES).where(mine).values(**now))
                return
        fresh = {"code": code, "line_item": learner.line_item, "counted": 0, "trouble": ""}
        with suppress(IntegrityError):  # another launch at this moment
            self._store.run(insert(LTI_GRADES).values(**fresh, **now))

    def grades(self, *, due: bool = False) -> list[GradeRow]:
        """Return grade columns by code, all or those due.

        One waits if its person has other saved cuts than those that the grade sent last takes in.  So a saved
        cut waits from then on, also after a crash of the server.
        """
        saved = (
            select(func.count())
            .where((CUTS.c.code == LTI_GRADES.c.code) & (CUTS.c.state == SAVED))
            .correlate(LTI_GRADES)
            .scalar_subquery()
        )
        everything = select(LTI_GRADES, LTI_PEOPLE.c.issuer, LTI_PEOPLE.c.subject, saved.label("cuts")).join_from(
            LTI_GRADES, LTI_PEOPLE, LTI_GRADES.c.code == LTI_PEOPLE.c.code
        )
        wanted = everything.where(LTI_GRADES.c.counted != saved) if due else everything
        rows = self._store.rows(wanted.order_by(LTI_GRADES.c.code, LTI_GRADES.c.line_item))
        return [
            GradeRow(
                row.code, row.line_item, row.issuer, row.client_id, row.subject, row.task, row.counted, row.cuts,
                row.sent, row.since or "", row.trouble,
            )
            for row in rows
        ]  # fmt: skip

    def sent(self, row: GradeRow, score: int) -> None:
        """Note that a grade with the row's cuts has arrived."""
        self._change(row, counted=row.cuts, sent=score, since=written(self._store.clock()), trouble="")

    def refused(self, row: GradeRow, trouble: str) -> None:
        """Note a refused grade and why, until the next cut."""
        self._change(row, counted=row.cuts, trouble=trouble[:_LONGEST_TROUBLE])

    def send_again(self) -> None:
        """Let every grade that was refused wait again."""
        self._store.run(update(LTI_GRADES).where(LTI_GRADES.c.trouble != "").values(counted=-1, trouble=""))

    def _change(self, row: GradeRow, **values: object) -> None:
        mine = (LTI_GRADES.c.code == row.code) & (LTI_GRADES.c.line_item == row.line_item)
        same_task = LTI_GRADES.c.task == row.task  # else a launch has changed it meanwhile
        self._store.run(update(LTI_GRADES).where(mine & same_task).values(**values))


def _is_course(issuer: str, client_id: str, course: str) -> ColumnElement[bool]:
    return (LTI_COURSES.c.issuer == issuer) & (LTI_COURSES.c.client_id == client_id) & (LTI_COURSES.c.course == course)
