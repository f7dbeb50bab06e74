"""The teacher's pages: classes and groups, pass marks, studies made beside the server, records of other programs."""

from __future__ import annotations

import io
import json
import re
import time
import zipfile
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from class_room import CLOCK, Room, begun, cut_once, hand, words
from starlette.testclient import TestClient

from cutenv.display.report.trainee_sheet import class_means
from cutenv.people.classroom import ClassStore, Lesson
from cutenv.people.classroom.class_backup import restore_backup, write_backup
from cutenv.people.classroom.class_overview import live_list, score_curve
from cutenv.people.classroom.class_store import CutEnd, NewCut
from cutenv.people.classroom.class_tables import TRIAL
from cutenv.people.classroom.foreign_upload import LARGEST_UPLOAD
from cutenv.people.classroom.teacher_pages import qr_code
from cutenv.people.play.course import SHIPPED_COURSES, named_course
from cutenv.records import load_one, save
from cutenv.records.scoring.study.estimate import FEWEST_PEOPLE
from cutenv.sim.trace import Trace

WRITES_A_PAGE = """
import json, pathlib, sys
given = json.load(sys.stdin)
out = pathlib.Path(given[given.index("--out") + 1])
out.write_text("<p>a page</p>")
(out.parent / "class.html").write_text("everybody")
print("made of", sum(each.endswith(".csv") for each in given) - 1, out)
"""
FAILS = """
import sys
print("reading:  40%|####      | 2/5", file=sys.stderr)
sys.exit("cutenv study: these cuts are no study.")
"""
WAITS = "import time\ntime.sleep(600)"


def full(room: Room, people: int = 4) -> TestClient:
    """Let some people have a saved cut each, in class 2b; the teacher's client."""
    for number in range(1, people + 1):
        code = f"P{number:02}"
        room.store.add_code(code)
        cut = room.store.hand_out(code, lambda _, seed=number: NewCut("liver", seed))
        room.store.finish(cut.id, CutEnd(state="saved", record=f"{code}.csv", outcome="success", score=50 + number))
        (room.lesson.folder / code).mkdir()
        (room.lesson.folder / code / f"{code}.csv").write_text("a record")
    room.store.put([f"P{number:02}" for number in range(1, people + 1)], class_name="2b")
    return room.teacher()


def ended(teacher: TestClient, path: str) -> Any:
    until = time.monotonic() + 60.0
    while "refresh" in (answer := teacher.get(path)).headers:
        assert time.monotonic() < until
        time.sleep(0.02)
    return answer


# Classes and groups


def test_people_are_put_into_classes_and_groups_and_taken_out(room: Room) -> None:
    teacher = full(room)
    answer = teacher.post("/teacher/places", data={"code": ["P01", "P02"], "class_name": "", "group": "trained"})
    assert answer.status_code == 303
    assert room.store.places()["P01"] == ("2b", "trained", "")
    assert room.store.places()["P03"] == ("2b", "", "")
    teacher.post("/teacher/places", data={"code": "P01", "class_name": "-", "group": "-"})
    assert "P01" not in room.store.places()
    page = words(teacher.get("/teacher").text)
    assert "P02 2b trained" in page
    assert teacher.post("/teacher/codes", data={"count": "2", "class_name": "3a"}).status_code == 303
    assert sum(place.class_name == "3a" for place in room.store.places().values()) == 2


@pytest.mark.parametrize("name", ["<script>", "a" * 33, "--out", "a\nb", "'; DROP TABLE people"])
def test_a_bad_name_of_a_group_is_refused(room: Room, name: str) -> None:
    teacher = full(room, 1)
    answer = teacher.post("/teacher/places", data={"code": "P01", "group": name})
    assert answer.status_code == 422
    assert "is no name" in answer.json()["error"]
    before = room.store.codes()
    assert teacher.post("/teacher/codes", data={"count": "1", "class_name": name}).status_code == 422
    assert room.store.codes() == before


def test_an_error_is_a_page_for_whoever_reads_pages(room: Room) -> None:
    answer = room.teacher().post("/teacher/places", headers={"Accept": "text/html"})
    assert answer.status_code == 422
    assert 'role="alert">Nobody is ticked' in answer.text


