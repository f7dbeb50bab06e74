"""A class with its server for tests, its clients, and hands that move by a script."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np
from starlette.testclient import TestClient

from cutenv.browser import HandCut
from cutenv.classroom import ClassStore, Lesson
from cutenv.classroom.class_server import class_app
from cutenv.classroom.class_site import ClassSite
from cutenv.play.course import named_course

TOKEN = "the teacher's secret"


class Room:
    """A class with its server, its clients, and hands that move by a script."""

    def __init__(self, folder: Path, course: str | None = None) -> None:
        self.store = ClassStore(f"sqlite:///{folder / 'class.db'}")
        self.lesson = Lesson(self.store, folder / "records", None if course is None else named_course(course))
        self.app = class_app(ClassSite(lesson=self.lesson), TOKEN)

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


def hand(count: int = 900, speed: float = 2e-5) -> Any:
    return np.stack([np.arange(count) * speed, np.full(count, np.pi / 2)], axis=-1)


def message(made: HandCut, stylus: Any) -> dict[str, Any]:
    """Message by which the page sends the movements that a cut has followed, up to its end."""
    readings = made.follow(stylus)
    content = stylus[: len(readings)].astype("<f8").tobytes()
    return {"content": content, "headers": {"X-Readings": f"{zlib.crc32(readings.tobytes()):08x}"}}


def to_the_end() -> Any:
    """Movements beyond the target, where the hand then rests."""
    return np.concatenate([hand(4000, 3e-5), np.full((26_000, 2), [0.12, np.pi / 2])])


def cut_once(client: TestClient, movements: Any = None, **changed: Any) -> tuple[Any, dict[str, Any]]:
    """Begin and finish a cut as the page does; the answer, and what was handed out."""
    handed_out = client.post("/cuts").json()
    stylus = hand() if movements is None else movements
    made = HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"])
    return client.post(f"/cuts/{handed_out['id']}", **(message(made, stylus) | changed)), handed_out
