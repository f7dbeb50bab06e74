"""A class in a learning platform (LTI 1.3): who is let in, what a link leads to, which grade goes back."""

from __future__ import annotations

import html
import re
import stat
import sys
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from class_room import CLOCK, TOKEN, Room, check_nothing_is_english, cut_once, there_and_back
from lti_platform import AGS, CLAIM, CLIENT, COURSE, DEPLOYMENT, DL, FIRST, ROLE, SCORE, LearningPlatform, Signer
from lti_room import AT, LtiRoom, enter, hidden, launched, learner, said, saved, sent_there
from starlette.testclient import TestClient

from cutenv.commands.serve import main
from cutenv.people.browser import HandCut
from cutenv.people.classroom import ClassStore
from cutenv.people.classroom.class_backup import restore_backup, write_backup
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.classroom.class_store import CutEnd, NewCut
from cutenv.people.classroom.lti_grades import grade_of
from cutenv.people.classroom.lti_people import Learner
from cutenv.people.classroom.lti_platforms import PLATFORMS_FILE, platform_of, platforms_toml, read_platforms
from cutenv.people.classroom.lti_tool import LtiTool
from cutenv.people.classroom.xapi_statements import Courier, StatementQueue
from cutenv.people.play.course import WARM_UP, course_of

COURSE_FILE = """name = "first cuts"
[[task]]
name = "even tissue"
specimen_class = "uniform"
seeds = [5]
[[task]]
name = "liver"
specimen_class = "liver"
feedback = "{feedback}"
"""


@pytest.fixture
def room(tmp_path: Path) -> Iterator[LtiRoom]:
    with LtiRoom(tmp_path) as made:
        yield made


@pytest.fixture
def in_course(tmp_path: Path) -> Iterator[LtiRoom]:
    with LtiRoom(tmp_path, COURSE_FILE.format(feedback="always")) as made:
        yield made


# Launches


def test_a_learner_comes_in_under_a_code_and_no_name_is_stored(room: LtiRoom, tmp_path: Path) -> None:
    client = room.client()
    asked = launched(room, client)
    assert asked.status_code == 200
    assert "Neither your name nor your e-mail address" in asked.text
    assert room.store.codes() == [], "nothing of the person is stored before"
    refused = client.post("/lti/agree", data=hidden(asked.text))
    assert refused.status_code == 403
    assert room.store.codes() == []
    entered = client.post("/lti/agree", data=hidden(refused.text) | {"consent": "yes"})
    assert entered.headers["Location"] == "../cut"
    ((code, agreed),) = room.store.codes()
    assert agreed
    assert code in client.get("/cut").text
    assert cut_once(client)[0].status_code == 200
    assert room.store.places()[code].class_name == "SURG101"
    room.store.engine.dispose()
    everything = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    for name in (b"Ada", b"Lovelace", b"ada@school"):
        assert name not in everything


def test_who_comes_again_has_the_same_code_and_is_not_asked_again(room: LtiRoom) -> None:
    _, code = learner(room)
    again = room.client()
    assert launched(room, again).headers["Location"] == "../cut"
    assert code in again.get("/cut").text
    _, other = learner(room, "u2")
    assert other != code
    assert len(room.store.codes()) == 2


def test_a_platform_may_begin_by_a_form_and_without_what_is_optional(room: LtiRoom) -> None:
    client = room.client()
    asked = room.platform.initiation("u1", f"{AT}/lti/launch")
    least = {name: asked[name] for name in ("iss", "login_hint", "target_link_uri")}
    answer = client.post("/lti/login", data=least, headers={"Origin": "https://moodle.school.example"})
    assert answer.headers["Location"].startswith(f"{room.platform.issuer}/auth?kind=lti&")
    assert "lti_message_hint" not in answer.headers["Location"]


def _without(name: str) -> dict[str, Any]:
    return {name: None}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"aud": "another-tool"}, "is not registered with the platform"),
        ({"aud": ["another-tool"]}, "is not registered with the platform"),
        ({"aud": [CLIENT, "another-tool"]}, "meant for None"),
        ({"aud": [CLIENT, "another-tool"], "azp": "another-tool"}, "meant for 'another-tool'"),
        ({"azp": "another-tool"}, "meant for 'another-tool'"),
        ({"iss": "https://elsewhere.example"}, "is not registered with the platform 'https://elsewhere.example'"),
        (_without("iss"), "is not registered with the platform None"),
        ({"exp": lambda now: now - 120}, "too old"),
        ({"iat": lambda now: now - 700}, "too old, or a clock is wrong"),
        ({"iat": lambda now: now + 120}, "too old, or a clock is wrong"),
        ({"nbf": lambda now: now + 120}, "not valid yet"),
        (_without("exp"), "has no exp"),
        (_without("iat"), "has no iat"),
        ({"exp": True}, "has no exp"),
        ({"exp": float("nan")}, "has no exp"),
        ({"exp": 10**400}, "has no exp"),
        ({"nonce": "made up"}, "answers no request of this browser"),
        (_without("nonce"), "answers no request of this browser"),
        ({f"{CLAIM}deployment_id": "2"}, "The deployment '2'"),
        ({f"{CLAIM}deployment_id": 1}, "The deployment 1 "),
        (_without(f"{CLAIM}deployment_id"), "The deployment None"),
        ({f"{CLAIM}version": "1.1"}, "of version '1.1'"),
        (_without(f"{CLAIM}version"), "of version None"),
        ({f"{CLAIM}message_type": "LtiSubmissionReviewRequest"}, "'LtiSubmissionReviewRequest'"),
        (_without(f"{CLAIM}message_type"), "a message None"),
        (_without("sub"), "does not say who comes"),
        ({"sub": 7}, "does not say who comes"),
        ({"sub": "x" * 300}, "does not say who comes"),
        ({f"{CLAIM}roles": f"{ROLE}Learner"}, "names no roles"),
        ({f"{CLAIM}roles": []}, "no learner of this course"),
        ({f"{CLAIM}roles": ["http://purl.imsglobal.org/vocab/lis/v2/institution/person#Student"]}, "no learner"),
        (_without(f"{CLAIM}resource_link"), "names no link"),
        ({AGS: {"scope": [SCORE], "lineitem": "http://evil/x"}}, "encrypted"),
    ],
)  # fmt: skip
def test_a_launch_that_is_not_sound_lets_nobody_in(room: LtiRoom, changed: dict[str, Any], why: str) -> None:
    now = int(CLOCK().timestamp())
    client = room.client()
    answer = launched(room, client, **{name: each(now) if callable(each) else each for name, each in changed.items()})
    assert answer.status_code == 403
    assert why in said(answer)
    assert client.get("/cut").status_code == 303
    assert room.store.codes() == []