# A lesson that goes on


def test_the_live_list_says_who_cuts_stalls_and_left(room: Room) -> None:
    teacher, people = room.teacher(), {code: room.person(code) for code in ("P01", "P02", "P03", "P04", "P05")}
    room.store.add_code("P06")
    room.store.put(["P01", "P02", "P06"], class_name="2b")
    begun(people["P02"], lasts=50.0)
    begun(people["P01"], lasts=5.0)
    begun(people["P03"], lasts=0.0)
    people["P03"].post("/leave")
    begun(people["P04"], lasts=0.0)
    people["P04"].post("/cuts")  # another page: that cut is left
    doing = {row["code"]: row["doing"] for row in live_list(room.lesson, "en")}
    assert doing == {
        "P01": "cutting", "P02": "stalled", "P03": "left off", "P04": "left off", "P05": "here", "P06": "away"
    }  # fmt: skip
    answer = teacher.get("/teacher/live")
    assert answer.headers["refresh"] == "5"
    rows = re.findall(r'href="people/(P\d\d)"', answer.text)
    assert rows == ["P02", "P01", "P03", "P04", "P05", "P06"], "those who may need help come first"
    assert "1 cutting, 1 stalled, of 6." in words(answer.text)
    chosen = teacher.get("/teacher/live", params={"class": "2b", "by": "code"}).text
    assert re.findall(r'href="people/(P\d\d)"', chosen) == ["P01", "P02", "P06"]
    assert teacher.get("/teacher/live", params={"by": "age"}).status_code == 422
    assert people["P01"].get("/teacher/live").status_code == 401


@pytest.mark.parametrize("by", ["cuts", "score"])
def test_the_live_list_is_sorted_by_numbers(room: Room, by: str) -> None:
    full(room)
    room.store.add_code("P00")
    assert [row["code"] for row in live_list(room.lesson, "en", by=by)] == ["P00", "P01", "P02", "P03", "P04"]


def test_a_comment_reaches_its_person_alone_and_is_taken_back(room: Room, tmp_path: Path) -> None:
    teacher, own, other = room.teacher(), room.person("P01"), room.person("P02")
    path = "/teacher/people/P01/comment"
    said = "<script>alert(1)</script> Slower near the target."
    assert teacher.post(path, data={"said": said}).status_code == 303
    assert own.get("/comments").json()[0]["said"] == said
    assert other.get("/comments").json() == []
    page = teacher.get("/teacher/people/P01").text
    assert "<script>" not in page
    assert "Slower near the target." in page
    assert own.post(path, data={"said": "good"}).status_code == 401
    for bad in ("  ", "a" * 501):
        assert teacher.post(path, data={"said": bad}).status_code == 422
    assert teacher.post("/teacher/people/P99/comment", data={"said": "nobody"}).status_code == 404
    write_backup(room.store, room.lesson.folder, tmp_path / "class.zip")
    restored = ClassStore(f"sqlite:///{tmp_path / 'again.db'}")
    restore_backup(restored, tmp_path / "again", tmp_path / "class.zip")
    (comment,) = restored.comments("P01")
    restored.close()
    teacher.post(path, data={"take_back": comment.id})
    assert own.get("/comments").json() == []
    teacher.post(path, data={"said": "once more"})
    teacher.post("/teacher/delete", data={"code": "P01", "again": "P01"})
    assert room.store.comments("P01") == []


def test_a_person_has_a_way_back_and_to_the_next(room: Room) -> None:
    page = full(room, 3).get("/teacher/people/P02").text
    assert 'href="../../teacher">Back to the class' in page
    assert re.findall(r'href="(P\d\d)" rel="(\w+)"', page) == [("P01", "prev"), ("P03", "next")]


