"""The teacher's pages: classes and groups, pass marks, studies made beside the server, records of other programs."""

from __future__ import annotations

import io
import json
import re
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

from class_room import Room, cut_once
from starlette.testclient import TestClient

from cutenv.classroom import ClassStore, Lesson
from cutenv.classroom.class_backup import restore_backup, write_backup
from cutenv.classroom.class_overview import class_means, score_curve
from cutenv.classroom.class_store import CutEnd, NewCut
from cutenv.classroom.foreign_upload import LARGEST_UPLOAD
from cutenv.play.course import named_course
from cutenv.recording import load_one, save
from cutenv.scoring.study.estimate import FEWEST_PEOPLE
from cutenv.trace import Trace

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


def words(page: str) -> str:
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL).split())


# Classes and groups


def test_people_are_put_into_classes_and_groups_and_taken_out(room: Room) -> None:
    teacher = full(room)
    answer = teacher.post("/teacher/places", data={"code": ["P01", "P02"], "class_name": "", "group": "trained"})
    assert answer.status_code == 303
    assert room.store.places()["P01"] == ("2b", "trained")
    assert room.store.places()["P03"] == ("2b", "")
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
    assert room.lesson.pass_mark is None


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
    monkeypatch.setattr("cutenv.classroom.analysis._PROGRAM", WRITES_A_PAGE)
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
    monkeypatch.setattr("cutenv.classroom.analysis._PROGRAM", FAILS)
    teacher = full(room)
    begun = teacher.post("/teacher/studies", data={"kind": "study", "class": "2b"})
    page = ended(teacher, f"/teacher/{begun.headers['location']}").text
    assert "<pre>these cuts are no study.</pre>" in page


def test_whoever_is_deleted_is_deleted_from_studies_too(room: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.classroom.analysis._PROGRAM", WRITES_A_PAGE)
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
    monkeypatch.setattr("cutenv.classroom.analysis._PROGRAM", WAITS)
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


@pytest.mark.parametrize(
    "path",
    [
        "places", "studies", "studies/x", "studies/x/drop", "studies/x/y.html", "pass-mark", "upload", "upload/x",
        "cuts.csv", "people/P01",
    ],
)  # fmt: skip
def test_nobody_but_the_teacher_gets_in(room: Room, path: str) -> None:
    person = room.person("P01")
    for client in (room.client(), person):
        answers = [client.request(method, f"/teacher/{path}").status_code for method in ("GET", "POST")]
        assert set(answers) <= {401, 405}
        assert 401 in answers


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
