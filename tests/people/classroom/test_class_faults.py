"""Faults of a class's server: it ends, its disk is full, its clock is set back, it is sent nonsense, is not alone."""

from __future__ import annotations

import os
import signal
import socket
import ssl
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

import httpx2
import uvicorn
from class_room import CLOCK, Room, begun, cut_once, hand, message, sent, there_and_back, to_the_end
from sqlalchemy import event, update

from cutenv.people.browser import HandCut
from cutenv.people.classroom import ClassStore, class_server, class_tables, lesson
from cutenv.people.classroom.class_site import Trials
from cutenv.records import load_one
from scripts.validation.classroom.class_attacks import ATTACKS
from scripts.validation.classroom.class_load import Served
from scripts.validation.classroom.malformed_messages import malformed_message

TWO_TASKS = """name = "two"
[[task]]
name = "first"
specimen_class = "uniform"
seeds = [1, 2]
repetitions = 2
[[task]]
name = "second"
specimen_class = "liver"
seeds = [1]
"""
ONE_TASK = """name = "one"
[[task]]
name = "only"
specimen_class = "uniform"
mark = {{ overall_score = 1 }}
repetitions = {repetitions}
"""


def records(room: Room) -> list[Path]:
    return sorted(room.lesson.folder.rglob("*.csv"))


# The server ends


def test_a_page_that_went_on_while_the_server_was_away_can_still_save_its_cut(room: Room) -> None:
    client = room.person("P07")
    handed_out = begun(client)
    assert room.lesson.recover() == 1
    assert [cut.state for cut in room.store.cuts("P07")] == ["broken off"]
    assert sent(client, handed_out).status_code == 200
    assert [cut.state for cut in room.store.cuts("P07")] == ["saved"]


