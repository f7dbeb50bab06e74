"""Queue of cuts whose statements go to a learning record store: in the class's database, so that no end loses it."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime

from sqlalchemy import Column, ForeignKey, String, Table, func, insert, select
from sqlalchemy.exc import IntegrityError

from cutenv.classroom.class_store import SAVED, ClassStore, HandedOutCut
from cutenv.classroom.class_tables import CLASS_METADATA, CUTS

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
    """Saved cuts, of people who agreed to it, whose statements have not been delivered.

    The cuts themselves are the queue: a cut that is saved waits, whatever happens to the server then.

    Parameters
    ----------
    store : ClassStore
        Database of the class.
    """

    def __init__(self, store: ClassStore) -> None:
        self._store = store
        CLASS_METADATA.create_all(store.engine, tables=[_agreed, _delivered])

    def agree(self, code: str) -> None:
        """Note that a person agreed that statements of the cuts from now on are sent."""
        with suppress(IntegrityError), self._store.engine.begin() as connection:  # who agreed before has done so
            connection.execute(
                insert(_agreed).values(code=code, since=datetime.now(UTC).isoformat(timespec="microseconds"))
            )

    def due(self, most: int) -> list[HandedOutCut]:
        """Return the first cuts that wait, in order."""
        wanted = select(CUTS.c.id, CUTS.c.code).where(_waits).order_by(CUTS.c.handed_out).limit(most)
        with self._store.engine.begin() as connection:
            rows = connection.execute(wanted).all()
        found = []
        for row in rows:
            with suppress(LookupError):  # deleted at this moment
                found.append(self._store.cut(row.id, row.code))
        return found

    def waiting(self) -> int:
        """Return the number of cuts that wait."""
        with self._store.engine.begin() as connection:
            return int(connection.execute(select(func.count()).select_from(CUTS, _agreed).where(_waits)).scalar_one())

    def done(self, number: str, trouble: str = "") -> None:
        """Note that a cut's statement has arrived, or that it never will, with the reason."""
        with suppress(IntegrityError), self._store.engine.begin() as connection:  # another server's, or deleted by now
            connection.execute(insert(_delivered).values(cut=number, trouble=trouble[:300]))

    def troubles(self) -> list[str]:
        """Return why statements never arrived, one reason for each."""
        with self._store.engine.begin() as connection:
            return [row.trouble for row in connection.execute(select(_delivered).where(_delivered.c.trouble != ""))]