def test_clocks_may_differ_by_less_than_a_minute(room: LtiRoom) -> None:
    now = int(CLOCK().timestamp())
    assert launched(room, room.client(), exp=now - 30, iat=now - 90).status_code == 200
    assert launched(room, room.client(), iat=now + 30).status_code == 200
    assert launched(room, room.client(), aud=[CLIENT, "another"], azp=CLIENT).status_code == 200


@pytest.mark.parametrize(
    ("alg", "head", "why"),
    [
        ("none", {}, "signed by 'none'"),
        ("HS256", {}, "signed by 'HS256'"),
        ("RS256", {"alg": "RS512"}, "signed by 'RS512'"),
        ("RS256", {"kid": None}, "the key None"),
        ("RS256", {"kid": "unknown"}, "the key 'unknown'"),
        ("RS256", {"crit": ["made up"], "made up": 1}, "signature of the launch does not hold"),
    ],
)
def test_a_token_of_another_kind_or_key_lets_nobody_in(room: LtiRoom, alg: str, head: dict[str, Any], why: str) -> None:
    client = room.client()
    asked = sent_there(room, client)
    forged = room.platform.signers[0].token(room.platform.claims(asked["nonce"], "u1"), alg, **head)
    answer = enter(client, forged, asked["state"])
    assert answer.status_code == 403
    assert why in said(answer)


STRANGER = Signer("first")


@pytest.mark.parametrize("forgery", ["alg", "claims", "key", "key in head", "nothing", "parts", "long"])
def test_a_forged_token_lets_nobody_in(room: LtiRoom, forgery: str) -> None:
    client = room.client()
    asked = sent_there(room, client)
    signer, claims = room.platform.signers[0], room.platform.claims(asked["nonce"], "u1")
    head, body, signature = signer.token(claims).split(".")
    made = {
        "alg": f"{signer.token(claims, 'HS256').split('.')[0]}.{body}.{signature}",
        "claims": f"{head}.{signer.token(claims | {'sub': 'u2'}).split('.')[1]}.{signature}",
        "key": STRANGER.token(claims),
        "key in head": STRANGER.token(claims, jwk=STRANGER.jwk),
        "nothing": "",
        "parts": f"{head}.{body}",
        "long": f"{head}.{body}.{signature}" + "A" * 70_000,
    }[forgery]
    answer = enter(client, made, asked["state"])
    assert answer.status_code == 403
    assert said(answer)
    assert room.store.codes() == []


def test_a_launch_is_used_once_even_by_the_browser_that_began_it(room: LtiRoom) -> None:
    client = room.client()
    asked = sent_there(room, client)
    kept = dict(client.cookies)
    token = room.platform.signers[0].token(room.platform.claims(asked["nonce"], "u1"))
    assert enter(client, token, asked["state"]).status_code == 200
    assert "keeps no cookies here" in said(enter(client, token, asked["state"])), "the launch took the cookie with it"
    for name, value in kept.items():  # somebody who kept it
        client.cookies.set(name, value, path="/lti")
    assert "was used before" in said(enter(client, token, asked["state"]))
    again = LtiTool(room.lesson)  # after a restart
    room.app = class_app(ClassSite(lesson=room.lesson, secret=TOKEN, lti=again))
    client = room.client()
    for name, value in kept.items():
        client.cookies.set(name, value, path="/lti")
    assert "was used before" in said(enter(client, token, asked["state"]))


