"""Database of a class and its tables, beside its records: codes, groups, consents, cuts, marks, who is signed in."""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import (
    Column,
    Connection,
    Engine,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    create_engine,
    delete,
    event,
    insert,
    select,
    update,
)
from sqlalchemy.exc import IntegrityError

from cutenv._base.validation import in_range
from cutenv.recording.provenance import check_operator
from cutenv.scoring.score_card import whole_score

CLASS_METADATA = MetaData()
PEOPLE = Table(
    "people",
    CLASS_METADATA,
    Column("code", String(64), primary_key=True),
    Column("created", String(32), nullable=False),
    Column("consented", String(32)),
)
CLASS_PLACES = Table(  # where a person belongs; whoever is in no class and no group has no row
    "places",
    CLASS_METADATA,
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), primary_key=True),
    Column("class_name", String(32), nullable=False),
    Column("group_name", String(32), nullable=False),
)
PASS_MARKS = Table(
    "pass_marks",
    CLASS_METADATA,
    Column("course", String(200), primary_key=True),  # "" without a course
    Column("tenths", Integer, nullable=False),
    Column("source", String(200), nullable=False),
    Column("since", String(32), nullable=False),
)
CUTS = Table(
    "cuts",
    CLASS_METADATA,
    Column("id", String(32), primary_key=True),
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), nullable=False),
    Column("specimen_class", String(16), nullable=False),
    Column("seed", Integer, nullable=False),
    Column("target_length_um", Integer),  # whole, so that every database gives it back
    Column("task", String(200)),
    Column("handed_out", String(32), nullable=False),
    Column("state", String(16), nullable=False),
    Column("record", String(200)),
    Column("outcome", String(200)),
    Column("score", Integer),
    Column("reason", String(500)),
    Index("cuts_by_code", "code", "handed_out"),
)
SESSIONS = Table(
    "sessions",
    CLASS_METADATA,
    Column("token_hash", String(64), primary_key=True),
    Column("code", String(64), nullable=False),
    Column("expires", String(32), nullable=False),
)


BACKED_UP = (PEOPLE, CLASS_PLACES, CUTS, PASS_MARKS)
"""Tables of a backup, in the order in which they are filled; nobody stays signed in."""


TEACHER = ""
"""Code of the teacher's sessions."""
PREPARED, GOING_ON, SAVED, REFUSED, UNFINISHED = "prepared", "going on", "saved", "refused", "unfinished"
"""States of a cut that was handed out."""
FOREIGN = "foreign"
"""State of a cut that another program recorded: it was not handed out, and no law confirms it."""
KEPT = (SAVED, FOREIGN)
"""States of a cut that has a record."""
_SESSION = timedelta(hours=12)
_NAME = re.compile(r"[^\W_][\w .+-]{0,31}")
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"  # no I and no O, which look like digits


class Place(NamedTuple):
    """Place of a person: class, and group in studies; "" if there is none."""

    class_name: str = ""
    group: str = ""


class MarkInForce(NamedTuple):
    """Pass mark of the overall score that a teacher has put into force: its source in words, and since when."""

    mark: float
    source: str
    since: str


class HandedOutCut(NamedTuple):
    """One cut that was handed out; ``target_length`` [m] is None if it is drawn, ``score`` None without one."""

    id: str
    code: str
    specimen_class: str
    seed: int
    target_length: float | None
    task: str
    handed_out: str
    state: str
    record: str
    outcome: str
    score: int | None
    reason: str


@dataclass(frozen=True, kw_only=True)
class CutEnd:
    """End of a cut.

    Attributes
    ----------
    state : str
        :data:`SAVED` or :data:`FOREIGN` with the name of its record, or :data:`REFUSED`.
    record, outcome : str
        Name of the record, and outcome in a few words.
    score : float, optional
        Overall score.
    reason : str
        Reason for which it was refused, or has no score.
    """

    state: str
    record: str = ""
    outcome: str = ""
    score: float | None = None
    reason: str = ""

    @property
    def columns(self) -> dict[str, Any]:
        """Values of the table's columns."""
        whole = None if self.score is None else whole_score(self.score)
        kept = {"record": self.record, "outcome": self.outcome[:200], "score": whole, "reason": self.reason[:500]}
        return {"state": self.state, **kept}