def test_the_teacher_tries_a_lesson_of_which_nothing_counts(room: Room) -> None:
    room.store.add_code("P01")
    teacher = room.teacher()
    assert teacher.post("/teacher/try").headers["location"] == "../cut"
    answer, _ = cut_once(teacher)
    assert answer.status_code == 200
    assert len(teacher.get("/cuts").json()) == 1
    for page in ("/teacher", "/teacher/live", "/teacher/sheet", "/teacher/cuts.csv"):
        assert TRIAL not in teacher.get(page).text, page
    with zipfile.ZipFile(io.BytesIO(teacher.get("/teacher/records.zip").content)) as archive:
        assert archive.namelist() == ["cuts.csv"]
    assert room.client().post("/", data={"code": TRIAL, "consent": "yes"}).status_code == 403
    assert room.client().post("/teacher/try").status_code == 401
    teacher.post("/teacher/try")
    assert teacher.get("/cuts").json() == [], "it begins anew"


def test_the_sheet_has_a_roster(room: Room) -> None:
    room.store.add_code("P01")
    assert '<th scope="row">P01</th><td>–</td><td></td>' in room.teacher().get("/teacher/sheet").text
    assert 'value="P01"' in room.client().get("/", params={"code": "P01"}).text
    assert "<script>" not in room.client().get("/", params={"code": '"><script>'}).text


def test_a_telephone_reads_the_code_of_a_slip(room: Room) -> None:
    segno = pytest.importorskip("segno", reason="QR codes are an extra: pip install 'cutenv[serve]'")
    cv2 = pytest.importorskip("cv2", reason="reads QR codes in the tests: pip install 'cutenv[vision]'")
    room.store.add_code("P01")
    assert qr_code("http://class/", "P01") in room.teacher().get("/teacher/sheet").text
    dark = np.array(segno.make("http://class/?code=P01", error="m", micro=False).matrix, np.uint8)
    picture = np.pad(np.kron(255 * (1 - dark), np.ones((8, 8), np.uint8)), 32, constant_values=255)
    assert cv2.QRCodeDetector().detectAndDecode(picture.astype(np.uint8))[0] == "http://class/?code=P01"


# The course


def form_of(page: str) -> dict[str, Any]:
    """Return the form of the course's page as a browser sends it."""
    sent: dict[str, list[str]] = {}
    form = page[page.index('<form method="post">') :]
    for name, inner in re.findall(r'<select name="([^"]+)">(.*?)</select>', form, re.DOTALL):
        options = re.findall(r'<option value="([^"]*)"( selected)?', inner)
        sent.setdefault(name, []).append(next((value for value, chosen in options if chosen), options[0][0]))
    for tag in re.findall(r"<input [^>]*>", form):
        found = dict(re.findall(r'(\w+)="([^"]*)"', tag))
        if found.get("type") != "checkbox" or " checked" in tag:
            sent.setdefault(found["name"], []).append(found.get("value", ""))
    return sent


@pytest.mark.parametrize("name", [*SHIPPED_COURSES])
def test_a_shipped_course_is_kept_by_the_page_as_it_is(room: Room, name: str, tmp_path: Path) -> None:
    teacher = room.teacher()
    form = form_of(teacher.get("/teacher/course", params={"from": name}).text)
    assert teacher.post("/teacher/course", data=form | {"do": "keep"}).status_code == 303
    assert room.lesson.course == named_course(name)
    (tmp_path / "sent.toml").write_bytes(teacher.get("/teacher/course.toml").content)
    assert named_course(str(tmp_path / "sent.toml")) == named_course(name)


