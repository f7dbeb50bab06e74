"""Faults of a class's server: it ends, its disk is full, its clock is set back, it is sent nonsense, is not alone."""

from __future__ import annotations

import signal
import ssl
import subprocess
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

import httpx2
from class_attacks import ATTACKS
from class_load import Served
from class_room import Room, cut_once, hand, message, to_the_end
from malformed_messages import malformed_message
from sqlalchemy import event

from cutenv.browser import HandCut
from cutenv.classroom import ClassStore, class_store, lesson
from cutenv.classroom.class_site import Trials
from cutenv.recording import load_one

TWO_TASKS = """name = "two"
[[task]]
name = "first"
specimen_class = "uniform"
repetitions = 2
[[task]]
name = "second"
specimen_class = "liver"
"""


def sent(client: Any, handed_out: dict[str, Any]) -> Any:
    """Finish a cut that was handed out before, as the page does."""
    made = HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"])
    return client.post(f"/cuts/{handed_out['id']}", **message(made, hand()))


def records(room: Room) -> list[Path]:
    return sorted(room.lesson.folder.rglob("*.csv"))


# The server ends


def test_a_page_that_went_on_while_the_server_was_away_can_still_save_its_cut(room: Room) -> None:
    client = room.person("P07")
    handed_out = client.post("/cuts").json()
    client.post(f"/cuts/{handed_out['id']}/begun")
    assert room.lesson.recover() == 1
    assert [cut.state for cut in room.store.cuts("P07")] == ["unfinished"]
    assert sent(client, handed_out).status_code == 200
    assert [cut.state for cut in room.store.cuts("P07")] == ["saved"]


def test_a_cut_that_was_left_cannot_be_sent_once_another_was_handed_out(room: Room) -> None:
    client = room.person("P07")
    left = client.post("/cuts").json()
    client.post(f"/cuts/{left['id']}/begun")
    client.post("/cuts")
    assert sent(client, left).status_code == 422
    assert records(room) == []


def test_a_record_written_just_before_the_end_is_saved_and_sent_again_it_is_not_kept_twice(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = room.person("P07")
    handed_out = client.post("/cuts").json()
    client.post(f"/cuts/{handed_out['id']}/begun")

    def end(*_: Any, keep: Callable[[], None], **__: Any) -> None:
        keep()
        raise RuntimeError("killed")

    with monkeypatch.context() as patched:
        patched.setattr(ClassStore, "finish", end)
        with pytest.raises(RuntimeError, match="killed"):
            sent(client, handed_out)
    assert len(records(room)) == 1
    assert room.lesson.recover() == 0
    (cut,) = room.store.cuts("P07")
    assert (cut.state, cut.record) == ("saved", records(room)[0].name)
    assert sent(client, handed_out).status_code == 422
    assert len(records(room)) == 1


# A full disk


def test_a_database_that_cannot_be_written_is_told_and_the_cut_can_be_sent_again(room: Room) -> None:
    client = room.person("P07")
    handed_out = client.post("/cuts").json()
    client.post(f"/cuts/{handed_out['id']}/begun")

    def full(connection: Any, *_: Any) -> None:
        connection.execute("PRAGMA query_only = ON")

    event.listen(room.store.engine, "checkout", full)
    answer = sent(client, handed_out)
    assert answer.status_code == 507
    assert "cannot be read or written" in answer.json()["error"]
    assert client.post("/cuts").status_code == 507
    event.remove(room.store.engine, "checkout", full)
    room.store.close()  # its connections
    assert sent(client, handed_out).status_code == 200
    assert len(records(room)) == 1


# The clock is set back


def test_a_clock_that_is_set_back_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "course.toml").write_text(TWO_TASKS)
    room = Room(tmp_path, str(tmp_path / "course.toml"))
    client = room.person("P01")
    for back in (timedelta(0), timedelta(days=1)):

        class Set(datetime):
            @classmethod
            def now(cls, tz: Any = None) -> datetime:
                return datetime.now(tz or UTC) - back  # noqa: B023

        for module in (class_store, lesson):
            monkeypatch.setattr(module, "datetime", Set)
        seed = client.post("/cuts").json()["seed"]
        whole = to_the_end()[: len(HandCut(specimen_class="uniform", seed=seed).follow(to_the_end()))]
        assert cut_once(client, whole)[0].status_code == 200
    monkeypatch.undo()
    assert [cut.state for cut in room.store.cuts("P01")] == ["saved", "saved"]
    assert len(records(room)) == 2
    again = Room(tmp_path, str(tmp_path / "course.toml"))
    for progress in (room.lesson.progress("P01"), again.lesson.progress("P01")):
        assert progress is not None
        assert progress.task is not None
        assert progress.task.name == "second"
    for each in (room, again):
        each.store.close()


# Two servers on one folder


def two_rooms(folder: Path) -> list[Room]:
    """A class on two servers, with a course of two tasks."""
    (folder / "course.toml").write_text(TWO_TASKS.replace("repetitions = 2\n", ""))
    return [Room(folder, str(folder / "course.toml")) for _ in range(2)]


