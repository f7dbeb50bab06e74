"""A class with its server for tests, its clients, and hands that move by a script."""

from __future__ import annotations

import html
import itertools
import re
import zlib
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

from starlette.testclient import TestClient

from cutenv.people.browser import HandCut
from cutenv.people.classroom import ClassStore, Lesson
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.play.course import named_course

TOKEN = "the teacher's secret"


class Clock:
    """Time of all rooms, which a test sets forward by as long as a cut lasts, instead of waiting."""

    ahead = timedelta(0)

    def __call__(self) -> datetime:
        return datetime.now(UTC) + self.ahead


CLOCK = Clock()


class Room:
    """A class with its server, its clients, and hands that move by a script."""

    def __init__(self, folder: Path, course: str | None = None, tissue: Path | None = None) -> None:
        self.store = ClassStore(f"sqlite:///{folder / 'class.db'}", CLOCK)
        if course is not None and "\n" in course:  # the text of one
            (folder / "given.toml").write_text(course, encoding="utf-8")
            course = str(folder / "given.toml")
        led = None if course is None else named_course(course)
        self.lesson = Lesson(self.store, folder / "records", led, tissue=tissue)
        self.app = class_app(ClassSite(lesson=self.lesson, secret=TOKEN))

    def client(self) -> TestClient:
        return TestClient(self.app, base_url="http://class", follow_redirects=False)

    def person(self, code: str) -> TestClient:
        self.store.add_code(code)
        client = self.client()
        assert client.post("/", data={"code": code, "consent": "yes"}).status_code == 303
        return client

    def teacher(self) -> TestClient:
        client = self.client()
        assert client.post("/teacher", data={"token": TOKEN}).status_code == 303
        return client


_hands = itertools.count()


def hand(count: int = 900, speed: float = 2e-5) -> Any:
    """Movements of a hand that goes forward; no two are the same to the last bit, as of people."""
    forward = np.arange(count) * (speed + 1e-15 * next(_hands))
    return np.stack([forward, np.full(count, np.pi / 2)], axis=-1)


def message(made: HandCut, stylus: Any) -> dict[str, Any]:
    """Message by which the page sends the movements that a cut has followed, up to its end."""
    readings = made.follow(stylus)
    content = stylus[: len(readings)].astype("<f8").tobytes()
    return {"content": content, "headers": {"X-Readings": f"{zlib.crc32(readings.tobytes()):08x}"}}


def to_the_end() -> Any:
    """Movements beyond the target, where the hand then rests."""
    return np.concatenate([hand(4000, 3e-5), np.full((26_000, 2), [0.12, np.pi / 2])])


def there_and_back(target: float) -> Any:
    """Movements to a target and back, leaning on the way, by which an even tissue is cut with success."""
    way = hand(round((target + 0.012) / 1e-5), 1e-5)
    way[(way[:, 0] > 0.005) & (way[:, 0] < target - 0.013), 1] = np.pi / 4
    back = np.maximum(way[-1, 0] - 1e-5 * np.arange(1.0, 6000.0), way[-1, 0] - 0.05)
    return np.concatenate([way, np.stack([back, np.full(len(back), np.pi / 2)], axis=-1)])


def words(page: str) -> str:
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL).split())


NOT_SAID = re.compile(r"<(style|script)\b.*?</\1>|<[^>]*>|„[^“]*“|'[^']*'|\([^)]*\)|https?://\S+", re.DOTALL)
ENGLISH = re.compile(
    r"\b(the|of|is|are|with|cuts?|score|no|not|and|too|this|your|its|has|there|again|by|which|liver|tissue|short|target"
    r"|launch|answers|learner|teacher|member)\b"
)


def check_nothing_is_english(*texts: str) -> None:
    """Check that texts and pages have no English but names, values and brackets."""
    for text in texts:
        seen = NOT_SAID.sub(" ", html.unescape(text))
        assert not ENGLISH.search(seen), (ENGLISH.search(seen), seen)


def begun(client: TestClient, lasts: float = 30.0) -> dict[str, Any]:
    """Begin a cut as the page does, and let some seconds pass; what was handed out."""
    handed_out: dict[str, Any] = client.post("/cuts").json()
    assert client.post(f"/cuts/{handed_out['id']}/begun").status_code == 200
    CLOCK.ahead += timedelta(seconds=lasts)
    return handed_out


def sent(
    client: TestClient, handed_out: dict[str, Any], movements: Any = None, tissue: Path | None = None, **changed: Any
) -> Any:
    """Finish a cut that has begun, as the page does; the answer."""
    stylus = hand() if movements is None else movements
    made = HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"], tissue=tissue)
    return client.post(f"/cuts/{handed_out['id']}", **(message(made, stylus) | changed))


def cut_once(client: TestClient, movements: Any = None, **changed: Any) -> tuple[Any, dict[str, Any]]:
    """Begin and finish a cut; the answer, and what was handed out."""
    handed_out = begun(client)
    return sent(client, handed_out, movements, **changed), handed_out
