"""Who of a platform's course has cut and who not yet, by the platform's list of members (LTI NRPS 2.0)."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from class_room import check_nothing_is_english
from lti_platform import CLAIM, CONTAINER, COURSE, MEMBERS, NRPS, ROLE, SCORE
from lti_room import LtiRoom, launched, learner, saved

from cutenv.people.classroom.lti_members import course_members
from cutenv.people.play.course import WARM_UP

STUDENT = "http://purl.imsglobal.org/vocab/lis/v2/institution/person#Student"
ASSISTANT = "http://purl.imsglobal.org/vocab/lis/v2/membership/Instructor#TeachingAssistant"
OF_TEACHER = {f"{CLAIM}roles": [f"{ROLE}Instructor"]}


def member(subject: str, name: str = "", role: str = f"{ROLE}Learner", **further: Any) -> dict[str, Any]:
    return {"user_id": subject, "roles": [role], "status": "Active"} | ({"name": name} if name else {}) | further


@pytest.fixture
def room(tmp_path: Path) -> Iterator[LtiRoom]:
    with LtiRoom(tmp_path) as made:
        made.register(teacher_courses=[COURSE])
        yield made


def roster(room: LtiRoom) -> list[tuple[str, str, str]]:
    """Rows of the page: name, role, and what the class knows."""
    answer = room.teacher().get("/teacher/members")
    assert answer.status_code == 200
    rows = re.findall(r'<tr><th scope="row">(.*?)</th>\s*<td>(.*?)</td>\s*<td>(.*?)</td></tr>', answer.text, re.DOTALL)
    assert len(rows) == answer.text.count("<tr><th scope")
    return [tuple(html.unescape(re.sub(r"<.*?>", "", cell)) for cell in row) for row in rows]


def troubles(room: LtiRoom) -> str:
    answer = room.teacher().get("/teacher/members")
    assert answer.status_code == 200
    return html.unescape(" ".join(re.findall(r'<p class="trouble">(.*?)</p>', answer.text)))


def test_the_teacher_sees_by_name_and_role_who_has_not_cut_yet(room: LtiRoom, tmp_path: Path) -> None:
    room.platform.container["context"] |= {"title": "Surgery 101"}
    room.platform.members = [
        member("t1", "Grace Hopper", f"{ROLE}Instructor", roles=[f"{ROLE}Instructor", ASSISTANT, STUDENT]),
        member("u1", "Ada Lovelace"), member("u2", "Édouard <b>"), member("u3"), member("u4", role="Learner"),
        member("u5", given_name="Emmy", family_name="Noether", role="Mentor"), member("u6", "Zed", status="Inactive"),
        member("u7", "Gone", status="Deleted"), member("u2", "Édouard"),
    ]  # fmt: skip
    saved(room, learner(room, "u1")[1], 70.0)
    saved(room, learner(room, "u1")[1], 80.0)
    _, code = learner(room, "u2")
    saved(room, code, 90.0, WARM_UP)
    assert roster(room) == [
        ("without a name, ID u3", "learner", "has not been here yet"),
        ("without a name, ID u4", "learner", "has not been here yet"),
        ("Édouard", "learner", "has agreed, no cut yet"),
        ("Ada Lovelace", "learner", "cuts saved: 2"),
        ("Emmy Noether", "mentor", "has not been here yet"),
        ("Grace Hopper", "teacher", "has not been here yet"),
        ("Zed", "learner", "has not been here yet (inactive in the course)"),
    ]
    page = room.teacher().get("/teacher/members").text
    assert "Surgery 101" in page
    assert "not cut yet: 3 of 4 learners" in page
    assert code not in page, "names and codes stand together in the platform alone"
    pages = [path for path in room.platform.asked if "memberships" in path]
    assert len(pages) == 10
    assert len(set(pages)) == 5
    assert room.platform.asked.count("/token") == 1
    room.store.engine.dispose()
    everything = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    for name in ("Lovelace", "Édouard", "Hopper"):
        assert name.encode() not in everything


def test_only_the_teacher_sees_the_members(room: LtiRoom) -> None:
    client, _ = learner(room)
    assert client.get("/teacher/members").status_code == 401
    assert room.client().get("/teacher/members").status_code == 401
    assert not any("memberships" in path for path in room.platform.asked)


def test_a_course_that_was_never_opened_and_a_class_without_courses_say_what_to_do(room: LtiRoom) -> None:
    assert "Nobody has opened the class from this course yet" in troubles(room)
    assert f"Course {COURSE}" in room.teacher().get("/teacher/members").text
    room.register()
    assert "No course is named yet" in room.teacher().get("/teacher/members").text


@pytest.mark.parametrize(
    "offered",
    [
        None, "x", {}, {"context_memberships_url": "https://x/m", "service_versions": ["1.0"]},
        {"context_memberships_url": "https://x/m"}, {"context_memberships_url": 7, "service_versions": ["2.0"]},
        {"context_memberships_url": "https://x/" + "m" * 1000, "service_versions": ["2.0"]},
    ],
)  # fmt: skip
def test_a_platform_that_offers_no_list_is_not_asked(room: LtiRoom, offered: Any) -> None:
    learner(room)
    learner(room, **{NRPS: offered})
    assert troubles(room) == "The platform offers the class no list of the members of this course."
    assert "Let the platform give the class its list" in room.teacher().get("/teacher/members").text
    assert not any("memberships" in path for path in room.platform.asked)
    learner(room)
    room.platform.members = [member("u1", "Ada")]
    assert len(roster(room)) == 1, "offered again"


def test_a_course_whose_teachers_do_not_teach_here_is_not_asked_for(room: LtiRoom) -> None:
    learner(room, **{f"{CLAIM}context": {"id": "13"}})
    learner(room, **{f"{CLAIM}context": None})
    assert room.tool.people.members_url(*room.tool.file.platforms[0].key, "13") is None
    launched(room, room.client(), "t1", **OF_TEACHER)
    room.platform.members = [member("u1", "Ada")]
    assert len(roster(room)) == 1, "a teacher's launch is enough"
    room.register(teacher_courses=["13"])
    assert "Nobody has opened the class" in troubles(room)


@pytest.mark.parametrize("context", [{"id": "13"}, {}, None, "12"])
def test_a_list_of_another_course_is_not_shown(room: LtiRoom, context: Any) -> None:
    learner(room)
    room.platform.container["context"] = context
    room.platform.members = [member("u1", "Ada")]
    assert "lists the members of the course" in troubles(room)
    assert "Ada" not in room.teacher().get("/teacher/members").text


def test_a_platform_that_refuses_the_scope_says_so_and_grades_still_go(room: LtiRoom) -> None:
    room.platform.scopes = {SCORE}
    saved(room, learner(room)[1], 70.0)
    assert troubles(room) == f"{room.platform.issuer}/token answers 400"
    assert "Let the platform give the class its list" in room.teacher().get("/teacher/members").text
    room.tool.grades.deliver()
    assert len(room.platform.scores) == 1


def test_a_token_for_grades_opens_no_list_and_one_that_has_ended_is_renewed(room: LtiRoom) -> None:
    saved(room, learner(room)[1], 70.0)
    room.tool.grades.deliver()
    room.platform.members = [member("u1", "Ada")]
    assert len(roster(room)) == 1
    room.platform.forget_tokens()
    assert "answers 401" in troubles(room)
    assert len(roster(room)) == 1


@pytest.mark.parametrize("status", [302, 403, 404, 500])
def test_a_list_that_is_refused_amid_its_pages_is_not_shown_in_part(room: LtiRoom, status: int) -> None:
    learner(room)
    room.platform.members = [member(f"u{k}", f"Ada {k}") for k in range(5)]
    assert len(roster(room)) == 5
    room.platform.answers = [None, status]
    assert f"/{COURSE}/memberships answers {status}" in troubles(room)
    assert len(roster(room)) == 5


def test_other_answers_are_no_lists(room: LtiRoom) -> None:
    learner(room)
    room.platform.kind = "application/json"
    assert "answers with application/json, which is no list of members" in troubles(room)
    room.platform.kind = CONTAINER
    room.platform.members = ""  # type: ignore[assignment]
    assert "lists no members" in troubles(room)


def test_entries_that_say_too_little_are_left_out_and_counted(room: LtiRoom) -> None:
    learner(room)
    room.platform.members = [
        member("u1", "Ada"), {"user_id": "u2"}, {"roles": ["Learner"]}, member(""), member("x" * 256),
        member("u3", "Bo", status="Away"), member("u4", "Cy", roles=[7, STUDENT]),
        member("u5", name="D\n\tE " + "x" * 300),
        "nobody", None,
    ]  # type: ignore[list-item]  # fmt: skip
    shown = roster(room)
    assert [row[0][:20] for row in shown] == ["Ada", "D E " + "x" * 16, "Cy"]
    assert shown[2][1] == "–"
    assert len(shown[1][0]) == 200
    assert "Left out, because the platform gives no identifier or role for them: 7." in (
        room.teacher().get("/teacher/members").text
    )


def test_identifiers_may_be_numbers(room: LtiRoom) -> None:
    """Moodle writes those of its database, which some drivers give as numbers."""
    room.platform.container["context"]["id"] = int(COURSE)
    room.platform.members = [member("", user_id=7), member("", user_id=True)]
    saved(room, learner(room, "7")[1], 70.0)
    assert roster(room) == [("without a name, ID 7", "learner", "cuts saved: 1")]


def test_pages_in_a_circle_and_to_another_server_end(room: LtiRoom) -> None:
    learner(room)
    room.platform.members = [member(f"u{k}") for k in range(9)]
    room.platform.next_page = lambda start: f"{room.platform.members_url}&start=2"
    assert "in a circle" in troubles(room)
    room.platform.next_page = lambda start: "https://evil.example/members"
    assert "leads to another server" in troubles(room)
    room.platform.next_page = lambda start: f"/{COURSE}/memberships?type_id=1&start={start}"
    assert len(roster(room)) == 9, "an address may be relative"


def test_pages_without_an_end_and_members_beyond_the_most_are_cut_off(
    room: LtiRoom, monkeypatch: pytest.MonkeyPatch
) -> None:
    learner(room)
    room.platform.members = [member(f"u{k}", f"Ada {k}") for k in range(30)]
    monkeypatch.setattr("cutenv.people.classroom.lti_members._MOST_PAGES", 4)
    assert "These are the first 8." in troubles(room)
    assert len(roster(room)) == 8
    monkeypatch.setattr("cutenv.people.classroom.lti_members._MOST_PAGES", 100)
    monkeypatch.setattr("cutenv.people.classroom.lti_members.MOST_MEMBERS", 29)
    assert "These are the first 29." in troubles(room)
    monkeypatch.setattr("cutenv.people.classroom.lti_members.MOST_MEMBERS", 30)
    assert troubles(room) == ""
    monkeypatch.setattr("cutenv.people.classroom.lti_members._WITHIN", 0.0)
    assert "takes longer than 0 s" in troubles(room)


def test_a_list_without_encryption_is_not_asked_for(room: LtiRoom) -> None:
    (platform,) = room.tool.file.platforms
    with pytest.raises(ValueError, match="members_url = 'http://elsewhere/m' is not encrypted"):
        course_members(platform, COURSE, "http://elsewhere/m", room.tool.tokens)
    learner(room, **{NRPS: {"context_memberships_url": "http://elsewhere/m", "service_versions": ["2.0"]}})
    assert "is not encrypted" in troubles(room)
    assert MEMBERS not in room.platform._tokens.values()


def test_nothing_english_is_left_of_the_page_in_german(tmp_path: Path) -> None:
    room = LtiRoom(tmp_path, language="de")
    teacher = room.teacher()
    seen = [teacher.get("/teacher/members").text]
    room.register(teacher_courses=[COURSE])
    seen.append(teacher.get("/teacher/members").text)
    learner(room, **{NRPS: None})
    seen.append(teacher.get("/teacher/members").text)
    learner(room)
    roles = ("Instructor", "Learner", "Administrator", "ContentDeveloper", "Mentor", "Manager", "Member", "Officer")
    room.platform.members = [member(f"u{k}", role=ROLE + role) for k, role in enumerate(roles)] + [member("x", roles=0)]
    seen.append(teacher.get("/teacher/members").text)
    assert "noch nicht geschnitten: 1 von 1 Lernenden" in seen[-1]
    room.platform.kind = "text/plain"
    seen.append(teacher.get("/teacher/members").text)
    check_nothing_is_english(*seen)
    room.close()