def test_a_course_of_the_page_holds_at_once_in_every_server_and_is_withdrawn(room: Room) -> None:
    teacher, client = room.teacher(), room.person("P01")
    client.post("/cuts")
    new = {
        "name": 'two "tasks"', "about": "", "0-name": "second", "0-place": "2", "0-specimen_class": "liver",
        "0-feedback": "never", "1-name": "first", "1-place": "1", "1-specimen_class": "uniform", "1-seeds": "11; 12",
        "1-feedback": "afterwards", "1-target_length_mm": "62,5", "1-repetitions": "2", "1-mark": ["overall_score", ""],
        "1-limit": ["60", ""], "2-name": "none", "2-specimen_class": "liver", "2-drop": "yes", "do": "keep",
    }  # fmt: skip
    assert teacher.post("/teacher/course", data=new).status_code == 303
    course = room.lesson.course
    assert course is not None
    assert [task.name for task in course.tasks] == ["first", "second"]
    assert (course.tasks[0].seeds, course.tasks[0].target_length) == ((11, 12), 0.0625)
    assert course.tasks[0].mark == {"overall_score": 60}
    handed_out = client.post("/cuts").json()
    assert (handed_out["seed"], handed_out["feedback"]) == (11, "afterwards")
    assert Lesson(room.store, room.lesson.folder).course == course
    assert teacher.post("/teacher/course", data={"do": "withdraw"}).status_code == 303
    assert room.lesson.course is None
    assert client.post("/cuts").json()["feedback"] == "always"


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"name": ""}, "name"),
        ({"0-seeds": "eleven"}, "seeds"),
        ({"0-repetitions": "0"}, "repetitions"),
        ({"0-target_length_mm": "5"}, "target_length_mm"),
        ({"0-mark": "overall_score", "0-limit": "a lot"}, "mark overall_score"),
        ({"0-mark": "age", "0-limit": "3"}, "age"),
        ({"0-feedback": "<script>"}, "feedback"),
        ({"0-opens": "tomorrow"}, "opens must be a date"),
        ({"0-attempts": "1", "0-repetitions": "2"}, "attempts = 1 is less than repetitions = 2"),
        ({"1-name": "one", "1-specimen_class": "liver"}, "two tasks are called"),
        ({"0-name": ""}, "it has no tasks"),
    ],
)
def test_a_bad_course_is_refused_and_stays_to_be_mended(room: Room, changed: dict[str, str], says: str) -> None:
    teacher = room.teacher()
    good = {"name": "a", "0-name": "one", "0-specimen_class": "liver", "do": "keep"}
    answer = teacher.post("/teacher/course", data=good | changed)
    assert answer.status_code == 422
    assert says in words(answer.text)
    assert "<script>" not in answer.text
    assert room.lesson.course is None
    assert room.client().post("/teacher/course", data=good).status_code == 401
    assert room.person("P01").get("/teacher/course.toml").status_code == 401


def test_a_task_opens_closes_and_ends_with_its_attempts(room: Room) -> None:
    teacher, client = room.teacher(), room.person("P01")
    now = room.store.clock().astimezone()
    common = {"0-specimen_class": "uniform", "1-specimen_class": "uniform", "0-name": "first", "1-name": "last"}
    dates = {
        "0-closes": f"{now + timedelta(hours=5):%Y-%m-%dT%H:%M}",
        "1-opens": f"{now + timedelta(hours=2):%Y-%m-%dT%H:%M}",
    }
    limited = {"0-attempts": "2", "0-mark": "overall_score", "0-limit": "99"}
    form = {"name": "dated", **common, **dates, **limited, "do": "keep"}
    assert teacher.post("/teacher/course", data=form).status_code == 303
    told = client.post("/cuts").json()["ahead"]
    assert "Attempt 1 of 2. It closes on " in told["en"]
    assert "Versuch 1 von 2. Sie schließt am " in told["de"]
    for _ in range(2):
        assert cut_once(client, hand(600))[0].status_code == 200
    waiting = client.post("/cuts").json()
    assert waiting["done"] is True
    assert "Task 2 of 2, last" in waiting["ahead"]["en"]
    assert "It opens on " in waiting["ahead"]["en"]
    CLOCK.ahead += timedelta(hours=3)
    other = room.person("P02")
    client.post("/", data={"code": "P01", "consent": "yes"})
    assert client.post("/cuts").json()["done"] is False
    assert "first" in other.post("/cuts").json()["ahead"]["en"]
    CLOCK.ahead += timedelta(hours=3)
    other.post("/", data={"code": "P02", "consent": "yes"})
    assert "last" in other.post("/cuts").json()["ahead"]["en"], "the first task is closed"
    shown = form_of(teacher.get("/teacher/course").text)
    before = room.lesson.course
    assert teacher.post("/teacher/course", data=shown | {"do": "keep"}).status_code == 303
    assert room.lesson.course == before
    bad = teacher.post("/teacher/course", data=form | {"0-closes": "2026-01-01T00:00", "0-opens": "2026-02-01T00:00"})
    assert "is not after opens" in words(bad.text)


