"""A launch from a learning platform in a real browser: from another site, in a window and in a frame."""

from __future__ import annotations

import html
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qsl, urlencode, urlsplit

import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")
pytest.importorskip("joserfc", reason="learning platforms are an extra: pip install 'cutenv[lti]'")

import uvicorn
from class_room import CLOCK, TOKEN, Room
from lti_platform import CLIENT, LearningPlatform, PlatformAnswer

from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.classroom.lti_platforms import platform_of
from cutenv.people.classroom.lti_registration import RegistrationDesk
from cutenv.people.classroom.lti_tool import LtiTool
from scripts.browsers import chromium

pytestmark = pytest.mark.needs("chromium")


class Pages(PlatformAnswer):
    """The platform's pages for its people: a course with the class, and the sign-in that sends a launch."""

    def do_GET(self) -> None:
        place = urlsplit(self.path)
        if place.path == "/course":
            sent = self.server.initiation("u1", f"{self.server.tool}/lti/launch")
            form = f'<form method="post" action="{self.server.tool}/lti/login" target="{place.query}">{_fields(sent)}'
            self._page(f'{form}</form><iframe name="inside"></iframe><script>document.forms[0].submit()</script>')
        elif place.path == "/administration":
            told = "addEventListener('message', (event) => { document.title = JSON.stringify(event.data); });"
            sent = {"openid_configuration": f"{self.server.issuer}/.well-known/openid-configuration"}
            sent["registration_token"] = self.server.registration_token
            address = html.escape(f"{self.server.tool}/lti/register/{place.query}?{urlencode(sent)}")
            self._page(f'<script>{told}</script><iframe src="{address}"></iframe>')
        elif place.path == "/auth":
            asked = dict(parse_qsl(place.query))
            token = self.server.signers[0].token(self.server.claims(asked["nonce"], "u1"))
            sent = {"id_token": token, "state": asked["state"]}
            form = f'<form method="post" action="{asked["redirect_uri"]}">{_fields(sent)}</form>'
            self._page(f"{form}<script>document.forms[0].submit()</script>")
        else:
            super().do_GET()

    def _page(self, body: str) -> None:
        content = f"<!DOCTYPE html><title>platform</title>{body}".encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


def _fields(values: dict[str, str]) -> str:
    return "".join(f'<input type="hidden" name="{name}" value="{html.escape(v)}">' for name, v in values.items())


@pytest.fixture
def room(tmp_path: Path) -> Room:
    return Room(tmp_path)


@pytest.fixture
def tool(room: Room) -> LtiTool:
    return LtiTool(room.lesson)


@pytest.fixture
def platform(room: Room, tool: LtiTool) -> Iterator[LearningPlatform]:
    """A platform on one site of this machine, with which a class on another one is registered."""
    made = LearningPlatform(CLOCK, lambda: tool.key.public, host="localhost", answer=Pages)
    tool.file.add(platform_of(made.registration))
    app = class_app(ClassSite(lesson=room.lesson, secret=TOKEN, lti=tool))
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    until = time.monotonic() + chromium.PATIENCE_S
    while not server.started:
        assert time.monotonic() < until
        time.sleep(0.02)
    made.tool = "http://127.0.0.1:{1}".format(*server.servers[0].sockets[0].getsockname())
    yield made
    server.should_exit = True
    thread.join()
    made.close()
    room.lesson.close()


def test_a_learner_comes_from_another_site_to_the_page_that_cuts(
    browser: chromium.Browser, platform: LearningPlatform
) -> None:
    start = f"{platform.issuer}/course?_self"
    browser.open(start, 900)
    browser.wait("document.querySelector('[name=consent]')")
    browser.value("document.querySelector('[name=consent]').click(), document.querySelector('button').click()")
    browser.wait(f"location.href === {json.dumps(platform.tool + '/cut')}")
    browser.open(start, 900)
    browser.wait(f"location.href === {json.dumps(platform.tool + '/cut')}")


def test_in_a_frame_of_the_platform_stands_the_way_to_a_window(
    browser: chromium.Browser, platform: LearningPlatform
) -> None:
    start = f"{platform.issuer}/course?inside"
    browser.open(start, 900)
    until = time.monotonic() + chromium.PATIENCE_S
    found: list[str] = []
    while not found:
        assert time.monotonic() < until
        targets = browser.tell("Target.getTargets")["targetInfos"]  # a frame of another site is one
        found = [each["url"] for each in targets if each["url"].startswith(platform.tool)]
        time.sleep(0.05)
    assert found == [f"{platform.tool}/lti/login"], "and it goes no farther"


def test_in_a_frame_of_the_platform_a_registration_asks_it_to_close_the_window(
    browser: chromium.Browser, platform: LearningPlatform, tool: LtiTool
) -> None:
    platform.registered = {"client_id": "second"}
    invitation = RegistrationDesk(tool, CLOCK, "class", {}).invite(platform.tool)
    start = f"{platform.issuer}/administration?{invitation}"
    browser.open(start, 900)
    browser.wait("document.title !== 'platform'")
    assert json.loads(browser.value("document.title")) == {"subject": "org.imsglobal.lti.close"}
    assert [each.client_id for each in tool.file.platforms] == [CLIENT, "second"]
    assert not platform.troubles