def test_two_that_send_one_launch_at_once_are_not_both_let_in(room: LtiRoom) -> None:
    client = room.client()
    asked = sent_there(room, client)
    secret = next(iter(client.cookies.values()))
    token = room.platform.signers[0].token(room.platform.claims(asked["nonce"], "u1"))
    found: list[str] = []

    def use() -> None:
        try:
            room.tool.door.enter(token, asked["state"], secret)
            found.append("in")
        except ValueError as error:
            found.append(str(error))

    threads = [threading.Thread(target=use, daemon=True) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert sorted(each[:2] for each in found) == ["Th"] * 5 + ["in"]


def test_another_browser_and_another_state_let_nobody_in(room: LtiRoom) -> None:
    client, other = room.client(), room.client()
    asked, others = sent_there(room, client), sent_there(room, other)
    token = room.platform.signers[0].token(room.platform.claims(asked["nonce"], "u1"))
    for state in (asked["state"], others["state"]):  # a stolen launch, in the thief's browser
        assert enter(other, token, state).status_code == 403
    for state in ("", "x", "0" * 64, asked["state"].upper(), asked["state"][:-1] + "\u00e9"):
        answer = enter(client, token, state)
        assert answer.status_code == 403
        assert "did not begin this launch" in said(answer)
    assert enter(client, token, asked["state"]).status_code == 200, "and nothing of it has used the launch up"


def test_what_one_platform_sends_answers_no_request_to_another(room: LtiRoom) -> None:
    other = LearningPlatform(CLOCK, dict)
    room.tool.file.add(platform_of(other.registration))
    client = room.client()
    asked = sent_there(room, client)
    answer = enter(client, other.signers[0].token(other.claims(asked["nonce"], "u1")), asked["state"])
    assert "did not begin this launch" in said(answer)
    other.close()


def test_a_form_of_another_site_signs_nobody_in(room: LtiRoom) -> None:
    client = room.client()
    asked = sent_there(room, client)
    token = room.platform.signers[0].token(room.platform.claims(asked["nonce"], "u1"))
    evil = {"Origin": "https://evil.example"}
    sent = {"id_token": token, "state": asked["state"]}
    assert client.post("/lti/enter", data=sent, headers=evil).status_code == 403
    assert client.post("/lti/agree", data={"ticket": "", "consent": "yes"}, headers=evil).status_code == 403
    assert client.post("/teacher/platforms", data={"do": "drop"}, headers=evil).status_code == 403
    assert client.post("/lti/agree", data={"ticket": token, "consent": "yes"}).status_code == 403


def test_consent_comes_within_a_quarter_of_an_hour(room: LtiRoom) -> None:
    client = room.client()
    ticket = hidden(launched(room, client).text)
    CLOCK.ahead += timedelta(minutes=16)
    answer = client.post("/lti/agree", data=ticket | {"consent": "yes"})
    assert (answer.status_code, "took too long" in said(answer)) == (403, True)


def test_a_platform_may_change_its_keys_and_is_asked_seldom(room: LtiRoom, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr(room.tool.door._keys, "_clock", lambda: now[0])
    assert launched(room, room.client()).status_code == 200
    assert launched(room, room.client()).status_code == 200
    assert room.platform.asked == ["/jwks"]
    room.platform.signers = [Signer("second")]
    now[0] += 11.0
    assert launched(room, room.client()).status_code == 200, "a new key is looked for"
    assert room.platform.asked == ["/jwks"] * 2
    for _ in range(5):
        client = room.client()
        asked = sent_there(room, client)
        claims = room.platform.claims(asked["nonce"], "u1")
        assert enter(client, Signer("made up").token(claims), asked["state"]).status_code == 403
    assert room.platform.asked == ["/jwks"] * 2, "nobody makes the class ask without end"
    now[0] += 11.0
    old = room.client()
    asked = sent_there(room, old)
    withdrawn = STRANGER.token(room.platform.claims(asked["nonce"], "u1"))
    assert "the key 'first'" in said(enter(old, withdrawn, asked["state"]))
    now[0] += 3601.0
    room.platform.answers = [503]
    answer = launched(room, room.client())
    assert answer.status_code == 502, "keys hold for an hour"
    assert "/jwks answers 503" in said(answer)
    now[0] += 11.0
    assert launched(room, room.client()).status_code == 200


@pytest.mark.parametrize(
    "keys",
    [
        {"keys": []}, {}, {"keys": "x"}, {"keys": [None, {"kty": "RSA", "kid": "first", "n": "!", "e": "AQAB"}]},
        {"keys": [{"kty": "oct", "kid": "first", "k": "c2VjcmV0"}]},
        {"keys": [Signer("first", 1024).jwk]}, {"keys": [STRANGER.jwk | {"use": "enc"}]},
        {"keys": [STRANGER.jwk | {"alg": "HS256"}]},
    ],
)  # fmt: skip
def test_a_set_of_keys_without_a_sound_one_lets_nobody_in(
    room: LtiRoom, keys: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cutenv.people.classroom.lti_keys.asked_for_json", lambda url: keys)
    assert "the key 'first'" in said(launched(room, room.client()))


# Roles


def test_an_instructor_is_let_into_the_teachers_pages_of_a_course_that_was_named_alone(room: LtiRoom) -> None:
    as_instructor = {f"{CLAIM}roles": [f"{ROLE}Instructor"]}
    client = room.client()
    answer = launched(room, client, "t1", **as_instructor)
    assert answer.status_code == 200
    assert COURSE in answer.text
    assert client.get("/teacher/live").status_code == 401
    room.register(teacher_courses=[COURSE])
    assert launched(room, client, "t1", **as_instructor).headers["Location"] == "../teacher"
    assert client.get("/teacher/live").status_code == 200
    of_another = {f"{CLAIM}context": {"id": "13"}}
    of_none = {f"{CLAIM}context": None}
    of_the_platform = {f"{CLAIM}roles": ["http://purl.imsglobal.org/vocab/lis/v2/institution/person#Instructor"]}
    for changed in (as_instructor | of_another, as_instructor | of_none, of_the_platform, {}):
        other = room.client()
        launched(room, other, "t2", **changed)
        assert other.get("/teacher/live").status_code == 401
    assert room.store.codes() == []


# Frames


def test_in_a_frame_a_launch_opens_a_window_and_a_choice_stays(room: LtiRoom) -> None:
    client, framed = room.client(), {"Sec-Fetch-Dest": "iframe"}
    asked = room.platform.initiation("u1", f"{AT}/lti/launch")
    answer = client.get("/lti/login", params=asked, headers=framed)
    assert answer.status_code == 200
    assert "Set-Cookie" not in answer.headers
    assert "frame-ancestors *" in answer.headers["Content-Security-Policy"]
    (again,) = re.findall(r'<a href="([^"]+)" target="_blank"', answer.text)
    opened = client.get(f"/lti/{html.unescape(again)}", headers={"Sec-Fetch-Dest": "document"})
    assert opened.headers["Location"].startswith(room.platform.issuer)
    chooses = client.get("/lti/login", params=asked | {"target_link_uri": f"{AT}/lti/choose"}, headers=framed)
    assert chooses.status_code == 303
    assert "frame-ancestors 'none'" in client.get("/").headers["Content-Security-Policy"]
    agree = launched(room, client)
    assert "frame-ancestors 'none'" in agree.headers["Content-Security-Policy"], "nobody is led to agree unseen"


def test_cookies_cross_no_site_but_in_a_part_of_their_own_over_https(room: LtiRoom) -> None:
    asked = room.platform.initiation("u1", f"{AT}/lti/launch")
    safe = TestClient(room.app, base_url="https://class.example", follow_redirects=False)
    cookie = safe.get("/lti/login", params=asked).headers["Set-Cookie"]
    for part in ("SameSite=None", "Secure", "Partitioned", "HttpOnly", "Path=/lti", "Max-Age=600"):
        assert part in cookie
    assert "SameSite=Strict" in room.client().get("/lti/login", params=asked).headers["Set-Cookie"]
    plain = TestClient(room.app, base_url="http://class.example", follow_redirects=False)
    refused = plain.get("/lti/login", params=asked)
    assert (refused.status_code, "over https" in said(refused)) == (403, True)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"iss": "https://elsewhere.example"}, "not registered"),
        ({"client_id": "another"}, "not registered"),
        ({"lti_deployment_id": "2"}, "The deployment '2'"),
        ({"login_hint": ""}, "no login_hint"),
        ({"target_link_uri": ""}, "no target_link_uri"),
        ({"iss": ""}, "no iss"),
    ],
)
def test_a_request_to_sign_in_that_is_not_sound_leads_nowhere(room: LtiRoom, changed: dict[str, str], why: str) -> None:
    asked = room.platform.initiation("u1", f"{AT}/lti/launch") | changed
    answer = room.client().get("/lti/login", params=asked)
    assert answer.status_code == 403
    assert why in said(answer)


