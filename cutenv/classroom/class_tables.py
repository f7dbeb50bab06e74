"""Tables of a class's database."""

from __future__ import annotations

from sqlalchemy import Column, ForeignKey, Index, Integer, MetaData, String, Table

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
