"""Several courses in one class: each person goes through the one that the teacher gave."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from class_room import Room, begun, cut_once, hand, message, sent, to_the_end, words

from cutenv.agents.policy import experts
from cutenv.commands import cli
from cutenv.people.browser import HandCut
from cutenv.people.browser.stylus_steps import HandPathCut
from cutenv.people.browser.watched_cut import expert_way, from_runs
from cutenv.people.classroom import ClassStore, Lesson
from cutenv.people.classroom.class_backup import restore_backup, write_backup
from cutenv.people.play.course import WARM_UP, course_of
from cutenv.records import load_one

FIRST = {"name": "surgeons", "0-name": "liver first", "0-specimen_class": "liver", "do": "keep"}
SECOND = {"name": "Nurses 2b", "0-name": "even tissue", "0-specimen_class": "uniform", "course": "+", "do": "keep"}


@pytest.fixture
def two(room: Room) -> Room:
    """A class with a course for everybody, and a further one."""
    teacher = room.teacher()
    assert teacher.post("/teacher/course", data=FIRST).status_code == 303
    made = teacher.post("/teacher/course", data=SECOND)
    assert (made.status_code, made.headers["location"]) == (303, "course?course=nurses-2b")
    return room


def ahead(client: Any) -> str:
    return str(client.post("/cuts").json()["ahead"]["en"])


def test_new_codes_and_old_ones_get_a_course(two: Room) -> None:
    teacher = two.teacher()
    teacher.post("/teacher/codes", data={"count": "1", "course": "nurses-2b"})
    teacher.post("/teacher/codes", data={"count": "1"})
    (nurse, _), (surgeon, _) = two.store.codes()
    assert ahead(two.person(nurse)).startswith("Task 1 of 1, even tissue:")
    assert ahead(two.person(surgeon)).startswith("Task 1 of 1, liver first:")
    shown = words(teacher.get("/teacher").text)
    assert "Nurses 2b Task 1 of 1, even tissue" in shown
    assert "surgeons Task 1 of 1, liver first" in shown
    assert "Nurses 2b Task 1 of 1" in words(teacher.get("/teacher/live").text)
    assert "Course: Nurses 2b" in words(teacher.get(f"/teacher/people/{nurse}").text)
    teacher.post("/teacher/places", data={"code": [nurse, surgeon], "course": "-"})
    assert {ahead(two.person(code))[:23] for code in (nurse, surgeon)} == {"Task 1 of 1, liver firs"}
    teacher.post("/teacher/places", data={"code": surgeon, "class_name": "2b"})
    teacher.post("/teacher/places", data={"code": surgeon, "course": "nurses-2b"})
    assert ahead(two.person(surgeon)).startswith("Task 1 of 1, even tissue:")
    assert two.store.places()[surgeon] == ("2b", "", "nurses-2b")
    for bad in ({"count": "1", "course": "else"}, {"count": "1", "course": "../x"}):
        answer = teacher.post("/teacher/codes", data=bad)
        assert (answer.status_code, "there is no course" in answer.text) == (422, True)
    assert len(two.store.codes()) == 2, "a bad course makes no codes"


def test_a_cut_counts_in_its_course_and_again_when_its_person_comes_back(two: Room) -> None:
    person = two.person("P01")
    assert cut_once(person, to_the_end())[0].json()["ahead"]["en"].endswith("is done: 1 of 1 tasks.")
    two.lesson.put(["P01"], course="nurses-2b")
    handed_out = begun(person)
    assert handed_out["specimen_class"] == "uniform"
    two.lesson.put(["P01"], course="")
    refused = sent(person, handed_out)
    assert (refused.status_code, "served no more" in refused.text) == (422, True)
    assert person.post("/cuts").json()["done"] is True
    assert [cut.course for cut in two.store.cuts("P01")] == ["surgeons", "Nurses 2b"]
    first, second = person.get("/cuts").json()
    assert (first["replay"], second["state"]) == (True, "taken back")


def test_what_a_course_hides_stays_hidden_in_another(two: Room) -> None:
    hidden = {"name": "exam", "task": [{"name": "one", "specimen_class": "liver", "feedback": "never"}]}
    two.lesson.courses.set(course_of(hidden), "exam")
    two.lesson.put([], course="exam")
    person = two.person("P01")
    two.lesson.put(["P01"], course="exam")
    assert cut_once(person)[0].json()["score"] is None
    two.lesson.put(["P01"], course="nurses-2b")
    (made,) = person.get("/cuts").json()
    assert (made["score"], made["outcome"], made["replay"]) == (None, {}, False)


def test_each_course_has_its_pass_mark_and_its_study(two: Room) -> None:
    teacher, people = two.teacher(), {code: two.person(code) for code in ("P01", "P02")}
    two.lesson.put(["P02"], course="nurses-2b")
    teacher.post("/teacher/pass-mark", data={"mark": "0", "course": "surgeons"})
    teacher.post("/teacher/pass-mark", data={"mark": "99", "course": "Nurses 2b"})
    said = {code: cut_once(person)[0].json() for code, person in people.items()}
    assert [(each["pass_mark"], each["passed"]) for each in said.values()] == [(0.0, True), (99.0, False)]
    shown = words(teacher.get("/teacher/studies").text)
    assert "Pass mark in force (surgeons) 0 " in shown
    assert "Pass mark in force (Nurses 2b) 99 " in shown
    for course, expected in (("", 2), ("Nurses 2b", 1)):
        made = teacher.post("/teacher/studies", data={"class": "", "kind": "study", "course": course})
        assert made.status_code == 303
        number = made.headers["location"].rpartition("/")[2]
        assert len(two.lesson.analyses.find(number).people) == expected
        two.lesson.analyses.drop(number)


def test_the_page_edits_each_course_and_deletes_one(two: Room) -> None:
    teacher = two.teacher()
    assert 'value="Nurses 2b"' in teacher.get("/teacher/course", params={"course": "nurses-2b"}).text
    assert 'value="surgeons"' in teacher.get("/teacher/course").text
    same = teacher.post("/teacher/course", data=SECOND | {"name": "surgeons"})
    assert same.status_code == 422
    assert "another course of the class is called" in same.text
    assert teacher.get("/teacher/course", params={"course": "else"}).status_code == 404
    assert teacher.get("/teacher/course.toml", params={"course": "nurses-2b"}).text.startswith('name = "Nurses 2b"')
    two.person("P01")
    two.lesson.put(["P01"], course="nurses-2b")
    teacher.post("/teacher/try", data={"course": "nurses-2b"})
    assert "Nurses 2b" in words(teacher.get("/teacher/course").text)
    teacher.post("/teacher/course", data={"course": "nurses-2b", "do": "withdraw"})
    assert two.lesson.courses.further() == {}
    assert two.store.places() == {}
    assert two.lesson.course is not None


def test_the_trial_takes_a_course(two: Room) -> None:
    teacher = two.teacher()
    assert teacher.post("/teacher/try", data={"course": "nurses-2b"}).status_code == 303
    assert ahead(teacher).startswith("Task 1 of 1, even tissue:")


def test_files_put_there_by_hand_are_courses_and_travel_in_a_backup(room: Room, tmp_path: Path) -> None:
    folder = room.lesson.folder.parent / "courses"
    folder.mkdir()
    text = 'name = "by hand"\n[[task]]\nname = "one"\nspecimen_class = "uniform"\n'
    (folder / "By hand.toml").write_text(text, encoding="utf-8")
    (folder / "damaged.toml").write_text("name = ", encoding="utf-8")
    assert list(room.lesson.courses.further()) == ["By hand"]
    room.store.add_code("P01")
    room.lesson.put(["P01"], course="By hand")
    write_backup(room.store, room.lesson.folder, tmp_path / "all.zip")
    new = tmp_path / "new"
    new.mkdir()
    store = ClassStore(f"sqlite:///{new / 'class.db'}")
    assert restore_backup(store, new / "records", tmp_path / "all.zip") == 0
    lesson = Lesson(store, new / "records")
    assert lesson.progress("P01").ahead().startswith("Task 1 of 1, one:")  # type: ignore[union-attr]
    lesson.close()
    with zipfile.ZipFile(tmp_path / "all.zip") as archive:
        content = archive.read("class.json")
    for name in ("courses/../../x.toml", "courses/a/b.toml", "courses/.toml"):
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("class.json", content)
            archive.writestr(name, text)
        (tmp_path / "bad.zip").write_bytes(packed.getvalue())
        empty = ClassStore(f"sqlite:///{tmp_path / 'empty.db'}")
        with pytest.raises(ValueError, match="is no record of a class"):
            restore_backup(empty, tmp_path / "other" / "records", tmp_path / "bad.zip")
        empty.close()


def test_warm_up_cuts_come_first_and_count_for_nothing(two: Room) -> None:
    teacher, person = two.teacher(), two.person("P01")
    kept = teacher.post("/teacher/course", data=FIRST | {"warm_up": "2", "0-feedback": "never", "0-seeds": "11"})
    assert kept.status_code == 303
    assert two.lesson.course is not None
    assert two.lesson.course.warm_up == 2
    assert 'name="warm_up" value="2"' in teacher.get("/teacher/course").text
    two.store.set_pass_mark("surgeons", 0.0)
    first = person.post("/cuts").json()
    assert first["ahead"]["en"] == "Warm-up 1 of 2: it counts for nothing."
    assert first["ahead"]["de"] == "Aufwärmen 1 von 2: Es zählt nichts."
    assert (first["feedback"], first["seed"] != 11, first["demonstration"]) == ("always", True, False)
    said = cut_once(person, to_the_end())[0].json()
    assert (said["verdict"]["en"], said["passed"]) == ("A warm-up: it counts for nothing.", None)
    assert said["score"] is not None
    cut_once(person)  # given up
    handed_out = begun(person)
    assert handed_out["ahead"]["en"].startswith("Task 1 of 1, liver first:")
    assert (handed_out["feedback"], handed_out["seed"]) == ("never", 11)
    history = person.get("/cuts").json()
    assert [each["warm_up"] for each in history] == [True, True, False]
    assert person.get("/curve").json()["curve"] == ""
    record = load_one(next((two.lesson.folder / "P01").glob("*.csv")))
    assert (record.metadata["task"], record.metadata["practice"]) == ("(warm-up)", True)
    assert "warm-up" in words(teacher.get("/teacher/people/P01").text)
    refused = teacher.post("/teacher/studies", data={"class": "", "kind": "study"})
    assert refused.status_code == 422, "there is no cut but warm-ups"


def test_a_study_of_an_export_leaves_warm_ups_out_and_says_so_once(
    two: Room, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    teacher = two.teacher()
    course = FIRST | {"0-specimen_class": "uniform", "0-repetitions": "2", "warm_up": "1", "demonstration": "yes"}
    assert teacher.post("/teacher/course", data=course).status_code == 303
    for code in ("P01", "P02"):
        person = two.person(code)
        assert person.get("/demonstration").status_code == 200
        for _ in range(3):
            cut_once(person, to_the_end())
    folder = tmp_path / "export"
    with zipfile.ZipFile(io.BytesIO(teacher.get("/teacher/records.zip").content)) as archive:
        archive.extractall(folder)
    records = sorted(folder.rglob("P0*/*.csv"))
    assert len(records) == 6, "a demonstration is nobody's record"
    cards = tmp_path / "study.csv"
    assert (
        cli.main(["study", *map(str, records), "--metric", "peak_force", "--out", str(cards.with_suffix(".html"))]) == 0
    )
    said = capsys.readouterr()
    assert said.err.count("note: left out: 2 of 6 cuts, made for practice (practice: true in their records)") == 1
    with cards.open(newline="", encoding="utf-8") as file:
        studied = [(row["operator"], row["number"], row["record"]) for row in csv.DictReader(file)]
    counted = {str(trace.metadata["name"]) for trace in map(load_one, records) if trace.metadata["task"] != WARM_UP}
    assert [each[:2] for each in studied] == [("P01", "1"), ("P01", "2"), ("P02", "1"), ("P02", "2")]
    assert {each[2] for each in studied} == counted
    warm_ups = [str(path) for path in records if load_one(path).metadata["task"] == WARM_UP]
    assert cli.main(["study", *warm_ups]) == 2
    assert "all 2 cuts were made for practice" in capsys.readouterr().err


def test_a_course_shows_a_cut_before_the_first_one(two: Room) -> None:
    teacher, person = two.teacher(), two.person("P01")
    assert person.get("/demonstration").status_code == 404
    assert person.post("/cuts").json()["demonstration"] is False
    shown = {"0-specimen_class": "uniform", "0-target_length_mm": "30", "demonstration": "yes"}
    assert teacher.post("/teacher/course", data=FIRST | shown).status_code == 303
    assert 'name="demonstration" value="yes" checked' in teacher.get("/teacher/course").text
    assert person.post("/cuts").json()["demonstration"] is True
    found = person.get("/demonstration").json()
    made = HandCut(specimen_class="uniform", seed=found["specimen"]["seed"], target_length=0.03)
    made.follow(from_runs(found["movements"]))
    assert (made.end, made.success) == ("finished", True)
    assert found["expert"]["position"][-1] == pytest.approx(0.03, abs=0.02)
    cut_once(person)
    assert person.post("/cuts").json()["demonstration"] is False
    assert two.client().get("/demonstration").status_code == 401


def test_an_agent_shows_its_way_along_an_excision(two: Room) -> None:
    teacher, person = two.teacher(), two.person("P01")
    excision = {"0-task": "path", "0-line": "fusiform", "0-expert": "ppo-excision", "demonstration": "yes"}
    assert teacher.post("/teacher/course", data=FIRST | excision).status_code == 303
    assert 'value="ppo-excision" selected' in teacher.get("/teacher/course").text
    assert 'expert = "ppo-excision"' in teacher.get("/teacher/course.toml").text
    assert person.get("/demonstration").json()["by"] == "agent"
    cut = begun(person)
    made = HandPathCut(specimen_class="liver", seed=cut["seed"], line="fusiform")
    sent_cut = message(made, np.column_stack([hand(), np.linspace(0.0, 0.002, 900)]))
    assert person.post(f"/cuts/{cut['id']}", **sent_cut).status_code == 200
    replay = person.get(f"/cuts/{cut['id']}/replay").json()
    assert replay["by"] == "agent"
    assert replay["expert"] == expert_way("liver", cut["seed"], 0, task="path", line="fusiform", expert="ppo-excision")
    other = teacher.post("/teacher/course", data=FIRST | {"0-task": "gentle", "0-expert": "ppo-excision"})
    assert other.status_code == 422
    assert "expert must be" in other.text


def test_the_form_lists_agents_by_the_kind_they_can_cut(two: Room) -> None:
    text = two.teacher().get("/teacher/course").text
    (first, *_) = re.findall(r'<select name="0-expert">(.*?)</select>', text, re.DOTALL)
    listed = {
        kind: tuple(re.findall(r'value="([^"]+)"', options))
        for kind, options in re.findall(r'<optgroup label="([^"]+)">(.*?)</optgroup>', first, re.DOTALL)
    }
    assert listed == {"gentle cut": experts("gentle")[1:], "along a drawn line": experts("path")[1:]}
