"""A class's server: cuts confirmed by the law, pages of people and teacher, and a list of attacks."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
import zipfile
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from class_room import CLOCK, TOKEN, Room, begun, check_nothing_is_english, cut_once, hand, message, sent, to_the_end
from starlette.testclient import TestClient

from cutenv.people.browser import HandCut
from cutenv.people.browser.stylus_steps import HandDepthCut, HandPathCut
from cutenv.people.browser.watched_cut import from_runs
from cutenv.people.classroom import Lesson
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import LARGEST_BODY, ClassSite, Trials
from cutenv.records import load_one
from cutenv.records.scoring import score
from cutenv.sim.tissue import measured_liver


def test_what_told_the_force_and_led_the_hand_stands_in_the_record(room: Room) -> None:
    client = room.person("P07")
    for aids, noted in (("serial,pen,made up,sound", ["pen", "serial", "sound"]), ("", None)):
        handed_out, stylus = begun(client), hand()
        made = HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"])
        told = message(made, stylus)
        told["headers"]["X-Aids"] = aids
        assert client.post(f"/cuts/{handed_out['id']}", **told).status_code == 200
        trace, _ = room.lesson.scored(room.store.cuts("P07")[-1])
        assert trace.metadata.get("device_aids") == noted


def test_a_cut_is_repeated_scored_and_kept(room: Room) -> None:
    client, stylus = room.person("P07"), hand()
    answer, handed_out = cut_once(client, stylus)
    assert answer.status_code == 200, answer.text
    (path,) = (room.lesson.folder / "P07").glob("*.csv")
    trace = load_one(path)
    assert trace.metadata["operator"] == "P07"
    assert trace.metadata["specimen_seed"] == handed_out["seed"]
    made = HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"])
    assert trace.force.tobytes() == made.follow(stylus)["force"].tobytes()
    overall = score(
        trace, target_length=trace.metadata["target_length_m"], reference=room.lesson._reference
    ).overall_score
    assert overall is not None
    assert answer.json()["score"] == round(overall)
    told_numbers, card = answer.json()["numbers"], room.lesson.scored(room.store.cuts("P07")[0])[1]
    assert told_numbers == {name: card[name] for name in ("peak_force", "largest_jump", "duration")}
    (told,) = client.get("/cuts").json()
    assert (told["state"], told["score"]) == ("saved", round(overall))
    first = answer.json()["advice"][0]
    assert first["seen"]["en"].startswith("Given up, at ")
    assert first["seen"]["en"].endswith(" mm before the target")
    assert first["try"]["en"].startswith("Go on slowly as far as the target")
    assert first["try"]["de"] != first["try"]["en"]


def test_a_class_cuts_a_tissue_of_its_own(tmp_path: Path) -> None:
    tissue = tmp_path / "softer.json"
    softer = dataclasses.replace(measured_liver(), name="softer", fracture_resistance=120.0)
    tissue.write_text(softer.to_json())
    room = Room(tmp_path, tissue=tissue)
    client = room.person("P07")
    begins = begun(client)
    assert sent(client, begins, tissue=tissue).status_code == 200
    (path,) = (room.lesson.folder / "P07").glob("*.csv")
    assert load_one(path).metadata["specimen"] == f"liver of softer, seed {begins['seed']}, number 0"
    left = begun(client)
    tissue.write_text(dataclasses.replace(softer, fracture_resistance=130.0).to_json())
    again = Room(tmp_path, tissue=tissue)  # the same class, and by now another tissue
    refused = sent(again.person("P07"), left, tissue=tissue)
    assert "handed out for a task that is served no more" in refused.json()["error"]


def test_a_course_leads_from_task_to_task_and_hides_what_it_is_to_hide(tmp_path: Path) -> None:
    course = (
        'name = "two"\n[[task]]\nname = "first"\nspecimen_class = "uniform"\nseeds = [5]\nfeedback = "never"\n'
        '[[task]]\nname = "second"\nspecimen_class = "liver"\nfeedback = "above-limit"\n'
    )
    room = Room(tmp_path, course)
    client = room.person("P01")
    first = begun(client)
    assert (first["specimen_class"], first["seed"], first["feedback"]) == ("uniform", 5, "never")
    answer = sent(client, first, to_the_end()).json()
    assert (answer["score"], answer["outcome"], answer["points"], answer["advice"]) == (None, {}, [], [])
    assert answer["numbers"] == {}
    assert client.post("/cuts").json()["feedback"] == "above-limit"
    again = Lesson(room.store, room.lesson.folder, room.lesson.course).progress("P01")
    assert again is not None
    assert again.task is not None
    assert again.task.name == "second", "progress is counted from what is stored"
    room.store.close()


@pytest.mark.parametrize(
    ("task", "line", "mark", "channel"),
    [
        ("depth", None, "target_length_mm = 60\nmark = { mean_depth_error_mm = 100 }", "height"),
        ("path", "s", 'line = "s"\nmark = { line_area_mm2 = 1000 }', "blade_y"),
    ],
)
def test_a_cut_of_another_task_is_repeated_scored_and_kept(
    tmp_path: Path, task: str, line: str | None, mark: str, channel: str
) -> None:
    given = f'name = "one"\ntask = "{task}"\nspecimen_class = "liver"\nseeds = [5]\n{mark}\n'
    room = Room(tmp_path, f'name = "two"\n[[task]]\n{given}')
    client = room.person("P01")
    assert f'id="law-{task}"' in client.get("/cut").text
    handed_out = begun(client)
    assert (handed_out["task"], handed_out.get("line")) == (task, line)
    assert set(handed_out["records"]) == {"cut", "episode"}
    stylus = np.column_stack([hand(), np.linspace(0.0, 0.002, 900)])
    made: HandCut = (
        HandDepthCut(specimen_class="liver", seed=5, target_length=0.06)
        if line is None
        else HandPathCut(specimen_class="liver", seed=5, line=line)
    )
    request = message(made, stylus)
    answer = client.post(f"/cuts/{handed_out['id']}", **request)
    assert answer.status_code == 200, answer.text
    assert [each["part"] for each in answer.json()["points"]].count(task) == 1
    assert answer.json()["verdict"]["en"] == "Mark missed: given up."
    (path,) = (room.lesson.folder / "P01").glob("*.csv")
    trace = load_one(path)
    kept = made.channels[made.channel_fields.index(channel)]
    assert getattr(trace, channel).tobytes() == kept.tobytes()
    assert {name: trace.metadata[name] for name in made.noted} == made.noted
    other = begun(client)
    flat = client.post(f"/cuts/{other['id']}", **(request | {"content": hand(1001).tobytes()}))
    assert flat.status_code == 422
    assert "milliseconds of 24 bytes" in flat.json()["error"]
    room.store.close()


def test_a_replay_has_the_movements_and_the_teachers_example(tmp_path: Path) -> None:
    task = '[[task]]\nname = "{}"\nspecimen_class = "uniform"\nseeds = [5]\nfeedback = "{}"\n'
    room = Room(tmp_path, 'name = "two"\n' + task.format("first", "afterwards") + task.format("last", "never"))
    expert, client, stylus = room.person("P01"), room.person("P02"), hand(700)
    chosen = begun(expert)
    assert sent(expert, chosen, hand(900)).status_code == 200
    teacher = room.teacher()
    page = "/teacher/people/P01"
    assert teacher.post(f"{page}/example", data={"cut": chosen["id"], "shown": "yes"}).status_code == 303
    assert "No longer an example" in teacher.get(page).text
    handed_out = begun(client)
    path = f"/cuts/{handed_out['id']}/replay"
    assert client.get(path).status_code == 404, "it is not over"
    assert sent(client, handed_out, stylus).status_code == 200
    assert client.get("/cuts").json()[0] | {"id": handed_out["id"], "replay": True} == client.get("/cuts").json()[0]
    told = client.get(path).json()
    assert from_runs(told["movements"]).tobytes() == stylus.tobytes()
    assert told["specimen"]["records"] == handed_out["records"]
    assert told["by"] == "example"
    (record,) = (room.lesson.folder / "P01").glob("*.csv")
    assert told["expert"]["force"][-1] == pytest.approx(load_one(record).force[-1], abs=1e-3)
    assert "P01" not in client.get(path).text
    assert expert.get(path).status_code == 404, "it is another person's"
    for person in (room.client(), teacher):
        assert person.get(path).status_code == 401
    assert client.post(f"{page}/example", data={"cut": chosen["id"], "shown": "no"}).status_code == 401
    assert sent(client, begun(client), to_the_end()).status_code == 200
    last = begun(client)
    assert last["feedback"] == "never"
    assert sent(client, last, hand(600)).status_code == 200
    assert client.get(f"/cuts/{last['id']}/replay").status_code == 404, "its task hides the force"
    room.store.close()


# Attacks


def test_movements_that_the_law_does_not_confirm_are_refused_and_said_to_be(room: Room) -> None:
    client = room.person("P07")
    answer, _ = cut_once(client, headers={"X-Readings": "00000000"})
    assert answer.status_code == 422
    assert "not those of the law" in answer.json()["error"]
    assert [cut.state for cut in room.store.cuts("P07")] == ["refused"]
    assert not list(room.lesson.folder.rglob("*.csv"))


def test_a_record_cannot_be_sent_twice(room: Room) -> None:
    client = room.person("P07")
    answer, handed_out = cut_once(client)
    assert answer.status_code == 200
    again = client.post(f"/cuts/{handed_out['id']}", content=hand().tobytes(), headers={"X-Readings": "0" * 8})
    assert again.status_code == 422
    assert "saved already" in again.json()["error"]
    assert len(list(room.lesson.folder.rglob("*.csv"))) == 1


@pytest.mark.parametrize(
    "content",
    [b"", b"x", b"\0" * 15, b"\0" * 16 * 99, b"\0" * 16 * 30_001, np.full((200, 2), np.nan).tobytes(),
     np.full((200, 2), 1e300).tobytes(), b"<script>" * 400],
    ids=["empty", "a letter", "half a movement", "too short", "too long", "nan", "far", "text"],
)  # fmt: skip
def test_what_cannot_be_a_cut_is_refused(room: Room, content: bytes) -> None:
    client = room.person("P07")
    answer, _ = cut_once(client, content=content)
    assert answer.status_code == 422
    assert answer.json()["error"]


def test_somebody_elses_cut_is_not_there(room: Room) -> None:
    owner, other = room.person("P01"), room.person("P02")
    handed_out = owner.post("/cuts").json()
    answer = other.post(f"/cuts/{handed_out['id']}", content=hand().tobytes(), headers={"X-Readings": "0" * 8})
    assert answer.status_code == 404
    assert other.get("/cuts").json() == []


OPEN_TO_ALL = {"/", "/leave", "/cut", "/teacher", "/teacher/open/{ticket:str}"}


def test_nobody_gets_in_without_signing_in(room: Room) -> None:
    nobody, person = room.client(), room.person("P02")
    for route in (each for each in room.app.routes if each.path not in OPEN_TO_ALL):
        path = re.sub(r"{.*?}", "x", route.path)
        for method in route.methods:
            assert nobody.request(method, path).status_code == 401, path
            if path.startswith("/teacher"):
                assert person.request(method, path).status_code == 401, f"a person is no teacher: {path}"


@pytest.mark.parametrize("cookie", ["", "x", "' OR 1=1 --", "\x00", "a" * 5000])
def test_a_made_up_cookie_is_nobodys(room: Room, cookie: str) -> None:
    client = room.client()
    site = ClassSite(lesson=room.lesson, secret=TOKEN)
    for name in (site.person_cookie, site.teacher_cookie):
        header = {"Cookie": f"{name}={cookie}".encode("latin-1")}
        assert client.get("/cuts", headers=header).status_code in (400, 401)
        assert client.get("/teacher/sheet", headers=header).status_code in (400, 401)


@pytest.mark.parametrize(
    "code", ["' OR '1'='1", "P01'; DROP TABLE people; --", "../../etc", "<script>alert(1)</script>"]
)
def test_injection_into_sql_and_page_is_just_a_wrong_code(room: Room, code: str) -> None:
    room.store.add_code("P01")
    answer = room.client().post("/", data={"code": code, "consent": "yes"})
    assert answer.status_code == 403
    assert "<script>alert" not in answer.text
    assert room.store.knows("P01")


@pytest.mark.parametrize("path", ["../class.db", "..%2fclass.db", "%2e%2e/%2e%2e/etc/passwd", "..\\class.db"])
def test_no_path_of_a_client_is_opened(room: Room, path: str) -> None:
    teacher = room.teacher()
    for address in (f"/teacher/{path}/records.zip", f"/teacher/P01/{path}", f"/{path}"):
        assert teacher.get(address).status_code in (404, 401)
    assert teacher.post("/teacher/delete", data={"code": "..", "again": ".."}).status_code == 404
    assert room.lesson.folder.is_dir()


def test_guessing_codes_is_slowed_down_and_neither_a_class_nor_its_teacher_is_locked_out(room: Room) -> None:
    room.store.add_code("P01")
    client = room.client()
    answers = [client.post("/", data={"code": f"X{n}", "consent": "yes"}).status_code for n in range(14)]
    assert answers == [403] * 12 + [429] * 2, "ten, and two for the code there is"
    assert client.post("/", data={"code": "P01", "consent": "yes"}).status_code == 429
    assert client.post("/teacher", data={"token": TOKEN}).status_code == 303
    room.store.add_codes(29)  # a whole class behind one address
    assert client.post("/", data={"code": "P01", "consent": "yes"}).status_code == 303


def test_guessing_the_token_is_slowed_down_and_the_right_one_is_let_in(room: Room) -> None:
    client = room.client()
    answers = [client.post("/teacher", data={"token": "guess"}).status_code for _ in range(12)]
    assert answers == [403] * 10 + [429] * 2
    assert client.post("/teacher", data={"token": TOKEN}).status_code == 303


def test_the_brake_lets_go_after_a_minute() -> None:
    now = [0.0]
    trials = Trials(2, clock=lambda: now[0])
    trials.failed("a")
    trials.failed("a")
    with pytest.raises(Exception, match="Wait a minute"):
        trials.check("a")
    trials.check("b")
    now[0] = 61.0
    trials.check("a")


def test_another_site_cannot_act_for_a_person(room: Room) -> None:
    client = room.person("P07")
    assert client.post("/cuts", headers={"Origin": "http://evil.example"}).status_code == 403
    assert client.post("/cuts", headers={"Origin": "http://class"}).status_code == 200
    cookie = room.client().post("/", data={"code": "P07", "consent": "yes"}).headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


def test_a_huge_request_is_refused_before_it_is_read(room: Room) -> None:
    client = room.person("P07")
    assert client.post("/cuts/x", content=b"\0" * (LARGEST_BODY + 1)).status_code == 413
    assert client.post("/cuts/x", content=iter([b"\0" * 65536] * 20)).status_code == 413


def test_every_page_forbids_what_it_does_not_need(room: Room) -> None:
    for answer in (room.client().get("/"), room.teacher().get("/teacher"), room.person("P07").get("/cut")):
        assert answer.status_code == 200
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert not re.search(r"""(src|href)=["']?https?://""", answer.text), "a page asks another host"


