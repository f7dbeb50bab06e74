"""xAPI statements of cuts, queued in the database and delivered once."""

from __future__ import annotations

import base64
import http.client
import json
import sys
import threading
import urllib.error
import urllib.request
import uuid
from contextlib import suppress
from typing import Any
from urllib.parse import quote

from sqlalchemy import Column, ForeignKey, String, Table, func, insert, select
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

import cutenv
from cutenv.people.classroom.class_store import ClassStore, HandedOutCut, written
from cutenv.people.classroom.class_tables import CLASS_METADATA, CUTS, SAVED
from cutenv.people.classroom.lesson import Lesson
from cutenv.people.play.course import Course, marked_numbers
from cutenv.people.play.course_progress import GIVEN_UP
from cutenv.records.scoring import ScoreCard
from cutenv.sim.trace import Trace

_agreed = Table(
    "agreed_to_statements",
    CLASS_METADATA,
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), primary_key=True),
    Column("since", String(32), nullable=False),
)
_delivered = Table(
    "delivered_statements",
    CLASS_METADATA,
    Column("cut", String(32), ForeignKey("cuts.id", ondelete="CASCADE"), primary_key=True),
    Column("trouble", String(300), nullable=False),
)
_waits = (
    (CUTS.c.code == _agreed.c.code)
    & (CUTS.c.handed_out >= _agreed.c.since)
    & (CUTS.c.state == SAVED)
    & CUTS.c.id.not_in(select(_delivered.c.cut))
)


class StatementQueue:
    """Saved cuts of consenting people with undelivered statements.

    The cuts themselves are the queue: a cut that is saved waits, whatever happens to the server then.
    """

    def __init__(self, store: ClassStore) -> None:
        self._store = store
        CLASS_METADATA.create_all(store.engine, tables=[_agreed, _delivered])

    def agree(self, code: str) -> None:
        """Note a person's consent to statements of cuts from now on."""
        with suppress(IntegrityError):  # who agreed before has done so
            self._store.run(insert(_agreed).values(code=code, since=written(self._store.clock())))

    def due(self, most: int) -> list[HandedOutCut]:
        """Return the first cuts that wait, in order."""
        wanted = select(CUTS.c.id, CUTS.c.code).where(_waits).order_by(CUTS.c.handed_out).limit(most)
        found = []
        for row in self._store.rows(wanted):
            with suppress(LookupError):  # deleted at this moment
                found.append(self._store.cut(row.id, row.code))
        return found

    def waiting(self) -> int:
        """Return the number of cuts that wait."""
        ((count,),) = self._store.rows(select(func.count()).select_from(CUTS, _agreed).where(_waits))
        return int(count)

    def done(self, number: str, trouble: str = "") -> None:
        """Mark a cut's statement as delivered, or as failed with reason."""
        with suppress(IntegrityError):  # another server's, or deleted by now
            self._store.run(insert(_delivered).values(cut=number, trouble=trouble[:300]))

    def troubles(self) -> list[str]:
        """Return why statements never arrived, one reason for each."""
        return [row.trouble for row in self._store.rows(select(_delivered).where(_delivered.c.trouble != ""))]


XAPI_VERSION = "1.0.3"
"""Version of the Experience API whose rules the statements keep."""
_VERBS, _ACTIVITIES = "http://adlnet.gov/expapi/verbs/", "http://adlnet.gov/expapi/activities/"
_EVERY, _MAX_WAIT = 2.0, 600.0  # [s] between two looks at the queue; at most so long after failures
_ANSWERS_WITHIN = 20.0  # [s]
_AT_ONCE = 50
_REFUSED_FOR_GOOD = (400, 413, 422)  # what another attempt would not change


