"""xAPI statements: each keeps the published rules, reaches the store once whatever fails, and delays no cut."""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip(
    "ralph.models.xapi.base.statements", reason="xAPI's rules by others, of the tests: pip install 'cutenv[dev]'"
)

import numpy as np
from class_room import TOKEN, Room, cut_once, hand
from ralph.models.xapi.base import statements as rules
from starlette.testclient import TestClient

from cutenv.commands.serve import main
from cutenv.people.browser import HandCut
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.classroom.xapi_statements import Courier, StatementQueue

HOME = "https://class.example/"
COURSE = """name = "first / cuts"
[[task]]
name = "even tissue, \N{GREEK SMALL LETTER ALPHA}"
specimen_class = "uniform"
seeds = [5]
mark = { overall_score = 1 }
"""


class Store(ThreadingHTTPServer):
    """A learning record store that takes a statement only if it keeps the rules; its first answers may be others."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.kept: dict[str, Any] = {}
        self.answers: list[Any] = []
        self.asked = 0
        self.url = f"http://127.0.0.1:{self.server_address[1]}/xapi"


class Answer(BaseHTTPRequestHandler):
    server: Store

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.asked += 1
        planned = self.server.answers.pop(0) if self.server.answers else None
        if isinstance(planned, threading.Event):
            planned.wait(60.0)
        if isinstance(planned, int):
            return self._say(planned)
        known = self.headers["Authorization"] == "Basic " + base64.b64encode(b"key:secret").decode()
        if not known:
            return self._say(401)
        if self.path != "/xapi/statements" or not self.headers["X-Experience-API-Version"].startswith("1.0."):
            return self._say(404)
        made = json.loads(content)
        rules.BaseXapiStatement.model_validate(made)
        if made["id"] in self.server.kept:
            return self._say(409)
        self.server.kept[made["id"]] = made
        if planned == "lost":
            return self.connection.close()
        self._say(200)

    def _say(self, status: int) -> None:
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.send_header("Location", "http://127.0.0.1:1/elsewhere")
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def store() -> Iterator[Store]:
    opened = Store()
    thread = threading.Thread(target=opened.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    yield opened
    opened.shutdown()
    thread.join()
    opened.server_close()


class SendingRoom(Room):
    """A class whose cuts are told to a store."""

    def __init__(self, folder: Path, store: Store, course: str | None = None, login: str = "key:secret") -> None:
        super().__init__(folder, course)
        self.courier = Courier(self.lesson, StatementQueue(self.store), store.url, login, HOME)
        self.app = class_app(ClassSite(lesson=self.lesson, secret=TOKEN, courier=self.courier))


@pytest.fixture
def room(tmp_path: Path, store: Store) -> Iterator[SendingRoom]:
    made = SendingRoom(tmp_path, store)
    yield made
    made.store.close()


def test_each_cut_is_a_statement_that_keeps_the_rules(tmp_path: Path, store: Store) -> None:
    room = SendingRoom(tmp_path, store, COURSE)
    client = room.person("P07")
    assert cut_once(client)[0].status_code == 200  # given up
    stylus = np.concatenate([hand(4000, 3e-5), np.full((26_000, 2), [0.12, np.pi / 2])])
    seed = client.post("/cuts").json()["seed"]
    whole = stylus[: len(HandCut(specimen_class="uniform", seed=seed).follow(stylus))]
    assert cut_once(client, whole)[0].status_code == 200
    assert room.courier.deliver() == ""
    left, finished = store.kept.values()
    assert left["actor"] == {"objectType": "Agent", "account": {"homePage": HOME, "name": "P07"}}
    assert (left["verb"]["id"], left["result"]["completion"]) == ("http://adlnet.gov/expapi/verbs/attempted", False)
    assert left["result"]["success"] is False
    assert (finished["verb"]["id"], finished["result"]["completion"]) == (
        "http://adlnet.gov/expapi/verbs/completed",
        True,
    )
    assert finished["object"]["id"] == HOME + "activities/first%20%2F%20cuts/even%20tissue%2C%20%CE%B1"
    saved = room.store.cuts("P07")[-1]
    points = finished["result"]["score"]
    assert round(points["raw"]) == pytest.approx(saved.score, abs=1)
    assert points["scaled"] == pytest.approx(points["raw"] / 100.0)
    assert (points["min"], points["max"]) == (0, 100)
    assert finished["result"]["success"] is (points["raw"] >= 1.0), "the mark of the task decides"
    duration = finished["result"]["duration"]
    assert duration.startswith("PT")
    assert float(duration[2:-1]) == pytest.approx(len(whole) / 1000, abs=0.011)
    room.store.close()


def test_a_store_that_fails_is_asked_again_and_gets_every_statement_once(room: SendingRoom, store: Store) -> None:
    client = room.person("P07")
    for _ in range(2):
        cut_once(client)
    for planned, trouble in ((503, "503"), (401, "401"), (302, "302"), ("lost", "cannot be reached")):
        store.answers = [planned]
        assert trouble in room.courier.deliver()
        assert room.courier.queue.waiting() == 2
    again = Courier(room.lesson, StatementQueue(room.store), store.url, "key:secret", HOME)  # after a restart
    assert again.deliver() == ""
    assert (len(store.kept), again.queue.waiting()) == (2, 0)
    before = store.asked
    assert again.deliver() == ""
    assert store.asked == before


def test_a_statement_that_is_refused_holds_up_no_other_and_the_teacher_sees_it(room: SendingRoom, store: Store) -> None:
    client = room.person("P07")
    for _ in range(2):
        cut_once(client)
    store.answers = [400]
    assert room.courier.deliver() == ""
    assert (len(store.kept), room.courier.queue.waiting()) == (1, 0)
    assert "refused: 400" in room.teacher().get("/teacher").text


def test_a_wrong_login_and_a_store_that_is_gone_lose_nothing(room: SendingRoom, store: Store) -> None:
    cut_once(room.person("P07"))
    wrong = Courier(room.lesson, room.courier.queue, store.url, "key:wrong", HOME)
    assert "401" in wrong.deliver()
    gone = Courier(room.lesson, room.courier.queue, "http://127.0.0.1:1/xapi", "key:secret", HOME)
    assert "cannot be reached" in gone.deliver()
    assert room.courier.queue.waiting() == 1


def test_a_running_courier_says_once_what_is_wrong_and_delivers_by_itself(
    room: SendingRoom, store: Store, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cutenv.people.classroom.xapi_statements._EVERY", 0.05)
    store.answers = [503, 503]
    cut_once(room.person("P07"))
    room.courier.start()
    until = time.monotonic() + 30.0
    while room.courier.queue.waiting() and time.monotonic() < until:
        time.sleep(0.02)
    room.courier.close()
    assert len(store.kept) == 1
    assert capsys.readouterr().err.count("answers 503") == 1


def test_no_save_waits_for_a_store_that_never_answers(room: SendingRoom, store: Store) -> None:
    client, hangs = room.person("P07"), threading.Event()
    cut_once(client)
    store.answers = [hangs]
    delivering = threading.Thread(target=room.courier.deliver)
    delivering.start()
    answer, _ = cut_once(client)
    assert answer.status_code == 200
    assert delivering.is_alive(), "it was saved while the store was awaited"
    hangs.set()
    delivering.join(60.0)
    assert room.courier.deliver() == ""
    assert len(store.kept) == 2


def test_nothing_is_sent_of_whoever_has_not_agreed_to_that_or_was_deleted(tmp_path: Path, store: Store) -> None:
    before = Room(tmp_path)
    early = before.person("P01")
    assert store.url not in before.client().get("/").text
    cut_once(early)
    room = SendingRoom(tmp_path, store)
    assert store.url in room.client().get("/").text
    cut_once(TestClient(room.app, base_url="http://class", cookies=early.cookies))  # signed in since before
    assert room.courier.queue.waiting() == 0
    cut_once(room.person("P01"))
    assert room.courier.queue.waiting() == 1, "of the cuts since then alone"
    room.lesson.delete("P01")
    assert room.courier.deliver() == ""
    assert not store.kept
    room.store.close()
    before.store.close()


@pytest.mark.parametrize(
    ("url", "login", "named"),
    [
        ("ftp://store", "key:secret", "--lrs ftp://store is no address"),
        ("https://store", "key", "key:secret"),
        ("https://store", "key:sec\nret", "key:secret"),
        ("https://store", None, "belong together"),
    ],
)
def test_a_bad_store_is_named_before_anything_is_served(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], url: str, login: str | None, named: str
) -> None:
    (tmp_path / "login").write_text(login or "")
    options = [] if login is None else ["--lrs-login", str(tmp_path / "login")]
    assert main([str(tmp_path / "class"), "--port", "0", "--lrs", url, *options]) == 2
    assert named in capsys.readouterr().err