def test_a_record_written_just_before_the_end_is_saved_and_sent_again_it_is_not_kept_twice(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = room.person("P07")
    handed_out = begun(client)

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


def test_parts_of_records_that_a_killed_server_left_are_deleted(room: Room) -> None:
    place = room.lesson.folder / "P07"
    place.mkdir()
    old, new = place / "a.01234567.part.csv", place / "b.01234567.part.csv"
    for each in (old, new):
        each.write_text("movements")
    os.utime(old, (0.0, 0.0))
    room.lesson.recover()
    assert (old.exists(), new.exists()) == (False, True), "another server may still write one"


# A full disk


def test_a_database_that_cannot_be_written_is_told_and_the_cut_can_be_sent_again(room: Room) -> None:
    client = room.person("P07")
    handed_out = begun(client)

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


def test_a_clock_that_is_set_back_loses_nothing_and_changes_no_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = Room(tmp_path, ONE_TASK.format(repetitions=2))
    client = room.person("P01")
    given_up, whole = cut_once(client)[0], []
    for _ in range(2):
        monkeypatch.setattr(CLOCK, "ahead", CLOCK.ahead - timedelta(days=1))
        whole.append(cut_once(client, whole_cut("uniform", client))[0])
        again = Room(tmp_path, ONE_TASK.format(repetitions=2))
        for progress in (room.lesson.progress("P01"), again.lesson.progress("P01")):
            assert progress is not None
            assert progress._counted == {"only": [False] + [True] * len(whole)}, "missed, and then in a row"
        again.store.close()
    assert [answer.status_code for answer in (given_up, *whole)] == [200] * 3
    assert "is done" in whole[-1].json()["ahead"]["en"] or whole[-1].json()["done"]
    assert len(records(room)) == 3
    room.store.close()


# A cut belongs to the task that it was handed out for


def whole_cut(specimen_class: str, client: Any) -> Any:
    """Movements of the person's next cut up to its end."""
    seed = client.post("/cuts").json()["seed"]
    cut = HandCut(specimen_class=specimen_class, seed=seed)
    stylus = there_and_back(cut.target_length)
    return stylus[: len(cut.follow(stylus))]


def test_a_cut_that_is_left_counts_as_given_up_and_the_next_specimen_is_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cutenv.people.classroom.analysis._PROGRAM", "")  # no study is worked out
    room = Room(tmp_path, ONE_TASK.format(repetitions=2) + "seeds = [11, 12, 13, 14]\n")
    client = room.person("P01")
    room.store.set_pass_mark("one", 1.0)
    assert cut_once(client, whole_cut("uniform", client))[0].json()["passed"]
    left = begun(client)
    next_one = client.post("/cuts").json()
    assert (left["seed"], next_one["seed"]) == (12, 13)
    assert "0 of 2 so far" in next_one["ahead"]["en"], "one good, one left: none in a row"
    assert "and so given up" in sent(client, left).json()["error"]
    assert client.post(f"/cuts/{left['id']}/begun").status_code == 409
    assert "1 of 2 so far" in cut_once(client, whole_cut("uniform", client))[0].json()["ahead"]["en"]
    assert len(records(room)) == 2
    # It stands where the teacher looks: list, person, table, share that passes; and where the person does
    teacher = room.teacher()
    study = teacher.post("/teacher/studies", data={"kind": "study", "code": "P01"}).headers["location"]
    words = "begun and left: given up"
    assert f"1 {words}" in teacher.get("/teacher").text
    assert "2 of 3 pass" in teacher.get("/teacher").text
    assert words in teacher.get("/teacher/people/P01").text
    assert ",left,no," in teacher.get("/teacher/cuts.csv").text
    assert [cut["state"] for cut in client.get("/cuts").json()] == ["saved", "left", "saved"]
    until = time.monotonic() + 60.0
    while "refresh" in teacher.get(f"/teacher/{study}").headers:
        assert time.monotonic() < until
        time.sleep(0.1)
    people = teacher.get(f"/teacher/{study}/people.csv").text.splitlines()
    assert [row.partition(",")[0] == "" for row in people[1:]] == [False, True, False]
    # The end of a server is nobody's fault: it counts for nothing, and yet its specimen does not come again
    assert begun(client)["seed"] == 14
    room.lesson.recover()
    after = client.post("/cuts").json()
    assert after["seed"] == 11
    assert "1 of 2 so far" in after["ahead"]["en"]
    assert [cut.state for cut in room.store.cuts("P01")][-2:] == ["unfinished", "prepared"]
    room.store.close()


def test_a_cut_of_another_course_is_neither_handed_out_again_nor_finished(tmp_path: Path) -> None:
    courses = {"easy": "uniform", "hard": "vascular"}
    for name, kind in courses.items():
        task = f'name = "{name}"\n[[task]]\nname = "only"\nspecimen_class = "{kind}"\n'
        (tmp_path / f"{name}.toml").write_text(task)
    easy, hard = (Room(tmp_path, str(tmp_path / f"{name}.toml")) for name in courses)
    for begin in (lambda client: client.post("/cuts").json(), begun):
        first = easy.person(code := f"P0{len(easy.store.codes()) + 1}")
        then = hard.client()
        then.cookies = first.cookies
        given = begin(first)
        answer = sent(then, given)
        assert answer.status_code == 422
        assert "served no more" in answer.json()["error"]
        again = then.post("/cuts").json()
        assert (again["id"] == given["id"], again["specimen_class"]) == (False, "vascular")
        assert [(cut.course, cut.state) for cut in easy.store.cuts(code)] == [
            ("easy", "taken back"),
            ("hard", "prepared"),
        ]
    assert records(easy) == []
    for each in (easy, hard):
        each.store.close()


def test_a_record_that_cannot_be_read_now_is_neither_progress_nor_forgotten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = Room(tmp_path, TWO_TASKS.replace("repetitions = 2\n", ""))
    client = room.person("P01")
    assert cut_once(client, whole_cut("uniform", client))[0].status_code == 200
    with room.store.engine.begin() as connection:  # as an earlier version saved it
        connection.execute(update(class_tables.CUTS).values(numbers=None, course=None))

    def busy(_: Path) -> None:
        raise OSError(24, "Too many open files")

    teacher = room.teacher()
    with monkeypatch.context() as patched:
        patched.setattr(lesson, "load_one", busy)
        answer = client.post("/cuts")
        assert answer.status_code == 507
        assert "Too many open files" in answer.json()["error"]
        for page in ("/teacher", "/teacher/people/P01"):
            assert "A record could not be read and is not counted" in teacher.get(page).text
    assert "Task 2 of 2" in client.post("/cuts").json()["ahead"]["en"]
    monkeypatch.setattr(lesson, "load_one", busy)  # from now on nothing is read again
    assert "could not be read" not in teacher.get("/teacher").text
    room.store.close()


# A hand takes its time, and repeats no movement


def test_a_cut_that_was_not_begun_or_took_no_time_is_refused(room: Room) -> None:
    client = room.person("P07")
    for lasts, reason in ((None, "never begun"), (0.2, "was sent 0.")):
        handed_out = client.post("/cuts").json() if lasts is None else begun(client, lasts)
        answer = sent(client, handed_out)
        assert answer.status_code == 422
        assert reason in answer.json()["error"]
    assert [cut.state for cut in room.store.cuts("P07")] == ["refused", "refused"]
    assert sent(client, begun(client, 1.0)).status_code == 200
    teacher = room.teacher().get("/teacher/people/P07").text
    assert "it was never begun" in teacher
    assert "was sent 0.2 s after" in teacher


def test_movements_that_were_seen_before_in_the_class_are_refused(room: Room) -> None:
    stylus = hand()
    first, other = room.person("P01"), room.person("P02")
    assert cut_once(first, stylus)[0].status_code == 200
    for client in (first, other):
        answer = cut_once(client, stylus)[0]
        assert answer.status_code == 422
        assert "bit for bit" in answer.json()["error"]
    assert [cut.state for cut in room.store.cuts()] == ["saved", "refused", "refused"]
    assert len(records(room)) == 1
    still = np.tile([0.0, np.pi / 2], (200, 1))  # two people who give up at once have moved nothing
    assert [cut_once(client, still)[0].status_code for client in (first, other)] == [200, 200]


def test_what_a_page_lost_is_shown(room: Room) -> None:
    client = room.person("P07")
    handed_out = begun(client)
    request = message(HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"]), hand())
    request["headers"]["X-Stalled"] = "4.75"
    assert client.post(f"/cuts/{handed_out['id']}", **request).status_code == 200
    assert client.get("/cuts").json()[0]["stalled"] == 4.75
    assert "the page stood still for 4.8 s" in room.teacher().get("/teacher/people/P07").text


# Two servers on one folder


def two_rooms(folder: Path) -> list[Room]:
    """A class on two servers, with a course of two tasks."""
    return [Room(folder, TWO_TASKS.replace("repetitions = 2\n", "")) for _ in range(2)]


def test_two_servers_on_one_folder_hand_out_and_keep_a_cut_once_up_to_the_last_task(tmp_path: Path) -> None:
    rooms = two_rooms(tmp_path)
    first = rooms[0].person("P01")
    second = rooms[1].client()
    second.cookies = first.cookies
    with ThreadPoolExecutor(2) as pool:
        for task, kind in (("first", "uniform"), ("second", "liver")):
            handed_out = [each.json() for each in pool.map(lambda client: client.post("/cuts"), (first, second))]
            assert len({each["id"] for each in handed_out}) == 1
            stylus = whole_cut(kind, first)
            begun(first)
            request = message(HandCut(specimen_class=kind, seed=handed_out[0]["seed"]), stylus)
            path = f"/cuts/{handed_out[0]['id']}"
            answers = list(pool.map(lambda client: client.post(path, **request), (first, second)))  # noqa: B023
            assert sorted(answer.status_code for answer in answers) == [200, 422]
            newest = max(records(rooms[0]), key=lambda path: path.stat().st_mtime_ns)
            assert load_one(newest).metadata["task"] == task
    assert len(records(rooms[0])) == 2
    assert [client.post("/cuts").json()["done"] for client in (first, second)] == [True, True]
    assert rooms[1].lesson.recover() == 0
    for each in rooms:
        each.store.close()


def test_a_server_that_is_too_late_leaves_the_record_of_the_other_one(tmp_path: Path) -> None:
    quick, late = two_rooms(tmp_path)
    person, again = quick.person("P01"), late.client()
    again.cookies = person.cookies
    handed_out = begun(person)
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
            with first.client() as client:
                assert client.get("", headers={"Host": "evil.example"}).status_code == 421
                assert client.get("").status_code == 200
    if os.name == "posix":
        made = [each for each in folder.rglob("*") if each.stat().st_mode & 0o077]
        assert (made, folder.stat().st_mode & 0o077) == ([], 0), "others on the machine read them"
    with Served(folder) as next_one:  # the first was killed
        assert not any("served already" in note for note in next_one.notes)


# Connections that say nothing


@pytest.fixture
def listening(room: Room, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, int]]:
    """Address of a server of few connections that waits half a second for a header."""
    monkeypatch.setattr(class_server, "HEADER_WITHIN", 0.5)
    monkeypatch.setattr(class_server, "MOST_SILENT", 32)
    settings = uvicorn.Config(
        room.app, http=class_server.PatientProtocol, limit_concurrency=50, log_config=None, port=0
    )
    server = uvicorn.Server(settings)
    place = socket.create_server(("127.0.0.1", 0))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [place]})
    thread.start()
    yield place.getsockname()
    server.should_exit = True
    thread.join()
    place.close()