def test_what_a_platform_says_is_shown_and_escaped(room: LtiRoom) -> None:
    answer = room.client().post("/lti/launch", data={"error": "access_denied", "error_description": "<script>no"})
    assert "The learning platform says: <script>no" in said(answer)
    assert "<script>no" not in answer.text


def test_nothing_english_is_left_of_what_a_german_class_says_of_platforms(tmp_path: Path) -> None:
    room = LtiRoom(tmp_path, language="de")
    instructor = {f"{CLAIM}roles": [f"{ROLE}Instructor"]}
    _, code = learner(room)
    saved(room, code, 70.0)
    room.platform.answers = [503]
    room.tool.grades.deliver()
    teacher = room.teacher()
    asked = room.platform.initiation("u1", f"{AT}/lti/launch")
    pages = [
        teacher.get("/teacher/platforms"), choices(room), launched(room, room.client(), "u2"),
        launched(room, room.client(), **instructor), choices(room, **settings(accept_types=[])),
        choices(room, **{f"{CLAIM}roles": []}), room.client().post("/lti/launch", data={"error": "denied"}),
        room.client().get("/lti/login", params=asked | {"lti_deployment_id": "2"}),
        room.client().get("/lti/login", params=asked, headers={"Sec-Fetch-Dest": "iframe"}),
        room.client().get("/lti/login"), room.client().post("/lti/agree", data={"ticket": "x"}),
        *(enter(room.client(), "x.y.z", state) for state in ("", "0" * 64)),
    ]  # fmt: skip
    now = int(CLOCK().timestamp())
    changes = (
        {"azp": "x"}, {"iat": 1}, {"nbf": now + 120}, {"exp": None}, {"nonce": "x"}, {f"{CLAIM}version": "1.1"},
        {f"{CLAIM}message_type": "x"}, {"sub": None}, {f"{CLAIM}roles": None}, {f"{CLAIM}roles": []},
        {f"{CLAIM}resource_link": None}, {AGS: {"scope": [SCORE], "lineitem": "http://x"}},
    )  # fmt: skip
    pages += [launched(room, room.client(), **each) for each in changes]
    for change in ({"deployments": ""}, {"issuer": ""}, {"client_id": "\t" + "x" * 300}, {"auth_url": "x"}):
        pages.append(teacher.post("/teacher/platforms", data=FORM | {"do": "add"} | change))
    client = room.client()
    state = sent_there(room, client)
    claims = room.platform.claims(state["nonce"], "u1")
    for token in (FIRST.token(claims, "none"), FIRST.token(claims, kid="x"), STRANGER.token(claims), "x"):
        pages.append(enter(client, token, state["state"]))
        client = room.client()
        state = sent_there(room, client)
        claims = room.platform.claims(state["nonce"], "u1")
    check_nothing_is_english(*(page.text for page in pages))
    room.close()


def test_whoever_comes_where_cuts_are_sent_on_agrees_to_that_at_every_launch(tmp_path: Path) -> None:
    room = LtiRoom(tmp_path)
    courier = Courier(room.lesson, StatementQueue(room.store), "http://127.0.0.1:1/xapi", "key:secret", AT)
    learner(room)
    room.app = class_app(ClassSite(lesson=room.lesson, secret=TOKEN, lti=room.tool, courier=courier))
    assert courier.url in launched(room, room.client()).text
    client, _ = learner(room)
    cut_once(client)
    assert courier.queue.waiting() == 1
    room.close()


