"""Roster of a platform's course: members who have or have not cut."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from cutenv.people.classroom.class_tables import SAVED
from cutenv.people.classroom.lesson import Lesson
from cutenv.people.classroom.lti_members import CourseMember, course_members
from cutenv.people.classroom.lti_platforms import Platform, PlatformRefused
from cutenv.people.classroom.lti_tool import LtiTool
from cutenv.people.play.course import WARM_UP


class RosterRow(NamedTuple):
    """Course member with the number of saved cuts, None if never entered."""

    member: CourseMember
    cuts: int | None


class CourseRoster(NamedTuple):
    """Members of a course, learners without cuts first, or ``trouble``.

    ``skipped`` entries of the platform's list could not be read; ``more`` is True if it is longer than what is shown.
    ``refused`` is True if the platform does not let the class see its list.
    """

    platform: Platform
    course: str
    title: str = ""
    rows: tuple[RosterRow, ...] = ()
    skipped: int = 0
    more: bool = False
    trouble: str = ""
    refused: bool = False

    @property
    def learners(self) -> int:
        """Number of active learners."""
        return sum(row.member.learns for row in self.rows)

    @property
    def without_cut(self) -> int:
        """Number of active learners who have not cut yet."""
        return sum(row.member.learns and not row.cuts for row in self.rows)


NEVER_OPENED = "Nobody has opened the class from this course yet. Open it there once, as its teacher or a learner."
"""Trouble of a course whose members cannot be asked for: no launch has said where they are listed."""
NOT_OFFERED = "The platform offers the class no list of the members of this course."
"""Trouble of a course whose members cannot be asked for: its launches name no list."""


def course_rosters(tool: LtiTool, lesson: Lesson) -> Iterator[CourseRoster]:
    """Yield a roster of each course whose teachers teach in the class.

    Parameters
    ----------
    tool : LtiTool
        The class as a tool of the platforms, which are asked.
    lesson : Lesson
        The class.
    """
    counts = Counter(cut.code for cut in lesson.store.cuts() if cut.state == SAVED and cut.task != WARM_UP)
    for platform in tool.file.platforms:
        for course in platform.teacher_courses:
            yield _roster(tool, platform, course, counts)


def _roster(tool: LtiTool, platform: Platform, course: str, counts: Counter[str]) -> CourseRoster:
    members_url = tool.people.members_url(*platform.key, course)
    if not members_url:
        trouble = NEVER_OPENED if members_url is None else NOT_OFFERED
        return CourseRoster(platform, course, trouble=trouble, refused=members_url is not None)
    try:
        found = course_members(platform, course, members_url, tool.tokens)
    except (OSError, ValueError) as error:
        return CourseRoster(platform, course, trouble=str(error), refused=isinstance(error, PlatformRefused))
    codes, rows = tool.people.codes(platform.issuer), []
    for member in found.members:
        mine = codes.get(member.subject)
        rows.append(RosterRow(member, None if mine is None else sum(counts[code] for code in mine)))
    rows.sort(key=lambda row: (not row.member.learns, bool(row.cuts), row.member.name.casefold(), row.member.subject))
    return CourseRoster(platform, course, found.title, tuple(rows), found.skipped, found.more)
