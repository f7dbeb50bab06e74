"""Members of a platform's course, fetched and not stored.

The service is LTI Names and Role Provisioning Services 2.0.  A roster says who of them has cut.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from email.message import Message
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode, urljoin, urlsplit

from cutenv.people.classroom.class_tables import SAVED
from cutenv.people.classroom.lesson import Lesson
from cutenv.people.classroom.lti_keys import AccessTokens
from cutenv.people.classroom.lti_platforms import (
    Platform,
    PlatformRefused,
    PlatformUnreachable,
    asked,
    checked_address,
    json_object,
    without_query,
)
from cutenv.people.classroom.lti_tool import LtiTool
from cutenv.people.play.course import WARM_UP

MEMBERS_SCOPE = "https://purl.imsglobal.org/spec/lti-nrps/scope/contextmembership.readonly"
"""Scope that the class asks for."""
MOST_MEMBERS = 2000
"""Members of a course that are shown; a platform with more is asked no further."""
NEVER_OPENED = "Nobody has opened the class from this course yet. Open it there once, as its teacher or a learner."
"""Trouble of a course whose members cannot be asked for: no launch has said where they are listed."""
NOT_OFFERED = "The platform offers the class no list of the members of this course."
"""Trouble of a course whose members cannot be asked for: its launches name no list."""
_MEDIA_TYPE = "application/vnd.ims.lti-nrps.v2.membershipcontainer+json"
_ON_A_PAGE, _MOST_PAGES, _WITHIN = 200, 200, 30.0  # members asked for at once; pages; [s] for all of them
_ROLE = re.compile(r"(?:http://purl\.imsglobal\.org/vocab/lis/v2/membership#)?([A-Za-z]{1,64})")
_LINK = re.compile(r'<([^<>]*)>((?:\s*;\s*[\w*-]+\s*=\s*(?:"[^"]*"|[^\s",;]+))*)')
_RELATIONS = re.compile(r';\s*rel\s*=\s*(?:"([^"]*)"|([^\s",;]+))', re.IGNORECASE)
_MAX_CHARACTERS, _LONGEST_NAME, _MOST_ROLES = (
    255,
    200,
    20,
)  # characters of an identifier and of a name; roles that are read


class CourseMember(NamedTuple):
    """Course member: platform identifier, name or "", and roles.

    ``roles`` are the last parts of the platform's identifiers, such as "Learner" and "Instructor".  ``active`` is False
    of one who may not open the course now.
    """

    subject: str
    name: str
    roles: tuple[str, ...]
    active: bool

    @property
    def learns(self) -> bool:
        """True for an active learner, who is expected to cut."""
        return self.active and "Learner" in self.roles


class CourseMembers(NamedTuple):
    """Members and title of a course.

    ``skipped`` had no identifier or roles, and ``more`` were not asked for.
    """

    title: str
    members: tuple[CourseMember, ...]
    skipped: int
    more: bool


class WrongMembers(PlatformUnreachable):
    """List of members that the class must not show."""


def course_members(platform: Platform, course: str, members_url: str, tokens: AccessTokens) -> CourseMembers:
    """Return a course's present members from its platform.

    Deleted members are left out; of two entries of one person the later one holds. The list must be of this course; its
    address is from a launch. Raises PlatformRefused if the platform does not give its list to the class,
    PlatformUnreachable if it gives none of this course, ValueError for an address that may not be asked or an
    unreadable key of the class.
    """
    checked_address("members_url", members_url, local=platform.is_local)
    place, title, found, skipped = without_query(members_url), "", dict[str, CourseMember | None](), 0
    try:
        for page in _pages(platform, members_url, tokens):
            if page is None:
                return CourseMembers(title, _present(found), skipped, True)
            given, listed = page.get("context"), page.get("members")
            context = given if isinstance(given, dict) else {}
            if _identifier(context.get("id")) != course:
                raise WrongMembers(f"{place} lists the members of the course {context.get('id')!r}, not {course!r}")
            if not isinstance(listed, list):
                raise WrongMembers(f"{place} lists no members")
            title = _line(context.get("title")) or _line(context.get("label"))
            for each in listed:
                member = _member(each)
                if member is None:
                    skipped += 1
                elif len(found) >= MOST_MEMBERS and member.subject not in found:
                    return CourseMembers(title, _present(found), skipped, True)
                else:
                    found[member.subject] = None if each.get("status") == "Deleted" else member
    except PlatformRefused as error:
        if error.status == 401:
            tokens.forget(platform, MEMBERS_SCOPE)
        raise
    return CourseMembers(title, _present(found), skipped, False)


def _present(found: Mapping[str, CourseMember | None]) -> tuple[CourseMember, ...]:
    return tuple(each for each in found.values() if each is not None)


def _pages(platform: Platform, members_url: str, tokens: AccessTokens) -> Iterator[dict[str, Any] | None]:
    """Yield the pages of a list, None beyond the page limit."""
    ends, seen = time.monotonic() + _WITHIN, set[str]()
    place = urlsplit(members_url)
    query = [*parse_qsl(place.query, keep_blank_values=True), ("limit", str(_ON_A_PAGE))]
    url = place._replace(query=urlencode(query), fragment="").geturl()
    while url:
        if len(seen) >= _MOST_PAGES:
            yield None
            return
        if url in seen:
            raise WrongMembers(f"{without_query(url)} leads from page to page in a circle")
        if time.monotonic() > ends:
            raise PlatformUnreachable(f"{without_query(url)} takes longer than {_WITHIN:g} s to answer")
        seen.add(url)
        headers = {"Authorization": f"Bearer {tokens.find(platform, MEMBERS_SCOPE)}", "Accept": _MEDIA_TYPE}
        content, about = asked(url, headers=headers)
        if about.get_content_type() != _MEDIA_TYPE:
            raise WrongMembers(
                f"{without_query(url)} answers with {about.get_content_type()}, which is no list of members"
            )
        yield json_object(url, content)
        url = _next_page(url, about)


def _next_page(url: str, about: Message) -> str:
    """Return the next page's address on the same server, or ""."""
    for header in about.get_all("Link", []):
        for address, parameters in _LINK.findall(header):
            relations = " ".join(quoted or bare for quoted, bare in _RELATIONS.findall(parameters))
            if "next" in relations.lower().split():
                found: str = urljoin(url, address)
                if urlsplit(found)[:2] != urlsplit(url)[:2]:  # the token is for this server alone
                    raise WrongMembers(f"{without_query(url)} leads to another server for its next page")
                return found
    return ""