def test_a_course_file_damaged_by_hand_changes_nothing(room: Room) -> None:
    teacher = room.teacher()
    teacher.post("/teacher/course", data={"name": "a", "0-name": "one", "0-specimen_class": "liver", "do": "keep"})
    course = room.lesson.course
    room.lesson.courses.file().write_text("name = ")
    assert room.lesson.course == course


# Pass marks


def test_a_pass_mark_in_force_stands_on_every_card(room: Room) -> None:
    teacher, person = room.teacher(), room.person("P07")
    assert cut_once(person)[0].json()["passed"] is None
    assert teacher.post("/teacher/pass-mark", data={"mark": "99,5"}).status_code == 303
    said = cut_once(person)[0].json()
    assert (said["passed"], said["pass_mark"]) == (False, 99.5)
    teacher.post("/teacher/pass-mark", data={"mark": "0"})
    assert cut_once(person)[0].json()["passed"] is True
    assert "stroke-dasharray" in person.get("/curve").json()["curve"]
    assert "3 of 3 pass" in words(teacher.get("/teacher/people/P07").text)
    teacher.post("/teacher/pass-mark", data={"withdraw": "yes"})
    assert cut_once(person)[0].json()["passed"] is None


@pytest.mark.parametrize("mark", ["", "101", "-1", "nan", "60 points"])
def test_what_is_no_pass_mark_is_refused(room: Room, mark: str) -> None:
    answer = room.teacher().post("/teacher/pass-mark", data={"mark": mark})
    assert answer.status_code == 422
    assert re.search("0 to 100", answer.text)
    assert room.store.pass_mark("") is None


def test_where_feedback_is_never_shown_the_history_hides_it_too(room: Room, tmp_path: Path) -> None:
    course = tmp_path / "course.toml"
    course.write_text(
        'name = "two"\n[[task]]\nname = "blind"\nspecimen_class = "liver"\nfeedback = "never"\nrepetitions = 9'
    )
    full(room, 1)
    cut = room.store.hand_out("P01", lambda _: NewCut("liver", 1, task="blind"))
    room.store.finish(cut.id, CutEnd(state="saved", record="x.csv", outcome="success", score=77))
    lesson = Lesson(room.store, room.lesson.folder, named_course(str(course)))
    told = [(each["outcome"], each["score"]) for each in lesson.history("P01")]
    assert told == [({"en": "success", "de": "Erfolg"}, 51), ({}, None)]


# Studies


@pytest.mark.parametrize(
    ("form", "why"),
    [
        ({"kind": "study"}, "Nobody of these people"),
        ({"kind": "study", "class": "9z"}, "Nobody of these people"),
        ({"kind": "pass-mark", "class": "2b"}, f"takes {FEWEST_PEOPLE} people with cuts in each"),
        ({"kind": "pass-mark", "class": "2b", "passing": "a", "failing": "b"}, "here: a 1, b 2"),
        ({"kind": "study", "class": "2b", "passing": "a", "failing": "a"}, "are the same"),
        ({"kind": "pass-mark", "class": "2b", "mark": "much"}, "score of 0 to 100"),
    ],
)
def test_too_few_people_are_told_in_plain_words(room: Room, form: dict[str, str], why: str) -> None:
    teacher = full(room)
    room.store.put(["P01"], group="a")
    room.store.put(["P02", "P03"], group="b")
    answer = teacher.post("/teacher/studies", data=form)
    assert answer.status_code == 422
    assert why in words(answer.text)
    assert room.lesson.analyses.all() == []