def test_without_consent_nobody_cuts(room: Room) -> None:
    room.store.add_code("P07")
    answer = room.client().post("/", data={"code": "P07"})
    assert answer.status_code == 403
    assert "cutenv_person" not in answer.headers.get("set-cookie", "")
    assert room.store.codes() == [("P07", False)]


# The teacher


def test_nothing_english_is_left_of_a_german_class(tmp_path: Path) -> None:
    room = Room(tmp_path, "first")
    room.app = class_app(ClassSite(lesson=room.lesson, secret=TOKEN, title="2b", language="de"))
    person = room.person("P01")
    begun(person)  # and left
    cut_once(person)
    lost = begun(person)
    stylus = hand()
    movements = {"content": stylus.tobytes(), "headers": {"X-Readings": "00000000"}}
    refused = person.post(f"/cuts/{lost['id']}", **movements).json()["said"]["de"]
    again = person.post(f"/cuts/{lost['id']}", **movements).json()["said"]["de"]
    teacher = room.teacher()
    teacher.post("/teacher/pass-mark", data={"mark": "55.5"})
    pages = [
        room.client().post("/", data={"code": "XX", "consent": "yes"}),
        person.get("/cut"),
        *(
            teacher.get(f"/teacher{path}")
            for path in ("", "/people/P01", "/studies", "/upload", "/sheet", "/live", "/course")
        ),
        teacher.get("/teacher/people/P99", headers={"Accept": "text/html"}),
    ]
    told = [page.text for page in pages]
    history = [each["outcome"].get("de", "") for each in person.get("/cuts").json()]
    check_nothing_is_english(*told, *history, refused, again)
    assert "55,5" in told[2]
    assert "gleichmäßiges Gewebe" in told[2]
    assert "mm vor dem Ziel" in told[3]
    assert refused == "Seine Messwerte sind nicht die des Gesetzes für diese Bewegungen."


