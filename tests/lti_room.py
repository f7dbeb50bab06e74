"""A class that is registered with a learning platform, and people who come from there, for tests."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from class_room import CLOCK, TOKEN, Room
from lti_platform import LearningPlatform
from starlette.testclient import TestClient

from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.classroom.class_store import CutEnd, NewCut
from cutenv.people.classroom.lesson import name_of
from cutenv.people.classroom.lti_platforms import platform_of
from cutenv.people.classroom.lti_tool import LtiTool

AT = "http://127.0.0.1"


class LtiRoom(Room):
    """A class that is registered with a platform."""

    def __init__(
        self, folder: Path, course: str | None = None, language: str = "en", known: LearningPlatform | None = None
    ) -> None:
        super().__init__(folder, course)
        self.tool = LtiTool(self.lesson, language)
        self.app = class_app(ClassSite(lesson=self.lesson, secret=TOKEN, language=language, lti=self.tool))
        self.platform = known or LearningPlatform(CLOCK, lambda: self.client().get("/lti/jwks").json())
        if known is None:
            self.register()

    def register(self, **changed: Any) -> None:
        self.tool.file.add(platform_of(self.platform.registration | changed))

    def client(self) -> TestClient:
        return TestClient(self.app, base_url=AT, follow_redirects=False)

    def __enter__(self) -> LtiRoom:
        return self

    def __exit__(self, *_: object) -> None:
        assert not self.platform.troubles
        self.close()

    def close(self) -> None:
        self.platform.close()
        self.lesson.close()


def sent_there(room: LtiRoom, client: TestClient, subject: str = "u1", path: str = "/lti/launch") -> dict[str, str]:
    """Begin in the platform, up to its page that sends the launch: state and nonce."""
    answer = client.get("/lti/login", params=room.platform.initiation(subject, AT + path))
    assert answer.status_code == 303, answer.text
    return room.platform.authorized(answer.headers["Location"], subject, f"{AT}/lti/launch")


def hidden(text: str) -> dict[str, str]:
    found = re.findall(r'<input type="hidden" name="(\w+)" value="([^"]*)">', text)
    return {name: html.unescape(value) for name, value in found}


def enter(client: TestClient, token: str, state: str) -> Any:
    """Send a launch as the platform's page does, and once more as the class's page then does."""
    by_platform = {"Origin": "https://moodle.school.example"}
    page = client.post("/lti/launch", data={"id_token": token, "state": state}, headers=by_platform)
    assert page.status_code == 200
    assert hidden(page.text) == {"id_token": token, "state": state}
    return client.post("/lti/enter", data=hidden(page.text), headers={"Origin": AT})


def launched(room: LtiRoom, client: TestClient, subject: str = "u1", **changed: Any) -> Any:
    asked = sent_there(room, client, subject)
    claims = room.platform.claims(asked["nonce"], subject, **changed)
    return enter(client, room.platform.signers[-1].token(claims), asked["state"])


def learner(room: LtiRoom, subject: str = "u1", **changed: Any) -> tuple[TestClient, str]:
    """Somebody who came from the platform and agreed, and the code."""
    client = room.client()
    answer = launched(room, client, subject, **changed)
    if answer.status_code == 200:
        answer = client.post("/lti/agree", data=hidden(answer.text) | {"consent": "yes"})
    assert (answer.status_code, answer.headers["Location"]) == (303, "../cut")
    return client, re.findall(r'"whose">([A-Z0-9]+)|>([A-Z]{3}\d{6})<', client.get("/cut").text)[0][1]


def saved(room: LtiRoom, code: str, score: float | None, task: str = "", **end: Any) -> None:
    """Note a cut as saved, as the server does after it has confirmed it."""
    course = name_of(room.lesson.course)
    cut = room.store.hand_out(code, lambda _: NewCut("uniform", 5, course=course, task=task))
    assert cut is not None
    ended = {"ended": "finished", "numbers": {"overall_score": score or 0.0}} | end
    assert room.store.finish(cut.id, CutEnd(**{"state": "saved", "record": "x.csv", "score": score} | ended))


def said(answer: Any) -> str:
    (found,) = re.findall(r'<p class="trouble" role="alert">(.*?)</p>', answer.text)
    return html.unescape(found)