def test_a_record_that_another_server_is_still_writing_is_not_taken_for_one(tmp_path: Path) -> None:
    writer, reader = two_rooms(tmp_path)
    person = writer.person("P01")
    answer, _ = cut_once(person)
    assert answer.status_code == 200
    (record,) = records(writer)
    part = record.with_name(f"{record.stem}.0123abcd.part.csv")
    whole = record.read_bytes()
    record.rename(part)
    part.write_bytes(whole[: len(whole) // 2])
    assert reader.lesson.progress("P01").unread == []
    part.write_bytes(whole)
    part.rename(record)  # as many files as before: the reader must not have counted the half one
    fresh = Room(tmp_path, str(tmp_path / "course.toml")).lesson.progress("P01")
    assert reader.lesson.progress("P01").ahead() == fresh.ahead()
    assert reader.lesson.progress("P01")._counted == fresh._counted


def test_two_servers_on_one_folder_keep_a_cut_once_and_know_each_others(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)
    first = rooms[0].person("P01")
    second = rooms[1].client()
    second.cookies = first.cookies
    handed_out = first.post("/cuts").json()
    assert second.post("/cuts").json()["id"] == handed_out["id"]
    request = message(HandCut(specimen_class="uniform", seed=handed_out["seed"]), to_the_end())
    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(lambda client: client.post(f"/cuts/{handed_out['id']}", **request), (first, second)))
    assert sorted(answer.status_code for answer in answers) == [200, 422]
    (record,) = records(rooms[0])
    assert load_one(record).metadata["task"] == "first"
    for client in (first, second):
        assert "Task 2 of 2" in client.post("/cuts").json()["ahead"]["en"]
    assert rooms[1].lesson.recover() == 0
    for each in rooms:
        each.store.close()


def test_a_server_that_is_too_late_leaves_the_record_of_the_other_one(tmp_path: Path) -> None:
    quick, late = two_rooms(tmp_path)
    person, again = quick.person("P01"), late.client()
    again.cookies = person.cookies
    handed_out = person.post("/cuts").json()
    request = message(HandCut(specimen_class="uniform", seed=handed_out["seed"]), to_the_end())
    assert person.post(f"/cuts/{handed_out['id']}", **request).status_code == 200
    (record,) = records(quick)
    kept = record.read_bytes()
    late.lesson._is_open = lambda _: True  # it looked a moment before the other one was done
    assert again.post(f"/cuts/{handed_out['id']}", **request).status_code == 422
    assert records(late) == [record]
    assert record.read_bytes() == kept
    assert [each.name for each in record.parent.iterdir()] == [record.name]
    for each in (quick, late):
        each.store.close()


# Nonsense


def test_malformed_messages_store_nothing_and_break_nothing(room: Room) -> None:
    person, teacher, nobody = room.person("P07"), room.teacher(), room.client()
    cut_once(person)
    number = person.post("/cuts").json()["id"]
    before = (room.store.codes(), records(room))
    random = np.random.default_rng(7)
    answers = Counter()
    for count in range(300):
        message = malformed_message(random, ("P07", number))
        if message.path == "/leave":
            continue
        client = (person, teacher, nobody)[count % 3]
        request = message._asdict()
        answer = client.request(request.pop("method"), request.pop("path"), **request)
        answers[f"{answer.status_code // 100}xx"] += 1
    assert answers["4xx"] > 150
    assert answers["5xx"] == 0, answers
    assert (room.store.codes(), records(room)) == before
    assert person.get("/cuts").status_code == 200


def test_whoever_fails_from_many_addresses_fills_no_memory() -> None:
    trials = Trials()
    for number in range(20_001):
        trials.failed(str(number))
    assert len(trials._failed) <= 10_000


@pytest.mark.parametrize(
    ("attack", "test"), [(attack, test) for attack, _, test in ATTACKS], ids=lambda part: part[:30]
)
def test_every_attack_of_the_table_has_its_test(attack: str, test: str) -> None:
    name, _, function = test.partition("::")
    assert f"\ndef {function}(" in (Path(__file__).parent / name).read_text(encoding="utf-8"), attack


def test_a_second_server_on_a_folder_says_where_the_first_one_is_and_a_dead_one_claims_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "class"
    with Served(folder) as first:
        assert not any("served already" in note for note in first.notes)
        with Served(folder) as second, Served(tmp_path / "other class") as elsewhere:
            (told,) = [note for note in second.notes if "served already" in note]
            assert f"{folder} is served already, at {first.address}, with another token for the teacher." in told
            assert not any("served already" in note for note in elsewhere.notes)
    with Served(folder) as next_one:  # the first was killed
        assert not any("served already" in note for note in next_one.notes)


# Over TLS, by a real server


def test_a_certificate_encrypts_and_guesses_are_slowed_down_whatever_they_call_themselves(tmp_path: Path) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    curve = "ec_paramgen_curve:prime256v1"
    made = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", curve, "-nodes", "-days", "2"]
    made += ["-subj", "/CN=class", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate]
    subprocess.run(made, check=True, capture_output=True)
    served = Served(tmp_path / "class", "--certificate", str(certificate), "--key", str(key))
    try:
        assert served.address.startswith("https://")
        trusting = ssl.create_default_context(cafile=certificate)
        with httpx2.Client(base_url=served.address, verify=trusting) as teacher:
            cookie = teacher.post("teacher", data={"token": served.token}).headers["set-cookie"].lower()
            assert "secure" in cookie
            assert teacher.get("teacher").status_code == 200
            answers = [
                teacher.post("teacher", data={"token": "guess"}, headers={"X-Forwarded-For": f"10.0.0.{n}"}).status_code
                for n in range(12)
            ]
            assert answers == [403] * 10 + [429] * 2
        with httpx2.Client() as strict, pytest.raises(httpx2.ConnectError, match=r"(?i)certificate"):
            strict.get(served.address)
        with httpx2.Client() as plain, pytest.raises(httpx2.HTTPError):
            plain.get(served.address.replace("https", "http"))
    finally:
        served.end(signal.SIGTERM)