def _member(given: Any) -> CourseMember | None:
    """Return a list entry's member, or None if it is incomplete."""
    if not isinstance(given, dict):
        return None
    subject, roles, status = _identifier(given.get("user_id")), given.get("roles"), given.get("status", "Active")
    if not subject or not isinstance(roles, list) or status not in ("Active", "Inactive", "Deleted"):
        return None
    parts = " ".join(filter(None, (_line(given.get(name)) for name in ("given_name", "family_name"))))
    # Sub-roles, and roles in the school or the platform as a whole, say nothing about this course.
    known = (_ROLE.fullmatch(each) for each in roles[:_MOST_ROLES] if isinstance(each, str))
    in_course = dict.fromkeys(each[1] for each in known if each)
    return CourseMember(subject, _line(given.get("name")) or parts, tuple(in_course), status == "Active")


def _identifier(value: Any) -> str:
    """Return an identifier as text, also from a number; else ""."""
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    return text if isinstance(text, str) and len(text) <= _MAX_CHARACTERS and text.isprintable() else ""


def _line(value: Any) -> str:
    """Return a name as one line; "" for none."""
    return " ".join(value.split())[:_LONGEST_NAME] if isinstance(value, str) else ""


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


def course_rosters(tool: LtiTool, lesson: Lesson) -> Iterator[CourseRoster]:
    """Yield a roster of each course whose teachers teach in the class."""
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
