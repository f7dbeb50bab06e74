"""Database of a class: codes, groups, consents, cuts, marks, sessions."""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import Connection, Executable, create_engine, delete, event, func, insert, inspect, select, text, update
from sqlalchemy.exc import DatabaseError, IntegrityError

from cutenv._base.validation import in_range
from cutenv.people.classroom.class_tables import (
    BACKED_UP,
    BROKEN_OFF,
    CLASS_METADATA,
    CLASS_PLACES,
    COMMENTS,
    CUTS,
    GOING_ON,
    INDEXES,
    LEFT,
    OPEN,
    PASS_MARKS,
    PEOPLE,
    PREPARED,
    SAVED,
    SESSIONS,
    TAKEN_BACK,
    TRIAL,
    UNFINISHED,
)
from cutenv.records.provenance import check_operator
from cutenv.records.scoring.score_card import whole_score

LONGEST_COMMENT = 500
"""Most characters of a comment."""
PLACE_NAME = re.compile(r"[^\W_][\w .+-]{0,31}")
"""Names of classes and groups, and keys of courses."""
_TRIES = 100  # of handing out a cut, while other servers are quicker
_SESSION, _IDLE, _NOTED = timedelta(hours=12), timedelta(minutes=15), timedelta(minutes=1)
_TEACHER = "teacher "  # no code begins so
_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"  # no I and no O, which look like digits


class Place(NamedTuple):
    """Class, study group and further course key of a person, else ""."""

    class_name: str = ""
    group: str = ""
    course: str = ""


class MarkInForce(NamedTuple):
    """Pass mark in force for the overall score, with source and date."""

    mark: float
    source: str
    since: str


class Comment(NamedTuple):
    """Comment of the teacher to a person, with time (UTC)."""

    id: str
    written: str
    said: str


class NewCut(NamedTuple):
    """Cut to hand out: specimen, course, task and task digest."""

    specimen_class: str
    seed: int
    target_length: float | None = None
    course: str = ""
    task: str = ""
    terms: str = ""


class HandedOutCut(NamedTuple):
    """One cut that was handed out, the ``nth`` of its person.

    ``target_length`` [m] is None if it is drawn, ``begun`` (UTC) "" before, ``score`` None without one, ``numbers``
    (:func:`~cutenv.people.play.course.marked_numbers`) None where they were not noted, ``stalled`` what its page lost
    [s]. An ``example`` is shown beside replays of the same specimen.
    """

    id: str
    code: str
    nth: int
    specimen_class: str
    seed: int
    target_length: float | None
    course: str
    task: str
    terms: str
    handed_out: str
    begun: str
    state: str
    record: str
    outcome: str
    score: int | None
    reason: str
    ended: str
    numbers: Mapping[str, float] | None
    stalled: float
    example: bool


class SeenMovements(ValueError):
    """Movements identical bit for bit to another cut's in the class."""


@dataclass(frozen=True, kw_only=True)
class CutEnd:
    """End of a cut."""

    state: str  # SAVED or FOREIGN with its record, REFUSED or TAKEN_BACK
    record: str = ""
    outcome: str = ""
    score: float | None = None
    reason: str = ""  # for which it was refused, or has no score
    ended: str = ""  # how the task ended, such as "finished"
    numbers: Mapping[str, float] = field(default_factory=dict)  # those that a mark may limit
    movements: str | None = None  # SHA-256
    stalled: float = 0.0  # [s] lost by the page

    @property
    def columns(self) -> dict[str, Any]:
        """Values of the table's columns."""
        whole = None if self.score is None else whole_score(self.score)
        kept = {"record": self.record, "outcome": self.outcome[:200], "score": whole, "reason": self.reason[:500]}
        made = {"ended": self.ended[:32], "numbers": json.dumps(dict(self.numbers)), "movements": self.movements}
        return {"state": self.state, **kept, **made, "stalled_ms": round(1e3 * self.stalled)}