# Choice of a link


def settings(**changed: Any) -> dict[str, Any]:
    return {f"{DL}deep_linking_settings": {"accept_types": ["ltiResourceLink"]} | changed}


def choices(room: LtiRoom, **changed: Any) -> Any:
    client = room.client()
    asked = sent_there(room, client, "t1", "/lti/choose")
    claims = room.platform.deep_linking(asked["nonce"], "t1", **changed)
    return enter(client, room.platform.signers[0].token(claims), asked["state"])


def test_an_instructor_chooses_the_course_or_a_task_and_its_link_has_that_grade(in_course: LtiRoom) -> None:
    room = in_course
    answer = choices(room)
    assert f"form-action {room.platform.issuer};" in answer.headers["Content-Security-Policy"]
    assert answer.text.count(f'action="{room.platform.issuer}/chosen"') == 3
    tokens = re.findall(r'name="JWT" value="([^"]+)"', answer.text)
    chosen = {item["title"]: item for item in map(room.platform.chosen, choices_each_once(room, tokens))}
    assert list(chosen) == ["first cuts", "even tissue", "liver"]
    assert chosen["first cuts"].get("custom") is None
    assert chosen["liver"]["custom"] == {"cutenv_task": "liver"}
    assert chosen["liver"]["url"] == f"{AT}/lti/launch"
    assert chosen["liver"]["lineItem"]["scoreMaximum"] == 100
    _, code = learner(room, **{f"{CLAIM}custom": chosen["liver"]["custom"]})
    (row,) = room.tool.people.grades()
    assert (row.code, row.task) == (code, "liver")


def test_a_choice_lists_the_courses_that_are_open_to_the_class_and_no_other(in_course: LtiRoom) -> None:
    room, teacher = in_course, in_course.teacher()
    _, code = learner(room)
    assert room.store.places()[code].class_name == "SURG101"
    for name, task in (("nurses", "knots"), ("dentists", "gums")):
        content = {"name": name, "task": [{"name": task, "specimen_class": "uniform"}]}
        room.lesson.courses.set(course_of(content), name)
    assert "knots" not in choices(room).text
    teacher.post("/teacher/places", data={"code": [code], "course": "nurses"})
    room.store.add_code("P07")
    teacher.post("/teacher/places", data={"code": ["P07"], "class_name": "2b", "course": "dentists"})
    answer = choices(room)
    assert re.findall(r"<h3>(.*?)</h3>", answer.text) == ["first cuts", "nurses"]
    assert "Course: each person's own" in html.unescape(answer.text)
    tokens = re.findall(r'name="JWT" value="([^"]+)"', answer.text)
    chosen = [room.platform.chosen(token) for token in choices_each_once(room, tokens)]
    assert [item.get("custom", {}).get("cutenv_task") for item in chosen] == [None, "even tissue", "liver", "knots"]
    learner(room, **{f"{CLAIM}custom": chosen[-1]["custom"]})
    saved(room, code, 70.0, "even tissue")
    assert grade_of(room.lesson, code, "knots") is None
    cut = room.store.hand_out(code, lambda _: NewCut("uniform", 5, course="nurses", task="knots"))
    assert cut is not None
    room.store.finish(cut.id, CutEnd(state="saved", record="y.csv", score=60.0, ended="finished", numbers={}))
    assert grade_of(room.lesson, code, "knots") == (60, True)
    of_another = choices(room, **{f"{CLAIM}context": {"id": "13", "label": "2b"}}).text
    assert re.findall(r"<h3>(.*?)</h3>", of_another) == ["first cuts", "dentists"]


def choices_each_once(room: LtiRoom, tokens: list[str]) -> list[str]:
    """One answer of each of as many choices: an answer is used once."""
    return [re.findall(r'name="JWT" value="([^"]+)"', choices(room).text)[k] for k in range(len(tokens))]


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({f"{CLAIM}roles": [f"{ROLE}Learner"]}, "You are none"),
        ({f"{DL}deep_linking_settings": None}, "takes no links"),
        (settings(accept_types=["file"]), "takes no links"),
        (settings(deep_link_return_url="javascript:alert(1)"), "no address"),
        (settings(deep_link_return_url="http://evil.example/"), "not encrypted"),
        (settings(deep_link_return_url="https://x;script-src/"), "no address"),
        (settings(deep_link_return_url=None), "no address"),
    ],
)
def test_a_choice_goes_to_an_instructor_and_a_safe_address_alone(
    room: LtiRoom, changed: dict[str, Any], why: str
) -> None:
    answer = choices(room, **changed)
    assert answer.status_code == 403
    assert why in said(answer)


# Grades


def test_the_servers_score_goes_back_as_the_grade(in_course: LtiRoom) -> None:
    room = in_course
    client, code = learner(room)
    room.tool.grades.deliver()
    assert room.platform.scores == []
    assert cut_once(client)[0].status_code == 200  # given up
    room.tool.grades.deliver()
    assert room.platform.scores == [], "a cut that was given up is no grade"
    answer, _ = cut_once(client, there_and_back(HandCut(specimen_class="uniform", seed=5).target_length))
    score = answer.json()["score"]
    assert score is not None
    room.tool.grades.deliver()
    ((column, sent),) = room.platform.scores
    assert (column, sent["userId"], sent["scoreGiven"], sent["scoreMaximum"]) == ("7", "u1", round(score / 2), 100)
    assert (sent["activityProgress"], sent["gradingProgress"]) == ("InProgress", "FullyGraded")
    assert code in sent["comment"]
    room.tool.grades.deliver()
    assert len(room.platform.scores) == 1
    assert [row.sent for row in room.tool.people.grades()] == [round(score / 2)]
    assert room.platform.asked.count("/token") == 1