def test_a_study_is_made_beside_the_server_and_can_be_had(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.analysis._PROGRAM", WRITES_A_PAGE)
    teacher = full(room)
    room.store.put(["P01"], group="a")
    room.store.put(["P02", "P03"], group="b")
    lost = room.store.hand_out("P02", lambda _: NewCut("liver", 9))
    room.store.finish(lost.id, CutEnd(state="left"))
    begun = teacher.post("/teacher/studies", data={"kind": "study", "class": "2b", "passing": "a", "failing": "b"})
    path = f"/teacher/{begun.headers['location']}"
    page = ended(teacher, path).text
    assert "made of 4 study.html" in page, "every record is given, and no path of the server is shown"
    assert teacher.get(f"{path}/study.html").text == "<p>a page</p>"
    assert teacher.get(f"{path}/people.csv").text.splitlines()[1:] == [
        "P01.csv,P01,1,a", "P02.csv,P02,2,b", ",P02,3,b", "P03.csv,P03,4,b", "P04.csv,P04,5,none"
    ]  # fmt: skip
    with zipfile.ZipFile(io.BytesIO(teacher.get(f"{path}/all.zip").content)) as archive:
        assert set(archive.namelist()) == {"study.html", "class.html", "people.csv"}
    for name in ("said.txt", "..%2f..%2fclass.db", "nothing.html"):
        assert teacher.get(f"{path}/{name}").status_code == 404
    assert teacher.post(f"{path}/drop").status_code == 303
    assert teacher.get(path).status_code == 404
    assert list((room.lesson.folder.parent / "studies").iterdir()) == []


def test_a_study_that_fails_says_why(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.analysis._PROGRAM", FAILS)
    teacher = full(room)
    begun = teacher.post("/teacher/studies", data={"kind": "study", "class": "2b"})
    page = ended(teacher, f"/teacher/{begun.headers['location']}").text
    assert "<pre>these cuts are no study.</pre>" in page


def test_whoever_is_deleted_is_deleted_from_studies_too(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.analysis._PROGRAM", WRITES_A_PAGE)
    teacher = full(room)
    paths = []
    for code in ("P01", "P02"):
        begun = teacher.post("/teacher/studies", data={"kind": "study", "code": code})
        paths.append(f"/teacher/{begun.headers['location']}")
        ended(teacher, paths[-1])
    left = room.lesson.folder.parent / "studies" / "of a killed server"
    left.mkdir()
    (left / "people.csv").write_text("record,operator,order\nP01.csv,P01,1\n")
    teacher.post("/teacher/delete", data={"code": "P01", "again": "P01"})
    assert [teacher.get(path).status_code for path in paths] == [404, 200]
    assert not left.exists()


def test_a_study_at_work_can_be_ended_and_keeps_nobody_waiting(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.classroom.analysis._PROGRAM", WAITS)
    teacher, person = full(room), room.person("P09")
    paths = [
        f"/teacher/{teacher.post('/teacher/studies', data={'kind': 'study', 'class': '2b'}).headers['location']}"
        for _ in range(2)
    ]
    assert "waiting for the one before" in teacher.get(paths[1]).text
    assert cut_once(person)[0].status_code == 200, "the server answers meanwhile"
    for path in paths:
        teacher.post(f"{path}/drop")
    began = time.monotonic()
    room.lesson.analyses.close()
    assert time.monotonic() - began < 30.0, "what is at work ends with the server"


# Records of other programs

TABLE = "Zeit [ms];Kraft;Weg [mm];Kommentar\n" + "".join(
    f"{k};{(3 * (k - 200) if 200 < k < 1500 else 0)},5;{0.05 * k:.3f};0\n".replace(".", ",") for k in range(2000)
)
COLUMNS = {"time": "1", "force": "2", "force_unit": "mN", "position": "3"}
KEEP = COLUMNS | {"do": "keep", "consent": "yes", "code": "P01"}


def uploaded(teacher: TestClient, content: str | bytes, name: str = "Anna Schmidt.csv") -> Any:
    raw = content.encode() if isinstance(content, str) else content
    answer = teacher.post("/teacher/upload", files=[("record", (name, raw, "text/csv"))])
    return answer if answer.status_code != 303 else f"/teacher/{answer.headers['location']}"


def test_a_record_of_another_program_is_looked_at_and_kept_and_marked(room: Room) -> None:
    teacher = full(room)
    path = uploaded(teacher, TABLE)
    form = teacher.get(path).text
    assert [form.count(f'<option value="{k}" selected>') for k in (1, 2, 3)] == [1, 1, 1], "guessed from the header"
    assert "<td>0,050</td>" in form
    looked = words(teacher.post(path, data=COLUMNS | {"target": "70"}).text)
    assert re.search(r"Anna Schmidt.csv \d+ 1\.80 s 3\.9 N .* – 100\.0 mm", looked), looked
    assert teacher.post(path, data=COLUMNS).text.count('<img src="data:image/svg+xml;base64,') == 1
    kept = teacher.post(path, data=KEEP | {"target": "70"})
    assert (kept.status_code, kept.headers["location"]) == (303, "../people/P01")
    assert "from another program, not confirmed by the law" in words(teacher.get("/teacher/people/P01").text)
    (record,) = (room.lesson.folder / "P01").glob("*_foreign_*.csv")
    trace = load_one(record)
    assert trace.force.max() == pytest.approx(3.8975)
    facts = {"operator": "P01", "consent": True, "confirmed_by_law": False, "target_length_m": 0.07}
    assert facts.items() <= trace.metadata.items()
    assert b"Schmidt" not in record.read_bytes()
    assert f"{record.name},P01,2b,,," in teacher.get("/teacher/cuts.csv").text
    assert ',foreign,"no, from another program",' in teacher.get("/teacher/cuts.csv").text
    (cut,) = (cut for cut in room.store.cuts("P01") if cut.state == "foreign")
    assert teacher.get(f"/teacher/P01/{cut.id}").status_code == 200
    assert teacher.get(path).status_code == 404, "what was kept is no longer staged"


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "empty"), (b"\x89PNG\r\n\x1a\n\x00\x00", "no text"), (b"PK\x03\x04zip", "a zip file"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"), (b"a letter\nwithout numbers\n", "no rows of numbers"),
        (b"1;" * 30_000, "longer than"), ((b"1;" * 70 + b"\n") * 9, "export at most"), (b"1\x002\n", "zero bytes"),
    ],
)  # fmt: skip
def test_what_is_no_record_is_refused_with_the_reason(room: Room, content: bytes, why: str) -> None:
    teacher = full(room, 1)
    answer = uploaded(teacher, content, "../../etc/x<script>.csv")
    assert answer.status_code == 422
    assert why in answer.text
    assert "<script>" not in answer.text
    assert "etc" not in answer.text


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"force": ""}, "no column is picked for the force"),
        ({"force": "9"}, "there is no column #9"),
        ({"force": "x"}, "there is no column"),
        ({"time": ""}, "readings a second"),
        ({"rate": "1000"}, "one of both"),
        ({"time": "4"}, "must increase"),
        ({"force_unit": ""}, "unit of force is not known"),
        ({"force_unit": "cm"}, "unit of force"),
        ({"position_unit": "inch"}, "but the file has mm"),
        ({"depth": "4", "depth_value": "20"}, "Leave one of them out"),
        ({"depth_value": "deep"}, "is no number"),
        ({"target": "7000"}, "target"),
        ({"consent": ""}, "consent"),
        ({"code": "P99"}, "no such code"),
    ],
)
def test_columns_that_do_not_fit_are_refused_and_nothing_is_kept(room: Room, changed: dict[str, str], why: str) -> None:
    teacher = full(room, 1)
    answer = teacher.post(uploaded(teacher, TABLE), data=KEEP | changed)
    assert answer.status_code in (404, 422)
    assert why in words(answer.text)
    assert [cut.state for cut in room.store.cuts()] == ["saved"]