def test_the_teacher_makes_codes_and_sees_exports_and_deletes(room: Room) -> None:
    teacher = room.teacher()
    assert teacher.post("/teacher/codes", data={"count": "3"}).status_code == 303
    codes = [code for code, _ in room.store.codes()]
    sheet = teacher.get("/teacher/sheet").text
    assert len(codes) == 3
    assert all(code in sheet for code in codes)
    assert "only this computer" not in sheet
    here = TestClient(room.app, base_url="http://127.0.0.1:8765")
    here.post("/teacher", data={"token": TOKEN})
    assert "only this computer" in here.get("/teacher/sheet").text
    room.store.put(codes[:2], class_name="2b")
    one_class = teacher.get("/teacher/sheet", params={"class": "2b"}).text
    assert [code in one_class for code in codes] == [True, True, False]
    assert one_class.count("cutenv, 2b") == 2
    client = room.client()
    assert client.post("/", data={"code": codes[0].lower(), "consent": "yes"}).status_code == 303
    answer, handed_out = cut_once(client)
    assert answer.status_code == 200
    page = teacher.get("/teacher").text
    assert f"teacher/{codes[0]}/{handed_out['id']}" in page
    card = teacher.get(f"/teacher/{codes[0]}/{handed_out['id']}")
    assert card.status_code == 200
    assert codes[0] in card.text
    for path in ("/teacher/records.zip", f"/teacher/{codes[0]}/records.zip"):
        with zipfile.ZipFile(io.BytesIO(teacher.get(path).content)) as archive:
            names = archive.namelist()
            (row,) = csv.DictReader(io.StringIO(archive.read("cuts.csv").decode()))
        assert row["state"] == "saved"
        assert f"{codes[0]}/{row['record']}" in names
    assert teacher.post("/teacher/delete", data={"code": codes[0], "again": "x"}).status_code == 422
    assert teacher.post("/teacher/delete", data={"code": codes[0].lower(), "again": codes[0]}).status_code == 303
    assert not (room.lesson.folder / codes[0]).exists()
    assert client.get("/cuts").status_code == 401, "who was deleted is signed out"
    assert codes[0] not in teacher.get("/teacher").text