def test_the_best_score_of_a_task_and_the_mean_of_a_course_are_the_grades(in_course: LtiRoom) -> None:
    room = in_course
    _, code = learner(room)
    learner(room, **{f"{CLAIM}custom": {"cutenv_task": "liver"}, AGS: lti_line_item(room, "8")})
    saved(room, code, 81.0, "even tissue")
    room.tool.grades.deliver()
    assert [(column, sent["scoreGiven"], sent["activityProgress"]) for column, sent in room.platform.scores] == [
        ("7", 40, "InProgress")
    ]
    for score in (60.0, 90.0, 70.0):
        saved(room, code, score, "liver")
    room.tool.grades.deliver()
    found = {column: (sent["scoreGiven"], sent["activityProgress"]) for column, sent in room.platform.scores}
    assert found == {"7": (86, "Completed"), "8": (90, "Completed")}


def lti_line_item(room: LtiRoom, name: str) -> dict[str, Any]:
    return {"scope": [SCORE], "lineitem": room.platform.line_item(name)}


@pytest.mark.parametrize(
    ("old", "new", "first", "grade", "progress"),
    [
        ("seeds = [5]", 'feedback = "never"', "even tissue", 71, "Completed"),
        ("[[task]]", "warm_up = 1\n[[task]]", WARM_UP, 30, "InProgress"),
    ],
    ids=["hidden feedback before the course is done", "a warm-up"],
)
def test_some_cuts_are_no_grade_yet_or_never(
    tmp_path: Path, old: str, new: str, first: str, grade: int, progress: str
) -> None:
    feedback = "never" if first == "even tissue" else "always"
    with LtiRoom(tmp_path, COURSE_FILE.format(feedback=feedback).replace(old, new, 1)) as room:
        _, code = learner(room)
        saved(room, code, 81.0, first)
        room.tool.grades.deliver()
        assert room.platform.scores == []
        saved(room, code, 61.0, "liver")
        room.tool.grades.deliver()
        sent = [(each["scoreGiven"], each["activityProgress"]) for _, each in room.platform.scores]
        assert sent == [(grade, progress)]


def test_no_record_of_another_program_and_no_other_course_is_a_grade(in_course: LtiRoom) -> None:
    room = in_course
    _, code = learner(room)
    room.store.add_foreign(code, CutEnd(state="foreign", record="y.csv", score=99.0))
    cut = room.store.hand_out(code, lambda _: NewCut("uniform", 5, course="another", task="even tissue"))
    assert cut is not None
    room.store.finish(cut.id, CutEnd(state="saved", record="x.csv", score=98.0, ended="finished", numbers={}))
    saved(room, code, 97.0, "even tissue", ended="given up")
    saved(room, code, None, "even tissue")
    refused = room.store.hand_out(code, lambda _: NewCut("uniform", 5, course="first cuts", task="even tissue"))
    assert refused is not None
    room.store.finish(refused.id, CutEnd(state="refused", score=96.0))
    assert grade_of(room.lesson, code) is None
    room.tool.grades.deliver()
    assert room.platform.scores == []


def test_a_link_without_a_place_in_the_gradebook_gets_no_grade(room: LtiRoom) -> None:
    learner(room, **{AGS: None})
    learner(room, "u2", **{AGS: {"scope": [], "lineitem": room.platform.line_item("7")}})
    learner(room, "u3", **{AGS: {"scope": [SCORE]}})
    assert len(room.store.codes()) == 3
    assert room.tool.people.grades() == []