def test_depth_angle_and_components_are_read_as_everywhere_else(room: Room) -> None:
    teacher = full(room, 1)
    rows = "".join(f"{k / 1000} {3 * k / 2000} {4 * k / 2000} {k / 20000}\n" for k in range(2000))
    path = uploaded(teacher, "t Fx Fy x\n" + rows, "a.txt")
    picked = {"time": "1", "time_unit": "s", "force": "2", "force_y": "3", "force_unit": "N", "position": "4"}
    units = {"position_unit": "m", "depth_value": "12,5", "angle_value": "45"}
    assert teacher.post(path, data=KEEP | picked | units).status_code == 303
    (record,) = (room.lesson.folder / "P01").glob("*_foreign_*.csv")
    trace = load_one(record)
    assert trace.force[-1] == pytest.approx(5 * 1999 / 2000)
    assert trace.depth is not None
    assert trace.angle is not None
    assert trace.depth[0] == pytest.approx(0.0125)
    assert trace.angle[0] == pytest.approx(np.pi / 4)


def test_an_own_record_needs_no_columns_and_cannot_pose_as_a_confirmed_one(room: Room, tmp_path: Path) -> None:
    time_s = np.arange(1000) / 1000
    claimed = {"operator": "P02", "course": "c", "task": "t", "tip_end_m": 0.07, "rig": "bench 2"}
    forged = Trace(time=time_s, force=np.sin(3 * time_s), position=time_s / 20, metadata=claimed)
    save(forged, tmp_path / "own.csv")
    teacher = full(room, 1)
    path = uploaded(teacher, (tmp_path / "own.csv").read_bytes())
    assert "<select" not in teacher.get(path).text
    assert teacher.post(path, data={"do": "keep", "consent": "yes", "code": "P01"}).status_code == 303
    (record,) = (room.lesson.folder / "P01").glob("*_foreign_*.csv")
    facts = load_one(record).metadata
    assert (facts["operator"], facts["rig"]) == ("P01", "bench 2")
    assert not {"course", "task", "tip_end_m"} & set(facts)