class ClassStore:
    """Database of one class.

    Parameters
    ----------
    url : str
        Address as SQLAlchemy has it: ``sqlite:///class.db``, ``postgresql+psycopg://...``.
    clock : callable
        Returns the present time, UTC.

    Attributes
    ----------
    engine : sqlalchemy.Engine
        Its connections.
    clock : callable
        As above.

    Raises
    ------
    sqlalchemy.exc.SQLAlchemyError
        If it cannot be opened.
    """

    def __init__(self, url: str, clock: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        self.engine = create_engine(url)
        self.clock = clock
        if self.engine.dialect.name == "sqlite":
            event.listen(self.engine, "connect", _prepare_sqlite)
        try:
            self._lay_out()
        except DatabaseError:  # two servers begin at once, and the other one has laid it out
            self._lay_out()

    def _lay_out(self) -> None:
        """Create missing tables, and add missing columns to older ones."""
        CLASS_METADATA.create_all(self.engine)
        with self.engine.begin() as connection:
            for table in (CUTS, SESSIONS, CLASS_PLACES):
                there = {column["name"] for column in inspect(connection).get_columns(table.name)}
                for column in (column for column in table.columns if column.name not in there):
                    kind = column.type.compile(self.engine.dialect)
                    connection.execute(text(f"ALTER TABLE {table.name} ADD COLUMN {column.name} {kind}"))
            _number(connection)
            for index in INDEXES:
                index.create(connection, checkfirst=True)

    def _now(self) -> str:
        return written(self.clock())

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    def run(self, *statements: Executable) -> int:
        """Run statements as one transaction; return how many rows the last one changed."""
        with self.engine.begin() as connection:
            return [connection.execute(each) for each in statements][-1].rowcount

    def rows(self, wanted: Executable) -> Sequence[Any]:
        """Return the rows of a query."""
        with self.engine.begin() as connection:
            return connection.execute(wanted).all()

    # People

    def add_codes(self, count: int) -> list[str]:
        """Add ``count`` random new codes, such as "KRT48213"; return them."""
        made: list[str] = []
        while len(made) < count:
            code = "".join(secrets.choice(_LETTERS) for _ in range(3)) + f"{secrets.randbelow(10**6):06d}"
            if self.add_code(code):
                made.append(code)
        return made

    def add_code(self, code: str) -> bool:
        """Add a custom code; return False if it exists.

        Raises TypeError or ValueError if it may identify a person.
        """
        check_operator(code)
        try:
            self.run(insert(PEOPLE).values(code=code, created=self._now()))
        except IntegrityError:
            return False
        return True

    def codes(self) -> list[tuple[str, bool]]:
        """Return all codes of people in order, and whether they consented."""
        everybody = select(PEOPLE).where(PEOPLE.c.code != TRIAL).order_by(PEOPLE.c.created, PEOPLE.c.code)
        return [(row.code, row.consented is not None) for row in self.rows(everybody)]

    def knows(self, code: str) -> bool:
        """Return whether there is such a code."""
        return bool(self.rows(select(PEOPLE.c.code).where(PEOPLE.c.code == code)))

    def consent(self, code: str) -> None:
        """Note that the person agreed to what is stored."""
        self.run(update(PEOPLE).where(PEOPLE.c.code == code).values(consented=self._now()))

    def delete(self, code: str) -> bool:
        """Delete a person's code, sessions and cuts, but no records; False if unknown."""
        tables = (CUTS, CLASS_PLACES, COMMENTS, SESSIONS, PEOPLE)
        return self.knows(code) and self.run(*(delete(table).where(table.c.code == code) for table in tables)) > 0

    def places(self, code: str | None = None) -> dict[str, Place]:
        """Return places of everybody, or one person, by code."""
        wanted = select(CLASS_PLACES)
        rows = self.rows(wanted if code is None else wanted.where(CLASS_PLACES.c.code == code))
        return {row.code: Place(row.class_name, row.group_name, row.course or "") for row in rows}

    def put(
        self,
        codes: Sequence[str],
        *,
        class_name: str | None = None,
        group: str | None = None,
        course: str | None = None,
    ) -> None:
        """Set people's class, group and course; None keeps, "" removes.

        Raises ValueError if a name is not 1 to 32 letters, digits and blanks, beginning with a letter or digit.
        """
        for what, name in (("class", class_name), ("group", group), ("course", course)):
            if name and not PLACE_NAME.fullmatch(name):
                raise ValueError(f"{what} {name!r} is no name: give up to 32 letters, digits and blanks, such as 2b.")
        there = self.places()
        with self.engine.begin() as connection:
            known = {row.code for row in connection.execute(select(PEOPLE.c.code))}
            for code in (each for each in codes if each in known):
                old = there.get(code, Place())
                new = {
                    "class_name": old.class_name if class_name is None else class_name,
                    "group_name": old.group if group is None else group,
                    "course": old.course if course is None else course,
                }
                connection.execute(delete(CLASS_PLACES).where(CLASS_PLACES.c.code == code))
                if any(new.values()):
                    connection.execute(insert(CLASS_PLACES).values(code=code, **new))

    # Comments

    def comment(self, code: str, said: str) -> None:
        """Keep a comment of the teacher to a person.

        Raises LookupError if there is no such person. Raises ValueError if it is empty, or longer than 500 characters.
        """
        if not self.knows(code):
            raise LookupError("There is no such code.")
        said = said.strip()
        if not 1 <= len(said) <= LONGEST_COMMENT:
            raise ValueError(f"A comment has 1 to {LONGEST_COMMENT} characters; this one has {len(said)}.")
        values = {"id": secrets.token_hex(16), "code": code, "written": self._now(), "said": said}
        self.run(insert(COMMENTS).values(**values))

    def comments(self, code: str) -> list[Comment]:
        """Return the comments to a person, the newest first."""
        mine = select(COMMENTS).where(COMMENTS.c.code == code).order_by(COMMENTS.c.written.desc(), COMMENTS.c.id)
        return [Comment(row.id, row.written, row.said) for row in self.rows(mine)]

    def take_back(self, number: str, code: str) -> None:
        """Delete a comment to a person."""
        self.run(delete(COMMENTS).where(COMMENTS.c.id == number, COMMENTS.c.code == code))

    # Pass marks

    def pass_mark(self, course: str) -> MarkInForce | None:
        """Return a course's pass mark in force ("" without course), or None."""
        found = self.rows(select(PASS_MARKS).where(PASS_MARKS.c.course == course))
        return next((MarkInForce(row.tenths / 10, row.source, row.since) for row in found), None)

    def set_pass_mark(self, course: str, mark: float | None, source: str = "") -> None:
        """Set a course's pass mark of the overall score; None withdraws it.

        Raises ValueError if it is outside 0 to 100.
        """
        if mark is not None:
            in_range("mark", mark, 0.0, 100.0, "1", "Give an overall score, such as 60.")
        changes: list[Executable] = [delete(PASS_MARKS).where(PASS_MARKS.c.course == course)]
        if mark is not None:
            row = {"course": course, "tenths": round(10 * mark), "source": source[:200], "since": self._now()}
            changes.append(insert(PASS_MARKS).values(**row))
        self.run(*changes)

    # Sessions

    def sign_in(self, code: str) -> str:
        """Return a new token, stored as hash, for a person or :func:`teacher_of` a server."""
        token, now = secrets.token_urlsafe(32), self.clock()
        values = {"expires": written(now + _SESSION), "seen": written(now)}
        self.run(
            delete(SESSIONS).where(SESSIONS.c.expires < written(now)),
            insert(SESSIONS).values(token_hash=_hash(token), code=code, **values),
        )
        return token

    def signed_in(self, token: str) -> str | None:
        """Return a token's owner; None if unknown, too old or long unseen."""
        now = self.clock()
        with self.engine.begin() as connection:
            row = connection.execute(select(SESSIONS).where(SESSIONS.c.token_hash == _hash(token))).first()
            if row is None or row.expires < written(now):
                return None
            if not row.code.startswith(_TEACHER) and (row.seen or "") < written(now - _IDLE):
                return None
            if (row.seen or "") < written(now - _NOTED):
                mine = SESSIONS.c.token_hash == row.token_hash
                connection.execute(update(SESSIONS).where(mine).values(seen=written(now)))
        return str(row.code)

    def present(self) -> dict[str, str]:
        """Return when signed-in people were last seen (UTC, minutes), by code."""
        now = self.clock()
        here = (SESSIONS.c.expires >= written(now)) & (SESSIONS.c.seen >= written(now - _IDLE))
        seen = select(SESSIONS.c.code, func.max(SESSIONS.c.seen).label("seen")).where(here).group_by(SESSIONS.c.code)
        return {row.code: row.seen for row in self.rows(seen)}

    def sign_out(self, token: str) -> None:
        """Forget a token."""
        self.run(delete(SESSIONS).where(SESSIONS.c.token_hash == _hash(token)))

    def sign_out_everywhere(self, code: str) -> None:
        """Delete all tokens of a person or :func:`teacher_of` a server."""
        self.run(delete(SESSIONS).where(SESSIONS.c.code == code))

    # Cuts

    def hand_out(self, code: str, chosen: Callable[[Sequence[HandedOutCut]], NewCut | None]) -> HandedOutCut | None:
        """Hand out a person's next cut, the same one on all servers.

        One that was prepared on the same terms is handed out again, one on other terms taken back.  One that was begun
        is left, and so given up, except by the end of a server.

        Parameters
        ----------
        code : str
            The person.
        chosen : callable
            Returns the next cut from those that have ended, or None if there is none; called again if another server
            was quicker.

        Raises
        ------
        LookupError
            If there is no such person.
        """
        ends = {GOING_ON: LEFT, BROKEN_OFF: UNFINISHED}
        for _ in range(_TRIES):
            cuts = self.cuts(code)
            there = next((cut for cut in cuts if cut.state in OPEN), None)
            if there is not None and there.state in ends:
                self._change(there, ends[there.state])
                continue
            new = chosen([cut for cut in cuts if cut is not there])
            if there is not None and new is not None and there.terms == new.terms:
                return there
            if there is not None:
                self._change(there, TAKEN_BACK)
            elif new is None:
                return None
            elif (number := self._insert(code, cuts, new)) is not None:
                return self.cut(number, code)
        raise LookupError("No cut can be handed out: this person is deleted, or begins without end.")

    def _change(self, cut: HandedOutCut, state: str) -> None:
        """Give a cut another state, unless another server has done so."""
        self.run(update(CUTS).where(CUTS.c.id == cut.id, CUTS.c.state == cut.state).values(state=state))

    def _insert(self, code: str, cuts: Sequence[HandedOutCut], new: NewCut) -> str | None:
        """Add a prepared cut; return its number, or None if others came first."""
        number = secrets.token_hex(16)
        values = new._asdict()
        length = values.pop("target_length")
        values["target_length_um"] = None if length is None else round(1e6 * length)
        values |= {"id": number, "code": code, "nth": 1 + max((cut.nth for cut in cuts), default=0)}
        try:
            self.run(insert(CUTS).values(**values, handed_out=self._now(), state=PREPARED))
        except IntegrityError:
            return None
        return number

    def begun(self, number: str, code: str) -> bool:
        """Note that a person has begun a cut; return False if impossible."""
        mine = (CUTS.c.id == number) & (CUTS.c.code == code) & (CUTS.c.state == PREPARED)
        return self.run(update(CUTS).where(mine).values(state=GOING_ON, begun=self._now())) > 0

    def cut(self, number: str, code: str) -> HandedOutCut:
        """Return a person's own cut.

        Raises LookupError if the person has no such cut.
        """
        for cut in self._found(CUTS.c.id == number, CUTS.c.code == code):
            return cut
        raise LookupError(f"no cut {number!r} was handed out to this person.")

    def finish(self, number: str, end: CutEnd, *, keep: Callable[[], None] = lambda: None) -> bool:
        """Note how a cut ended.

        Return False, and change nothing, if it is not open, perhaps by another server. ``keep`` is called otherwise,
        while no other server can note an end: it puts the record in its place. Raises SeenMovements if its movements
        are those of a saved cut in the class; nothing is changed.
        """
        goes_on = (CUTS.c.id == number) & CUTS.c.state.in_(OPEN)
        with self.engine.begin() as connection:
            try:
                ended = connection.execute(update(CUTS).where(goes_on).values(**end.columns)).rowcount > 0
            except IntegrityError:
                raise SeenMovements(
                    "a cut of the class has the same movements, bit for bit: no hand repeats one."
                ) from None
            if ended:
                keep()
            return ended

    def note(self, number: str, end: CutEnd, course: str) -> None:
        """Note numbers and course of a cut saved by an earlier version."""
        columns = {name: end.columns[name] for name in ("ended", "numbers")}
        self.run(update(CUTS).where(CUTS.c.id == number).values(**columns, course=course))

    def set_example(self, number: str, code: str, shown: bool) -> None:
        """Mark or unmark a saved cut as its specimen's example in its task.

        Raises LookupError if the person has no such saved cut.
        """
        cut = self.cut(number, code)
        if cut.state != SAVED:
            raise LookupError(f"cut {number!r} is {cut.state}: it has no record.")
        same = (CUTS.c.terms == cut.terms) & (CUTS.c.specimen_class == cut.specimen_class) & (CUTS.c.seed == cut.seed)
        own = update(CUTS).where(CUTS.c.id == number).values(example=1 if shown else None)
        self.run(update(CUTS).where(same).values(example=None), own)

    def add_foreign(self, code: str, end: CutEnd) -> str:
        """Note a cut that another program recorded; return its number."""
        for _ in range(_TRIES):
            number = secrets.token_hex(16)
            values = dict(id=number, code=code, specimen_class="", seed=0, handed_out=self._now(), **end.columns)
            try:
                last = select(func.coalesce(func.max(CUTS.c.nth), 0)).where(CUTS.c.code == code).scalar_subquery()
                self.run(insert(CUTS).values(**values, nth=last + 1))
            except IntegrityError:
                continue  # another server was quicker
            return number
        raise LookupError("There is no such code.")

    def cuts(self, code: str | None = None) -> list[HandedOutCut]:
        """Return the cuts of one person or all, in order."""
        return list(self._found(CUTS.c.code != TRIAL if code is None else CUTS.c.code == code))

    def content(self) -> dict[str, list[dict[str, Any]]]:
        """Return all rows by table for a backup, without sessions."""
        with self.engine.begin() as connection:
            return {
                table.name: [dict(row) for row in connection.execute(select(table)).mappings()] for table in BACKED_UP
            }

    def fill(self, content: dict[str, list[dict[str, Any]]]) -> None:
        """Fill an empty database from :meth:`content`.

        Raises ValueError if it is not empty.
        """
        with self.engine.begin() as connection:
            if connection.execute(select(PEOPLE.c.code)).first() is not None:
                raise ValueError("the database holds a class already. Restore into a new folder or an empty database.")
            for table in BACKED_UP:
                if rows := content.get(table.name):
                    connection.execute(insert(table), rows)
            _number(connection)

    def break_off(self) -> int:
        """Mark cuts in progress as broken off after a restart; return their number."""
        return self.run(update(CUTS).where(CUTS.c.state == GOING_ON).values(state=BROKEN_OFF))

    def _found(self, *conditions: Any) -> Iterator[HandedOutCut]:
        for row in self.rows(select(CUTS).where(*conditions).order_by(CUTS.c.code, CUTS.c.nth)):
            length = None if row.target_length_um is None else row.target_length_um / 1e6
            yield HandedOutCut(
                row.id, row.code, row.nth, row.specimen_class, row.seed, length, row.course or "", row.task or "",
                row.terms or "", row.handed_out, row.begun or "", row.state, row.record or "", row.outcome or "",
                row.score, row.reason or "", row.ended or "",
                None if row.numbers is None else json.loads(row.numbers), (row.stalled_ms or 0) / 1e3,
                bool(row.example),
            )  # fmt: skip


def teacher_of(secret: str) -> str:
    """Return the teacher's sign-in name for a server's secret."""
    return f"{_TEACHER}{_hash(secret)[:16]}"


def _number(connection: Connection) -> None:
    """Assign numbers to an earlier version's cuts by time of handing out."""
    missing = select(CUTS.c.id, CUTS.c.code).where(CUTS.c.nth.is_(None)).order_by(CUTS.c.handed_out, CUTS.c.id)
    rows = connection.execute(missing).all()
    last: dict[str, int] = {}
    for row in rows:
        if row.code not in last:
            known = select(func.coalesce(func.max(CUTS.c.nth), 0)).where(CUTS.c.code == row.code)
            last[row.code] = int(connection.execute(known).scalar_one())
        last[row.code] += 1
        connection.execute(update(CUTS).where(CUTS.c.id == row.id).values(nth=last[row.code]))
    if rows:  # it knew no course of a cut, and could have two open ones
        connection.execute(update(CUTS).where(CUTS.c.terms.is_(None) & CUTS.c.state.in_(OPEN)).values(state=UNFINISHED))


def _prepare_sqlite(connection: Any, _: Any) -> None:
    # A write-ahead log lets many read while one writes, and survives a kill; writers wait for each other.
    for setting in ("journal_mode=WAL", "foreign_keys=ON", "busy_timeout=15000", "synchronous=FULL"):
        connection.execute(f"PRAGMA {setting}")


def written(moment: datetime) -> str:
    """Return a moment as the database holds it (UTC, microseconds)."""
    return moment.astimezone(UTC).isoformat(timespec="microseconds")


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