class Courier:
    """Thread that delivers statements of consenting people's saved cuts.

    Statements go to ``url/statements``; the login, "key:secret", is for basic authentication, and people and courses
    are named below the class's address, ``home``. Raises ValueError if the address is none, or the login has no colon.
    """

    def __init__(self, lesson: Lesson, queue: StatementQueue, url: str, login: str, home: str) -> None:
        if not url.startswith(("http://", "https://")):
            raise ValueError(f"--lrs {url} is no address. Give one such as https://store.example/xapi.")
        if ":" not in login or not login.isprintable():
            raise ValueError('--lrs-login: the file must hold one line, "key:secret".')
        self.url, self.queue, self.trouble = url.rstrip("/"), queue, ""
        self._lesson, self._home = lesson, home
        self._login = base64.b64encode(login.encode()).decode()
        self._opener = urllib.request.build_opener(NoRedirects)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="courier", daemon=True)

    def start(self) -> None:
        """Begin to deliver."""
        self._thread.start()

    def close(self) -> None:
        """Stop within the awaited answer; undelivered statements stay queued."""
        self._end.set()

    def _run(self) -> None:
        wait = _EVERY
        while not self._end.wait(wait):
            trouble = self.deliver()
            if trouble and trouble != self.trouble:
                print(f"note: learning record store: {trouble}; it is tried again", file=sys.stderr, flush=True)
            self.trouble = trouble
            wait = min(2 * wait, _MAX_WAIT) if trouble else _EVERY

    def deliver(self) -> str:
        """Deliver what is due; return what prevented the rest, or ""."""
        try:
            for cut in self.queue.due(_AT_ONCE):
                if self._end.is_set():
                    break
                self._deliver_one(cut)
        except urllib.error.HTTPError as error:
            return f"{self.url} answers {error.code} {error.reason}"
        except (OSError, http.client.HTTPException) as error:
            return f"{self.url} cannot be reached ({getattr(error, 'reason', None) or error})"
        except SQLAlchemyError as error:
            return f"the class's database cannot be read or written ({error})"
        return ""

    def _deliver_one(self, cut: HandedOutCut) -> None:
        try:
            trace, card = self._lesson.scored(cut)
        except (OSError, ValueError) as error:
            return self.queue.done(cut.id, f"its record cannot be read: {error}")
        course = self._lesson.courses.named(cut.course) or self._lesson.course_of(cut.code)
        made = statement(cut, trace, card, self._home, course)
        headers = {
            "Authorization": f"Basic {self._login}",
            "Content-Type": "application/json",
            "X-Experience-API-Version": XAPI_VERSION,
        }
        content = json.dumps(made, allow_nan=False).encode()
        request = urllib.request.Request(f"{self.url}/statements", content, headers)
        try:
            with self._opener.open(request, timeout=_ANSWERS_WITHIN):
                self.queue.done(cut.id)
        except urllib.error.HTTPError as error:
            if error.code in _REFUSED_FOR_GOOD:
                self.queue.done(cut.id, f"refused: {error.code} {error.reason}")
            elif error.code == 409:  # it has arrived before: its answer was lost
                self.queue.done(cut.id)
            else:
                raise


class NoRedirects(urllib.request.HTTPRedirectHandler):
    """Handler that refuses redirects, which could leak statements and login."""

    def redirect_request(self, *_: Any) -> None:
        """Follow none."""
        return None


def statement(cut: HandedOutCut, trace: Trace, card: ScoreCard, home: str, course: Course | None) -> dict[str, Any]:
    """Return the xAPI statement of a saved cut.

    Its actor is the code, as an account of the class, without a name.  Success is the mark of the course's task where
    it has one, and otherwise the cut's own.  The identifier follows from the cut's, so that a store that gets the
    statement twice keeps it once.
    """
    facts = trace.metadata
    task = None if course is None else next((each for each in course.tasks if each.name == cut.task), None)
    named = (course.name, cut.task) if course is not None and cut.task else ("specimens", cut.specimen_class)
    completed = facts.get("end") != GIVEN_UP
    verb = "completed" if completed else "attempted"
    success = (
        bool(facts.get("success"))
        if task is None or not task.mark
        else completed and not task.misses(marked_numbers(card))
    )
    result: dict[str, Any] = {"success": success, "completion": completed, "duration": f"PT{trace.duration:.2f}S"}
    if card.overall_score is not None:
        points = round(min(max(card.overall_score, 0.0), 100.0), 1)
        result["score"] = {"scaled": round(points / 100.0, 3), "raw": points, "min": 0, "max": 100}
    return {
        "id": str(uuid.uuid5(uuid.NAMESPACE_OID, cut.id)),
        "actor": {"objectType": "Agent", "account": {"homePage": home, "name": cut.code}},
        "verb": {"id": _VERBS + verb, "display": {"en": verb}},
        "object": _activity(home, named, "simulation"),
        "result": result,
        "context": {
            "platform": f"cutenv {cutenv.__version__}",
            "contextActivities": {"parent": [_activity(home, named[:1], "course")]},
        },
        "timestamp": str(facts["date"]),
    }


def _activity(home: str, names: tuple[str, ...], kind: str) -> dict[str, Any]:
    return {
        "objectType": "Activity",
        "id": home + "/".join(("activities", *(quote(name, safe="") for name in names))),
        "definition": {"type": _ACTIVITIES + kind, "name": {"und": names[-1]}},
    }