def test_only_an_upload_may_be_large_and_it_has_its_limit(room: Room) -> None:
    teacher = room.teacher()
    assert uploaded(teacher, TABLE + "\n" * 2**20).startswith("/teacher/upload/")
    assert uploaded(teacher, b"1\n" * (LARGEST_UPLOAD // 2)).status_code == 413
    assert teacher.post("/teacher/studies", content=b"x" * 2**20).status_code == 413


def test_uploads_do_not_pile_up(room: Room) -> None:
    teacher = room.teacher()
    paths = [uploaded(teacher, "t;F\n" + "1;2\n" * 9) for _ in range(9)]
    assert [teacher.get(path).status_code for path in paths] == [404] + [200] * 8
    assert teacher.post(paths[1], data={"do": "drop"}).status_code == 303
    assert teacher.get(paths[1]).status_code == 404


# What is shared by all


def test_places_marks_and_foreign_records_are_in_a_backup(room: Room, tmp_path: Path) -> None:
    teacher = full(room)
    teacher.post(uploaded(teacher, TABLE), data=KEEP)
    teacher.post("/teacher/pass-mark", data={"mark": "61.5"})
    assert write_backup(room.store, room.lesson.folder, tmp_path / "class.zip") == 5
    fresh = ClassStore(f"sqlite:///{tmp_path / 'fresh.db'}")
    assert restore_backup(fresh, tmp_path / "fresh" / "records", tmp_path / "class.zip") == 5
    assert fresh.places() == room.store.places()
    assert fresh.pass_mark("") == room.store.pass_mark("")
    with zipfile.ZipFile(tmp_path / "class.zip") as archive:
        rows = json.loads(archive.read("class.json"))
    old = {name: rows[name] for name in ("people", "cuts")}  # as before there were classes
    older = ClassStore(f"sqlite:///{tmp_path / 'older.db'}")
    older.fill(old)
    assert older.cuts() == room.store.cuts()
    for store in (fresh, older):
        store.close()


def test_a_curve_is_drawn_of_scores_and_a_mean_of_three_people_or_more() -> None:
    assert score_curve([[None], []]) == ""
    one = score_curve([[20, None, 60]], mark=50)
    assert one.count("<circle") == 2
    assert "stroke-dasharray" in one
    assert class_means([[10, 20], [20, 30, 40], [30, 40]]) == [20, 30]
    many = score_curve([[10, 20], [20, 30, 40], [30, 40]])
    assert many.count("<polyline") == 4
    assert "<circle" not in many


def test_what_a_file_leaves_open_is_asked_on_the_page_and_a_way_toward_the_clamp_is_turned(room: Room) -> None:
    teacher = full(room, 1)
    rows = "".join(
        f"{k / 100:.2f};{3.0 * (50 < k < 150):.1f};{60.0 - 0.3 * min(max(k - 50, 0), 100):.2f}\n".replace(".", ",")
        for k in range(200)
    )
    path = uploaded(teacher, "t [s];Kraft;Weg [mm]\n" + rows)
    form = teacher.get(path).text
    assert "In which unit is the force" in form
    assert re.search(r'name="position_sign" value="-" checked', form)