class ClassStore:
    """Database of one class.

    Parameters
    ----------
    url : str
        Address as SQLAlchemy has it: ``sqlite:///class.db``, ``postgresql+psycopg://...``.

    Attributes
    ----------
    engine : sqlalchemy.Engine
        Its connections.

    Raises
    ------
    sqlalchemy.exc.SQLAlchemyError
        If it cannot be opened.
    """

    def __init__(self, url: str) -> None:
        self.engine: Engine = create_engine(url)
        if self.engine.dialect.name == "sqlite":
            event.listen(self.engine, "connect", _prepare_sqlite)
        CLASS_METADATA.create_all(self.engine)

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    @contextmanager
    def _transaction(self) -> Iterator[Connection]:
        with self.engine.begin() as connection:
            yield connection

    # People

    def add_codes(self, count: int) -> list[str]:
        """Add ``count`` new codes, such as "KRT48213", and return them; they are drawn, so nobody guesses them."""
        made: list[str] = []
        while len(made) < count:
            code = "".join(secrets.choice(_LETTERS) for _ in range(3)) + f"{secrets.randbelow(10**6):06d}"
            if self.add_code(code):
                made.append(code)
        return made

    def add_code(self, code: str) -> bool:
        """Add a code of one's own; return False if it is there already.

        Raises
        ------
        TypeError, ValueError
            If it may identify a person.
        """
        check_operator(code)
        try:
            with self._transaction() as connection:
                connection.execute(insert(PEOPLE).values(code=code, created=_now()))
        except IntegrityError:
            return False
        return True

    def codes(self) -> list[tuple[str, bool]]:
        """Return all codes in order, and whether their people consented."""
        with self._transaction() as connection:
            rows = connection.execute(select(PEOPLE).order_by(PEOPLE.c.created, PEOPLE.c.code)).all()
        return [(row.code, row.consented is not None) for row in rows]

    def knows(self, code: str) -> bool:
        """Return whether there is such a code."""
        with self._transaction() as connection:
            return connection.execute(select(PEOPLE.c.code).where(PEOPLE.c.code == code)).first() is not None

    def consent(self, code: str) -> None:
        """Note that the person agreed to what is stored."""
        with self._transaction() as connection:
            connection.execute(update(PEOPLE).where(PEOPLE.c.code == code).values(consented=_now()))

    def delete(self, code: str) -> bool:
        """Delete a person: code, sessions and cuts; return False if there was none. The records are the caller's."""
        with self._transaction() as connection:
            for table in (CUTS, CLASS_PLACES):
                connection.execute(delete(table).where(table.c.code == code))
            connection.execute(delete(SESSIONS).where(SESSIONS.c.code == code))
            return connection.execute(delete(PEOPLE).where(PEOPLE.c.code == code)).rowcount > 0

    def places(self) -> dict[str, Place]:
        """Return class and group of everybody who has one, by code."""
        with self._transaction() as connection:
            return {row.code: Place(row.class_name, row.group_name) for row in connection.execute(select(CLASS_PLACES))}

    def put(self, codes: Sequence[str], *, class_name: str | None = None, group: str | None = None) -> None:
        """Put people into a class, a group or both; None leaves what is there, "" takes them out.

        Raises
        ------
        ValueError
            If a name is not 1 to 32 letters, digits and blanks, beginning with a letter or digit.
        """
        for what, name in (("class", class_name), ("group", group)):
            if name and not _NAME.fullmatch(name):
                raise ValueError(f"{what} {name!r} is no name: give up to 32 letters, digits and blanks, such as 2b.")
        there = self.places()
        with self._transaction() as connection:
            known = {row.code for row in connection.execute(select(PEOPLE.c.code))}
            for code in (each for each in codes if each in known):
                old = there.get(code, Place())
                new = {
                    "class_name": old.class_name if class_name is None else class_name,
                    "group_name": old.group if group is None else group,
                }
                connection.execute(delete(CLASS_PLACES).where(CLASS_PLACES.c.code == code))
                if any(new.values()):
                    connection.execute(insert(CLASS_PLACES).values(code=code, **new))

    # Pass marks

    def pass_mark(self, course: str) -> MarkInForce | None:
        """Return the pass mark in force for a course ("" without one), or None."""
        with self._transaction() as connection:
            row = connection.execute(select(PASS_MARKS).where(PASS_MARKS.c.course == course)).first()
        return None if row is None else MarkInForce(row.tenths / 10, row.source, row.since)

    def set_pass_mark(self, course: str, mark: float | None, source: str = "") -> None:
        """Put a pass mark of the overall score into force for a course, or with None withdraw it.

        Raises
        ------
        ValueError
            If it is outside 0 to 100.
        """
        if mark is not None:
            in_range("mark", mark, 0.0, 100.0, "1", "Give an overall score, such as 60.")
        with self._transaction() as connection:
            connection.execute(delete(PASS_MARKS).where(PASS_MARKS.c.course == course))
            if mark is not None:
                row = {"course": course, "tenths": round(10 * mark), "source": source[:200], "since": _now()}
                connection.execute(insert(PASS_MARKS).values(**row))

    # Sessions

    def sign_in(self, code: str) -> str:
        """Return a new token of a person, or of the :data:`TEACHER`; only its hash is stored."""
        token = secrets.token_urlsafe(32)
        expires = (datetime.now(UTC) + _SESSION).isoformat(timespec="seconds")
        with self._transaction() as connection:
            connection.execute(delete(SESSIONS).where(SESSIONS.c.expires < _now()))
            connection.execute(insert(SESSIONS).values(token_hash=_hash(token), code=code, expires=expires))
        return token

    def signed_in(self, token: str) -> str | None:
        """Return whose token it is; None if it is nobody's, or too old."""
        with self._transaction() as connection:
            row = connection.execute(select(SESSIONS).where(SESSIONS.c.token_hash == _hash(token))).first()
        return None if row is None or row.expires < _now() else str(row.code)

    def sign_out(self, token: str) -> None:
        """Forget a token."""
        with self._transaction() as connection:
            connection.execute(delete(SESSIONS).where(SESSIONS.c.token_hash == _hash(token)))

    # Cuts

    def prepared(self, code: str) -> HandedOutCut | None:
        """Return the cut that was handed out to a person and not begun, or None; one left unfinished is noted so."""
        left = (CUTS.c.code == code) & (CUTS.c.state == GOING_ON)
        with self._transaction() as connection:
            connection.execute(update(CUTS).where(left).values(state=UNFINISHED))
        return next(self._found(CUTS.c.code == code, CUTS.c.state == PREPARED), None)

    def hand_out(
        self, code: str, specimen_class: str, seed: int, target_length: float | None = None, task: str = ""
    ) -> HandedOutCut:
        """Hand out a new cut."""
        number = secrets.token_hex(16)
        length = None if target_length is None else round(1e6 * target_length)
        with self._transaction() as connection:
            values = dict(
                id=number, code=code, specimen_class=specimen_class, seed=seed, target_length_um=length, task=task,
                handed_out=_now(), state=PREPARED,
            )  # fmt: skip
            connection.execute(insert(CUTS).values(**values))
        return self.cut(number, code)

    def begun(self, number: str, code: str) -> None:
        """Note that a person has begun a cut; does nothing if there is no such cut to begin."""
        mine = (CUTS.c.id == number) & (CUTS.c.code == code) & (CUTS.c.state == PREPARED)
        with self._transaction() as connection:
            connection.execute(update(CUTS).where(mine).values(state=GOING_ON))

    def cut(self, number: str, code: str) -> HandedOutCut:
        """Return a person's own cut.

        Raises
        ------
        LookupError
            If the person has no such cut.
        """
        for cut in self._found(CUTS.c.id == number, CUTS.c.code == code):
            return cut
        raise LookupError(f"no cut {number!r} was handed out to this person.")

    def finish(self, number: str, end: CutEnd, *, keep: Callable[[], None] = lambda: None) -> bool:
        """Note how a cut ended.

        Return False, and change nothing, if it had ended before, perhaps on another server.  ``keep`` is called
        otherwise, while no other server can note an end: it puts the record in its place.
        """
        goes_on = (CUTS.c.id == number) & CUTS.c.state.in_((PREPARED, GOING_ON, UNFINISHED))
        with self._transaction() as connection:
            ended = connection.execute(update(CUTS).where(goes_on).values(**end.columns)).rowcount > 0
            if ended:
                keep()
            return ended

    def add_foreign(self, code: str, end: CutEnd) -> str:
        """Note a cut that another program recorded; return its number."""
        number = secrets.token_hex(16)
        values = dict(id=number, code=code, specimen_class="", seed=0, handed_out=_now(), **end.columns)
        with self._transaction() as connection:
            connection.execute(insert(CUTS).values(**values))
        return number

    def cuts(self, code: str | None = None) -> list[HandedOutCut]:
        """Return the cuts of a person, or of all, in order."""
        return list(self._found(*([] if code is None else [CUTS.c.code == code])))

    def content(self) -> dict[str, list[dict[str, Any]]]:
        """Return everything but the sessions, as rows by table, for a backup."""
        with self._transaction() as connection:
            return {
                table.name: [dict(row) for row in connection.execute(select(table)).mappings()] for table in BACKED_UP
            }

    def fill(self, content: dict[str, list[dict[str, Any]]]) -> None:
        """Fill an empty database from :meth:`content`.

        Raises
        ------
        ValueError
            If it is not empty.
        """
        with self._transaction() as connection:
            if connection.execute(select(PEOPLE.c.code)).first() is not None:
                raise ValueError("the database holds a class already. Restore into a new folder or an empty database.")
            for table in BACKED_UP:
                if rows := content.get(table.name):
                    connection.execute(insert(table), rows)

    def close_unfinished(self) -> int:
        """Note every cut that goes on as unfinished, after a restart; return how many there were."""
        with self._transaction() as connection:
            changed = update(CUTS).where(CUTS.c.state == GOING_ON).values(state=UNFINISHED)
            return int(connection.execute(changed).rowcount)

    def _found(self, *conditions: Any) -> Iterator[HandedOutCut]:
        with self._transaction() as connection:
            rows: Sequence[Any] = connection.execute(
                select(CUTS).where(*conditions).order_by(CUTS.c.handed_out, CUTS.c.id)
            ).all()
        for row in rows:
            length = None if row.target_length_um is None else row.target_length_um / 1e6
            yield HandedOutCut(
                row.id, row.code, row.specimen_class, row.seed, length, row.task or "", row.handed_out, row.state,
                row.record or "", row.outcome or "", row.score, row.reason or "",
            )  # fmt: skip


def _prepare_sqlite(connection: Any, _: Any) -> None:
    # A write-ahead log lets many read while one writes, and survives a kill; writers wait for each other.
    for setting in ("journal_mode=WAL", "foreign_keys=ON", "busy_timeout=15000", "synchronous=FULL"):
        connection.execute(f"PRAGMA {setting}")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