@pytest.mark.parametrize("count", ["0", "501", "x", "", "-3", "1e2"])
def test_a_bad_number_of_codes_is_named(room: Room, count: str) -> None:
    answer = room.teacher().post("/teacher/codes", data={"count": count})
    assert answer.status_code == 422
    assert "count" in answer.json()["error"]


def test_signing_out_ends_the_session(room: Room) -> None:
    teacher = room.teacher()
    token = teacher.cookies[ClassSite(lesson=room.lesson, secret=TOKEN).teacher_cookie]
    teacher.post("/leave")
    assert room.store.signed_in(token) is None


def test_who_was_not_seen_for_long_is_signed_out_and_a_teacher_stays(room: Room) -> None:
    person, other, teacher = room.person("P07"), room.person("P08"), room.teacher()
    assert ">P07</b>" in person.get("/cut").text
    for _ in range(2):
        CLOCK.ahead += timedelta(minutes=8)
        assert other.get("/cuts").status_code == 200
    assert person.get("/cuts").status_code == 401
    assert person.get("/").status_code == 200, "the next person at the machine enters a code"
    assert teacher.get("/teacher/sheet").status_code == 200


def test_the_teacher_is_signed_out_everywhere_by_one_button_and_by_another_token(room: Room) -> None:
    here, there = room.teacher(), room.teacher()
    later = TestClient(class_app(ClassSite(lesson=room.lesson, secret="new")), base_url="http://class")
    later.cookies = here.cookies
    assert later.get("/teacher/sheet").status_code == 401
    person = room.person("P07")
    assert here.post("/teacher/delete", data={"code": "", "again": ""}).status_code == 404
    assert there.get("/teacher/sheet").status_code == 200, "nobody is called so"
    assert here.post("/teacher/leave").status_code == 303
    assert [each.get("/teacher/sheet").status_code for each in (here, there)] == [401, 401]
    assert person.get("/cuts").status_code == 200


