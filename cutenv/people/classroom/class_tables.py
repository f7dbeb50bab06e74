"""Tables of a class's database, states of a cut, and constraints."""

from __future__ import annotations

from sqlalchemy import Column, ForeignKey, Index, Integer, MetaData, String, Table, Text

CLASS_METADATA = MetaData()
PEOPLE = Table(
    "people",
    CLASS_METADATA,
    Column("code", String(64), primary_key=True),
    Column("created", String(32), nullable=False),
    Column("consented", String(32)),
)
CLASS_PLACES = Table(  # where a person belongs; whoever is in no class, group or further course has no row
    "places",
    CLASS_METADATA,
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), primary_key=True),
    Column("class_name", String(32), nullable=False),
    Column("group_name", String(32), nullable=False),
    Column("course", String(32)),  # file of a further course, without its ending
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
    Column("nth", Integer),  # 1, 2, ... of the person: the order, whatever the clock says
    Column("specimen_class", String(16), nullable=False),
    Column("seed", Integer, nullable=False),
    Column("target_length_um", Integer),  # whole, so that every database gives it back
    Column("course", String(200)),
    Column("task", String(200)),
    Column("terms", String(32)),  # digest of what defines the cuts of the task
    Column("handed_out", String(32), nullable=False),
    Column("begun", String(32)),
    Column("state", String(16), nullable=False),
    Column("record", String(200)),
    Column("outcome", String(200)),
    Column("score", Integer),
    Column("reason", String(500)),
    Column("ended", String(32)),
    Column("numbers", Text),  # those that a mark may limit, JSON
    Column("movements", String(64)),  # SHA-256
    Column("stalled_ms", Integer),
    Column("example", Integer),  # 1 if the teacher shows it beside replays of the same specimen
)
SESSIONS = Table(
    "sessions",
    CLASS_METADATA,
    Column("token_hash", String(64), primary_key=True),
    Column("code", String(64), nullable=False),
    Column("expires", String(32), nullable=False),
    Column("seen", String(32)),
)
COMMENTS = Table(  # of the teacher, to a person
    "comments",
    CLASS_METADATA,
    Column("id", String(32), primary_key=True),
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), nullable=False),
    Column("written", String(32), nullable=False),
    Column("said", String(500), nullable=False),
)
LTI_PEOPLE = Table(  # who came from a learning platform, by the platform's own identifier; no name
    "lti_people",
    CLASS_METADATA,
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), primary_key=True),
    Column("issuer", String(255), nullable=False),
    Column("deployment", String(255), nullable=False),
    Column("subject", String(255), nullable=False),
)
LTI_GRADES = Table(  # where a person's grades go, and how far they have gone
    "lti_grades",
    CLASS_METADATA,
    Column("code", String(64), ForeignKey("people.code", ondelete="CASCADE"), primary_key=True),
    Column("line_item", String(1000), primary_key=True),  # address of a column of the platform's gradebook
    Column("client_id", String(255), nullable=False),
    Column("task", String(200), nullable=False),  # "" for the whole course
    Column("counted", Integer, nullable=False),  # saved cuts that the grade sent last takes in
    Column("sent", Integer),
    Column("since", String(32)),  # when it was sent
    Column("trouble", String(300), nullable=False),
)
LTI_COURSES = Table(  # courses of platforms whose teachers teach here, and where their members are listed
    "lti_courses",
    CLASS_METADATA,
    Column("issuer", String(255), primary_key=True),
    Column("client_id", String(255), primary_key=True),
    Column("course", String(255), primary_key=True),
    Column("members_url", String(1000), nullable=False),  # "" if the platform offers no list
)
LTI_NONCES = Table(  # launches that were used, until they are too old anyway
    "lti_nonces",
    CLASS_METADATA,
    Column("nonce", String(64), primary_key=True),
    Column("expires", String(32), nullable=False),
)
TRIAL = "TRY0"
"""Code by which the teacher tries a lesson: nobody enters by it, and no list, study or export has its cuts."""
BACKED_UP = (PEOPLE, CLASS_PLACES, CUTS, PASS_MARKS, COMMENTS, LTI_PEOPLE, LTI_GRADES)
"""Tables of a backup, in the order in which they are filled; nobody stays signed in."""
PREPARED, GOING_ON, BROKEN_OFF = "prepared", "going on", "broken off"
"""States of an open cut: handed out; begun; going on when the server ended, whose page may still send it."""
OPEN = (PREPARED, GOING_ON, BROKEN_OFF)
"""States of which a person has at most one cut, whatever the number of servers."""
SAVED, REFUSED, LEFT = "saved", "refused", "left"
"""States of a cut that has ended; one that was begun and left counts as given up."""
UNFINISHED, TAKEN_BACK = "unfinished", "taken back"
"""States of a cut that counts for nothing: the server ended while it went on; its task is served no more."""
FOREIGN = "foreign"
"""State of a cut that another program recorded: it was not handed out, and no law confirms it."""
KEPT = (SAVED, FOREIGN)
"""States of a cut that has a record."""
INDEXES = (
    Index("cuts_in_order", CUTS.c.code, CUTS.c.nth, unique=True),
    Index(
        "one_open_cut",
        CUTS.c.code,
        unique=True,
        sqlite_where=CUTS.c.state.in_(OPEN),
        postgresql_where=CUTS.c.state.in_(OPEN),
    ),
    Index("movements_once", CUTS.c.movements, unique=True),
    Index("one_code", LTI_PEOPLE.c.issuer, LTI_PEOPLE.c.deployment, LTI_PEOPLE.c.subject, unique=True),
)
"""Indexes of the tables: one cut of each number and one open cut of a person, no movements twice, one code a person."""