def test_connections_that_say_nothing_shut_nobody_out(listening: tuple[str, int]) -> None:
    lines = [socket.create_connection(listening, 10.0) for _ in range(60)]
    for line in lines[::2]:
        line.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")
    with httpx2.Client(base_url="http://{}:{}".format(*listening)) as client:
        assert client.get("/").status_code == 200
        began = time.monotonic()
        ends = []
        for line in lines:  # half a header later, too
            with suppress(ConnectionError):
                assert line.recv(100) == b""
            ends.append(time.monotonic() - began)
            line.close()
        assert ends[-1] < 5.0
        assert client.get("/").status_code == 200, "who has asked before is not silent"


def test_a_connection_that_breaks_amid_a_body_is_no_fault_of_the_server(
    room: Room, listening: tuple[str, int], caplog: pytest.LogCaptureFixture
) -> None:
    cookie = "; ".join(f"{name}={value}" for name, value in room.person("P07").cookies.items())
    with caplog.at_level("INFO"), httpx2.Client(base_url="http://{}:{}".format(*listening)) as client:
        for path in ("/", "/cuts/1"):
            with socket.create_connection(listening, 10.0) as line:
                head = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: {cookie}\r\nContent-Length: 1600\r\n\r\n"
                line.sendall(head.encode() + b"\0" * 16)
            assert client.get("/").status_code == 200
    assert [record.getMessage() for record in caplog.records if record.levelname not in ("INFO", "DEBUG")] == []


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
