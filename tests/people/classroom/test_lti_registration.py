"""A learning platform that registers the class by itself (LTI Dynamic Registration), and what must not register."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from class_room import CLOCK, TOKEN, check_nothing_is_english
from lti_platform import CLIENT, DEPLOYMENT, TOOL, LearningPlatform
from lti_room import AT, LtiRoom, launched, learner, said, saved
from starlette.testclient import TestClient

from cutenv.people.classroom.lti_platforms import PLATFORMS_FILE

SCHOOL = "https://class.school.example"


@pytest.fixture
def room(tmp_path: Path) -> Iterator[LtiRoom]:
    """A class that no platform is registered with."""
    with LtiRoom(tmp_path) as made:
        made.tool.file.drop(made.platform.issuer, CLIENT)
        yield made


def invited(room: LtiRoom, base: str = AT) -> str:
    """Path of a registration address that the teacher has made at an address of the class."""
    teacher = TestClient(room.app, base_url=base, follow_redirects=False)
    teacher.post("/teacher", data={"token": TOKEN})
    shown = teacher.post("/teacher/platforms", data={"do": "invite"}).text
    (address,) = re.findall(rf"<code>{base}(/lti/register/[\w.-]+)</code>", shown)
    return str(address)


def asked(platform: LearningPlatform, **changed: str) -> dict[str, str]:
    """Parameters with which the platform opens a registration address."""
    configuration = f"{platform.issuer}/.well-known/openid-configuration"
    sent = {"openid_configuration": configuration, "registration_token": platform.registration_token}
    return sent | changed


def registered(room: LtiRoom, path: str | None = None, **changed: str) -> Any:
    """Answer to a platform that opens a registration address, by default a fresh one."""
    return room.client().get(invited(room) if path is None else path, params=asked(room.platform, **changed))


def test_a_platform_registers_once_and_its_people_come_in_and_get_grades(room: LtiRoom) -> None:
    answer = registered(room)
    assert answer.status_code == 200, answer.text
    assert 'postMessage({subject: "org.imsglobal.lti.close"}' in answer.text
    policy = answer.headers["Content-Security-Policy"]
    assert "frame-ancestors *" in policy
    assert "script-src 'sha256-" in policy
    (mine,) = room.tool.file.platforms
    wanted = room.platform.registration
    assert {name: getattr(mine, name) for name in wanted} == wanted | {"deployments": (DEPLOYMENT,)}
    assert mine.teacher_courses == (), "that is for the teacher to say"
    (sent,) = room.platform.registrations
    assert sent["initiate_login_uri"] == f"{AT}/lti/login"
    assert sent["redirect_uris"] == [f"{AT}/lti/launch", f"{AT}/lti/choose"]
    _, code = learner(room)
    saved(room, code, 71.0)
    room.tool.grades.deliver()
    assert [score["scoreGiven"] for _, score in room.platform.scores] == [71]


def test_a_registration_address_works_once_also_when_it_failed_and_for_two_at_once(room: LtiRoom) -> None:
    path = invited(room)
    room.platform.answers = [503]
    assert (registered(room, path).status_code, len(room.platform.asked)) == (502, 1)
    again = registered(room, path)
    assert (again.status_code, "has been used or is too old" in said(again)) == (403, True)
    assert len(room.platform.asked) == 1, "it is not asked again"
    path, answers = invited(room), []
    both = [threading.Thread(target=lambda: answers.append(registered(room, path).status_code)) for _ in range(2)]
    for each in both:
        each.start()
    for each in both:
        each.join()
    assert sorted(answers) == [200, 403]
    assert len(room.platform.registrations) == 1


def test_a_look_without_a_platform_uses_nothing_up(room: LtiRoom) -> None:
    path = invited(room)
    look = room.client().get(path)
    assert (look.status_code, "Paste this address" in said(look)) == (403, True)
    assert registered(room, path, registration_token="a\nb").status_code == 403
    assert registered(room, path).status_code == 200


def test_nobody_registers_without_an_address_that_the_teacher_made_within_an_hour(room: LtiRoom) -> None:
    path = invited(room)
    key, now = room.tool.key, CLOCK()
    forged = [key.signed({"base": AT}, audience, now, 3600) for audience in ("consent", room.platform.issuer)]
    changed = path[:-9] + ("A" if path[-9] != "A" else "B") + path[-8:]
    for bad in (*(f"/lti/register/{each}" for each in ("x", "a.b.c", "\u00e4", *forged)), changed):
        assert registered(room, bad).status_code == 403, bad
    CLOCK.ahead += timedelta(minutes=61)
    assert "has been used or is too old" in said(registered(room, path))
    assert room.platform.asked == []
    for client in (room.client(), learner_without_platform(room)):
        assert client.post("/teacher/platforms", data={"do": "invite"}).status_code == 401
    evil = {"Origin": "https://evil.example"}
    assert room.teacher().post("/teacher/platforms", data={"do": "invite"}, headers=evil).status_code == 403


def learner_without_platform(room: LtiRoom) -> TestClient:
    room.store.add_code("ABC123456")
    client = room.client()
    assert client.post("/", data={"code": "ABC123456", "consent": "yes"}).status_code == 303
    return client


def test_the_address_of_the_class_is_that_of_the_teacher_and_no_header_changes_it(room: LtiRoom) -> None:
    path = invited(room)
    elsewhere = TestClient(room.app, base_url="https://evil.example", follow_redirects=False)
    assert elsewhere.get(path, params=asked(room.platform)).status_code == 200
    (sent,) = room.platform.registrations
    assert sent["jwks_uri"] == f"{AT}/lti/jwks"


def test_a_class_without_encryption_makes_no_registration_address(room: LtiRoom) -> None:
    teacher = TestClient(room.app, base_url="http://class", follow_redirects=False)
    teacher.post("/teacher", data={"token": TOKEN})
    shown = teacher.post("/teacher/platforms", data={"do": "invite"}).text
    assert "/lti/register/" not in shown
    assert "start the server with --certificate" in shown


@pytest.mark.parametrize(
    ("described", "why"),
    [
        ({"issuer": "https://moodle.school.example"}, "cannot speak for the platform 'https://moodle.school.example'"),
        ({"issuer": lambda at: f"{at}/other"}, "cannot speak for the platform"),
        ({"issuer": lambda at: at[:-1]}, "cannot speak for the platform"),
        ({"issuer": None}, "does not say its issuer"),
        ({"issuer": ["x"]}, "does not say its issuer"),
        ({"issuer": "http://10.0.0.5"}, "issuer = 'http://10.0.0.5' is not encrypted"),
        ({"jwks_uri": "http://169.254.169.254/latest"}, "jwks_uri = 'http://169.254.169.254/latest' is not encrypted"),
        ({"token_endpoint": "file:///etc/passwd"}, "token_endpoint = 'file:///etc/passwd' is no"),
        ({"authorization_endpoint": None}, "does not say its authorization_endpoint"),
        ({"registration_endpoint": "http://10.0.0.5/x"}, "registration_endpoint = 'http://10.0.0.5/x' is not"),
        ({"registration_endpoint": "https://elsewhere.example/x"}, "is not on the platform"),
        ({"registration_endpoint": "http://127.0.0.1:1/x"}, "is not on the platform"),
        ({"authorization_server": 5}, "does not say its authorization_server"),
        ({"padding": "x" * 300_000}, "answers with more than 256 kB"),
    ],
)
def test_a_platform_that_does_not_describe_itself_soundly_is_not_registered(
    room: LtiRoom, described: dict[str, Any], why: str
) -> None:
    at = room.platform.issuer
    room.platform.described = {name: value(at) if callable(value) else value for name, value in described.items()}
    assert why in said(registered(room))
    assert room.platform.asked == ["/.well-known/openid-configuration"], "and gets no token"
    assert room.tool.file.platforms == ()


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ({"client_id": None}, "does not say its client_id"),
        ({"client_id": 5}, "does not say its client_id"),
        ({"client_id": "x" * 300}, "more than 255"),
        ({TOOL: None}, f"names no deployment of its client '{CLIENT}'"),
        ({TOOL: {"deployment_id": 1}}, "names no deployment"),
        ({TOOL: ["deployment_id"]}, "names no deployment"),
    ],
)
def test_an_answer_that_is_not_sound_registers_nothing(room: LtiRoom, answer: dict[str, Any], why: str) -> None:
    room.platform.registered = answer
    assert why in said(registered(room))
    assert room.tool.file.platforms == ()


def test_redirects_errors_and_silence_end_a_registration(room: LtiRoom, monkeypatch: pytest.MonkeyPatch) -> None:
    for planned in ([302], [401], [None, 302], [None, 401]):
        room.platform.answers = list(planned)
        answer = registered(room)
        assert (answer.status_code, f"answers {planned[-1]}" in said(answer)) == (502, True)
    monkeypatch.setattr("cutenv.people.classroom.lti_platforms._WITHIN", 0.3)
    hangs = threading.Event()
    room.platform.answers = [hangs]
    answer = registered(room)
    hangs.set()
    assert (answer.status_code, "cannot be reached" in said(answer)) == (502, True)
    assert room.tool.file.platforms == ()


@pytest.mark.parametrize(
    "address",
    ["http://127.0.0.1:{port}/x", "http://localhost:{port}/x", "http://10.0.0.5/x", "file:///etc/passwd", "x"],
)
def test_a_class_that_is_no_trial_asks_by_https_alone(room: LtiRoom, address: str) -> None:
    path, port = invited(room, SCHOOL), room.platform.server_address[1]
    for base in (SCHOOL, AT):  # whatever the request calls the class
        client = TestClient(room.app, base_url=base, follow_redirects=False)
        answer = client.get(path, params=asked(room.platform, openid_configuration=address.format(port=port)))
        assert answer.status_code == 403
        assert said(answer).startswith("openid_configuration = ")
    assert room.platform.asked == []


def test_a_known_client_is_not_replaced_and_a_damaged_file_is_left(room: LtiRoom, tmp_path: Path) -> None:
    room.register(teacher_courses=["12"])
    assert "is registered already" in said(registered(room))
    assert [each.teacher_courses for each in room.tool.file.platforms] == [("12",)]
    asked_before = len(room.platform.asked)
    (tmp_path / PLATFORMS_FILE).write_text("[[platform]\n", encoding="utf-8")
    assert "is no TOML file" in said(registered(room))
    assert len(room.platform.asked) == asked_before
    assert (tmp_path / PLATFORMS_FILE).read_text(encoding="utf-8") == "[[platform]\n"


def test_another_audience_of_access_tokens_is_kept(room: LtiRoom) -> None:
    room.platform.described = {"authorization_server": "https://tokens.school.example"}
    assert registered(room).status_code == 200
    assert [each.token_audience for each in room.tool.file.platforms] == ["https://tokens.school.example"]
    assert launched(room, room.client()).status_code == 200


def test_nothing_english_is_left_of_what_a_german_class_says_of_a_registration(tmp_path: Path) -> None:
    room = LtiRoom(tmp_path, language="de")
    pages = [registered(room), room.client().get(invited(room)), registered(room, "/lti/register/x")]
    pages.append(room.teacher().post("/teacher/platforms", data={"do": "invite"}))
    pages.append(registered(room, registration_token="\n"))
    for described in (
        {"issuer": None},
        {"issuer": f"{room.platform.issuer}/x"},
        {"registration_endpoint": "http://[::1]"},
    ):
        room.platform.described = described
        pages.append(registered(room))
    room.platform.described, room.platform.registered = {}, {TOOL: None}
    pages.append(registered(room))
    room.tool.file.drop(room.platform.issuer, CLIENT)
    room.platform.registered = {}
    pages.append(registered(room))
    check_nothing_is_english(*(page.text for page in pages))
    assert [page.status_code for page in pages] == [403, 403, 403, 200, 403, 403, 403, 403, 403, 200]
    room.close()