def test_two_classes_on_one_machine_do_not_sign_each_other_out(room: Room, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Room(tmp_path / "other")
    names = {site.person_cookie for site in (ClassSite(lesson=each.lesson, secret="") for each in (room, other))}
    assert len(names) == 2
    other.lesson.close()


def test_a_name_that_is_not_the_servers_reads_nothing(room: Room) -> None:
    app = class_app(ClassSite(lesson=room.lesson, secret=TOKEN, hosts={"class", "localhost"}))
    for host, status in (("class", 200), ("127.0.0.1:8800", 200), ("[::1]:8800", 200), ("evil.example", 421)):
        answer = TestClient(app).get("/", headers={"Host": host})
        assert answer.status_code == status, host
    assert "--name evil.example" in answer.json()["error"]


def test_a_full_disk_is_told_and_the_cut_can_be_sent_again(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    client = room.person("P07")
    full = OSError(28, "No space left on device")

    def refuse(*_: Any) -> None:
        raise full

    with monkeypatch.context() as patched:
        patched.setattr("cutenv.people.classroom.lesson.save", refuse)
        answer, handed_out = cut_once(client)
    assert answer.status_code == 507
    assert "No space left" in answer.json()["error"]
    assert sent(client, handed_out).status_code == 200
    assert len(list(room.lesson.folder.rglob("*.csv"))) == 1