def test_a_platform_that_is_down_is_asked_again_and_nothing_is_lost(
    room: LtiRoom, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("cutenv.people.classroom.lti_grades.time.monotonic", lambda: now[0])
    for subject, score in (("u1", 70.0), ("u2", 80.0)):
        saved(room, learner(room, subject)[1], score)
    for planned in (503, 429, 302, 401):
        room.platform.answers = [planned]
        asked = len(room.platform.asked)
        room.tool.grades.deliver()
        room.tool.grades.deliver()
        assert len(room.platform.asked) == asked + 1, "once, and then not for a while"
        now[0] += 601.0
    room.platform.answers = [200, 500]  # an answer without a token; then the gradebook fails
    room.tool.grades.deliver()
    assert "gives no access token" in room.teacher().get("/teacher").text
    now[0] += 601.0
    assert room.platform.scores == []
    assert "answers 500" not in room.teacher().get("/teacher").text
    room.tool.grades.deliver()
    assert "answers 500" in room.teacher().get("/teacher").text
    again = LtiRoom(tmp_path, known=room.platform)  # after a restart
    assert len(again.tool.people.grades(due=True)) == 2
    again.tool.grades.deliver()
    assert sorted(sent["scoreGiven"] for _, sent in room.platform.scores) == [70, 80]
    assert again.tool.people.grades(due=True) == []
    assert "does not arrive" not in again.teacher().get("/teacher").text
    again.lesson.close()


def test_an_access_token_that_has_ended_is_renewed(room: LtiRoom, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.lti_grades._EVERY", 0.0)
    _, code = learner(room)
    saved(room, code, 70.0)
    room.tool.grades.deliver()
    room.platform.forget_tokens()
    saved(room, code, 90.0)
    room.tool.grades.deliver()
    room.tool.grades.deliver()
    assert [sent["scoreGiven"] for _, sent in room.platform.scores] == [70, 90]


def test_a_grade_that_is_refused_holds_up_no_other_and_the_teacher_may_send_it_again(room: LtiRoom) -> None:
    for subject in ("u1", "u2"):
        saved(room, learner(room, subject)[1], 70.0)
    key = room.tool.tokens.find(room.tool.file.platforms[0], SCORE)
    assert key
    room.platform.answers = [404]
    room.tool.grades.deliver()
    assert len(room.platform.scores) == 1
    teacher = room.teacher()
    assert "answers 404" in teacher.get("/teacher/platforms").text
    room.tool.grades.deliver()
    assert len(room.platform.scores) == 1, "it would be refused again"
    assert teacher.post("/teacher/platforms", data={"do": "again"}).status_code == 303
    room.tool.grades.deliver()
    assert len(room.platform.scores) == 2
    assert "answers 404" not in teacher.get("/teacher/platforms").text


def test_no_cut_waits_for_a_platform_that_never_answers(room: LtiRoom, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.lti_platforms._WITHIN", 60.0)  # a busy machine is slow to cut
    client, code = learner(room)
    saved(room, code, 70.0)
    hangs = threading.Event()
    room.platform.answers = [hangs]
    sending = threading.Thread(target=room.tool.grades.deliver, daemon=True)
    sending.start()
    until = time.monotonic() + 30.0
    while "/token" not in room.platform.asked and time.monotonic() < until:
        time.sleep(0.01)
    assert cut_once(client)[0].status_code == 200
    assert sending.is_alive(), "it was saved while the platform was awaited"
    hangs.set()
    sending.join(60.0)
    room.tool.grades.deliver()
    assert [sent["scoreGiven"] for _, sent in room.platform.scores] == [70] * len(room.platform.scores)
    assert room.platform.scores


def test_the_thread_sends_by_itself_and_says_once_what_is_wrong(
    room: LtiRoom, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cutenv.people.classroom.lti_grades._EVERY", 0.05)
    _, code = learner(room)
    room.platform.answers = [503, 503]
    saved(room, code, 70.0)
    room.tool.grades.start()
    until = time.monotonic() + 30.0
    while not room.platform.scores and time.monotonic() < until:
        time.sleep(0.02)
    room.tool.grades.close()
    room.tool.grades._thread.join(30.0)
    assert len(room.platform.scores) == 1
    assert capsys.readouterr().err.count("answers 503") == 1


def test_an_answer_without_end_is_left(room: LtiRoom, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.lti_platforms._MAX_ANSWER_BYTES", 10)
    assert "answers with more than" in said(launched(room, room.client()))


# What is kept


def test_deleting_a_code_deletes_where_it_came_from(room: LtiRoom) -> None:
    _, code = learner(room)
    assert room.lesson.delete(code)
    assert room.tool.people.grades() == []
    _, other = learner(room)
    assert other != code, "and nobody knows the person any more"


def test_a_backup_keeps_who_has_which_code(room: LtiRoom, tmp_path: Path) -> None:
    _, code = learner(room)
    write_backup(room.store, room.lesson.folder, tmp_path / "class.zip")
    (tmp_path / "new").mkdir()
    store = ClassStore(f"sqlite:///{tmp_path / 'new' / 'class.db'}")
    restore_backup(store, tmp_path / "new" / "records", tmp_path / "class.zip")
    store.close()
    again = LtiRoom(tmp_path / "new", known=room.platform)
    again.register()
    client = again.client()
    assert launched(again, client).headers["Location"] == "../cut"
    assert code in client.get("/cut").text
    again.lesson.close()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_the_key_is_made_once_and_nobody_else_may_read_it(room: LtiRoom, tmp_path: Path) -> None:
    first = room.client().get("/lti/jwks").json()
    assert stat.S_IMODE((tmp_path / "lti_key.pem").stat().st_mode) == 0o600
    assert stat.S_IMODE((tmp_path / PLATFORMS_FILE).stat().st_mode) & 0o077 == 0
    assert LtiTool(room.lesson).key.public == first
    (key,) = first["keys"]
    assert set(key) == {"kty", "n", "e", "kid", "use", "alg"}


def test_a_damaged_key_is_said_to_be_one(room: LtiRoom, tmp_path: Path) -> None:
    (tmp_path / "lti_key.pem").write_text("nothing")
    with pytest.raises(ValueError, match=r"lti_key\.pem is no private key .* Delete it"):
        _ = room.tool.key.public
    room.tool.people.enter(Learner(room.platform.issuer, CLIENT, DEPLOYMENT, "u1", "", room.platform.line_item("7")))
    ((code, _),) = room.store.codes()
    saved(room, code, 70.0)
    room.tool.grades.deliver()  # its thread goes on
    assert "is no private key" in room.teacher().get("/teacher").text


# Registration


FORM = {
    "name": "Moodle of the school", "issuer": "https://moodle.school.example", "client_id": "aBc",
    "auth_url": "https://moodle.school.example/mod/lti/auth.php",
    "token_url": "https://moodle.school.example/mod/lti/token.php",
    "jwks_url": "https://moodle.school.example/mod/lti/certs.php", "deployments": "1, 2", "token_audience": "",
    "teacher_courses": "12",
}  # fmt: skip


def test_a_teacher_registers_a_platform_and_removes_it(room: LtiRoom) -> None:
    teacher = room.teacher()
    shown = teacher.get("/teacher/platforms").text
    for path in ("/lti/login", "/lti/launch", "/lti/choose", "/lti/jwks"):
        assert f"{AT}{path}" in shown
    assert teacher.post("/teacher/platforms", data=FORM | {"do": "add"}).status_code == 303
    mine = room.tool.file.platforms[-1]
    assert (mine.title, mine.deployments, mine.teacher_courses) == ("Moodle of the school", ("1", "2"), ("12",))
    assert "Moodle of the school" in teacher.get("/teacher/platforms").text
    assert teacher.post("/teacher/platforms", data=FORM | {"do": "add", "deployments": "3"}).status_code == 303
    assert [each.deployments for each in room.tool.file.platforms] == [(DEPLOYMENT,), ("3",)]
    bad = teacher.post("/teacher/platforms", data=FORM | {"do": "add", "token_url": "http://moodle.school.example"})
    assert (bad.status_code, "token_url" in said(bad)) == (422, True)
    assert "aBc" in bad.text, "what was typed is still there"
    for client, status in ((room.client(), 401), (learner(room)[0], 401)):
        assert client.get("/teacher/platforms").status_code == status
        assert client.post("/teacher/platforms", data=FORM | {"do": "add"}).status_code == status
    teacher.post("/teacher/platforms", data={"do": "drop", "issuer": FORM["issuer"], "client_id": "aBc"})
    assert len(room.tool.file.platforms) == 1


GOOD = """[[platform]]
issuer = "https://moodle.school.example"
client_id = "aBc"
auth_url = "https://moodle.school.example/mod/lti/auth.php"
token_url = "https://moodle.school.example/mod/lti/token.php"
jwks_url = "https://moodle.school.example/mod/lti/certs.php"
deployments = ["1"]
"""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (GOOD.replace("https://moodle.school.example/mod/lti/certs", "http://moodle.school.example/mod/lti/certs"),
         r"platform 1: jwks_url = 'http://moodle.* is not encrypted"),
        (GOOD.replace("https://moodle.school.example/mod/lti/certs", "http://127.0.0.1/certs"), "is not encrypted"),
        (GOOD.replace("jwks_url", "jwk_url"), "'jwk_url' is not known. Did you mean 'jwks_url'"),
        (GOOD.replace('client_id = "aBc"\n', ""), "client_id is missing. Copy it"),
        (GOOD.replace('["1"]', "[1]"), "deployments must be a text, got 1"),
        (GOOD.replace('["1"]', '"1"'), "deployments must be a list"),
        (GOOD.replace('["1"]', "[]"), "deployments is empty"),
        (GOOD.replace('"aBc"', "7"), "client_id must be a text, got 7"),
        (GOOD.replace('"https://moodle.school.example"', '"moodle"'), "issuer = 'moodle' is no address"),
        (GOOD.replace("/mod/lti/auth.php", ":x/"), "auth_url = .* is no address"),
        (GOOD + GOOD, "platform 2: client_id = 'aBc' is registered twice"),
        ("platform = 1", r"begin each platform with a line \[\[platform\]\]"),
        ("[[platform", "is no TOML file"),
    ],
)  # fmt: skip
def test_a_bad_file_of_platforms_is_said_to_be_one(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / PLATFORMS_FILE
    path.write_text(text, encoding="utf-8")
    with pytest.raises((TypeError, ValueError), match=why):
        read_platforms(path)


def test_a_file_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / PLATFORMS_FILE
    path.write_text(GOOD + 'name = "Schule \\"Süd\\""\nteacher_courses = ["12"]\n', encoding="utf-8")
    read = read_platforms(path)
    path.write_text(platforms_toml(read), encoding="utf-8")
    assert read_platforms(path) == read
    assert read[0].title == 'Schule "Süd"'


def test_a_file_damaged_at_work_changes_nothing_and_the_teacher_sees_it(room: LtiRoom, tmp_path: Path) -> None:
    assert len(room.tool.file.platforms) == 1
    whole = (tmp_path / PLATFORMS_FILE).read_text(encoding="utf-8")
    (tmp_path / PLATFORMS_FILE).write_text(whole + "x", encoding="utf-8")
    assert launched(room, room.client()).status_code == 200
    teacher = room.teacher()
    assert "is no TOML file" in teacher.get("/teacher").text
    assert teacher.post("/teacher/platforms", data=FORM | {"do": "add"}).status_code == 422
    assert (tmp_path / PLATFORMS_FILE).read_text(encoding="utf-8") == whole + "x"


def test_a_server_with_a_bad_file_of_platforms_does_not_begin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / PLATFORMS_FILE).write_text("[[platform]]\nissuer = 1\n", encoding="utf-8")
    assert main([str(tmp_path), "--port", "0"]) == 2
    assert "platform 1: client_id is missing" in capsys.readouterr().err


def test_without_the_extra_a_class_works_and_a_registered_one_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cutenv.commands.serve import _lti_tool

    for name in [name for name in sys.modules if name.startswith(("joserfc", "cutenv.people.classroom.lti_tool"))]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("lti_keys", "lti_launch", "lti_grades"):
        monkeypatch.delitem(sys.modules, f"cutenv.people.classroom.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "joserfc", None)
    room = Room(tmp_path)
    assert _lti_tool(room.lesson, "en") is None
    assert "platforms" not in room.teacher().get("/teacher").text
    assert room.client().get("/lti/jwks").status_code == 404
    (tmp_path / PLATFORMS_FILE).write_text(GOOD, encoding="utf-8")
    with pytest.raises(ModuleNotFoundError, match="joserfc"):
        _lti_tool(room.lesson, "en")
    room.lesson.close()
