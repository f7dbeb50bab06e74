"""Live view of a rig: published readings, and routes that show them."""

from __future__ import annotations

import asyncio
import json
import math
import socket
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from cutenv.people.classroom.class_site import ClassSite
from cutenv.rig.operation.recorder import LIVE_SCHEMA

_NUMBERS = (
    "time_s", "force_N", "position_mm", "speed_mm_s", "angle_deg", "force_limit_N", "low_mm", "high_mm",
)  # fmt: skip
_TEXTS = ("rig", "phase", "stop")
_MAX_DATAGRAM, _MAX_TEXT = 2048, 400  # bytes of a datagram, characters of a text in it
_KEPT = 500  # messages: 20 s
_LOOK_EVERY = 0.05  # [s]
_CONNECTED = 30.0  # [s] after which a browser has to ask again, and show again who it is
_MOST_VIEWERS = 20
_SCRIPT = Path(__file__).parent / "pages" / "rig.js"


class LiveRig:
    """Receiver of what ``cutenv rig run --watch`` publishes on this machine.

    It has no way to the rig: its socket only receives, and the rig never waits for it. The port is on 127.0.0.1; 0
    takes a free one. ``ended`` returns True once the server ends, so that its streams do too. Raises ValueError if the
    port is taken.
    """

    def __init__(self, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", port))
        except OSError as error:
            self._socket.close()
            raise ValueError(f"--watch {port}: {error.strerror}. Give another port.") from None
        self.port: int = self._socket.getsockname()[1]
        self.ended: Callable[[], bool] = lambda: False
        self._kept: deque[tuple[int, dict[str, Any]]] = deque(maxlen=_KEPT)
        self._closed = False
        threading.Thread(target=self._receive, name="live rig", daemon=True).start()

    def close(self) -> None:
        """Stop receiving."""
        self._closed = True
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waking:
            waking.sendto(b"", ("127.0.0.1", self.port))  # a closed socket alone would not wake its reader

    def _receive(self) -> None:
        number = 0
        while not self._closed:
            message = checked_message(self._socket.recv(_MAX_DATAGRAM + 1))
            if message is not None:
                number += 1
                self._kept.append((number, message))
        self._socket.close()

    def since(self, number: int) -> list[tuple[int, dict[str, Any]]]:
        """Return numbered messages after ``number``, or all after a restart."""
        kept = list(self._kept)
        return kept if kept and number > kept[-1][0] else [each for each in kept if each[0] > number]


def checked_message(datagram: bytes) -> dict[str, Any] | None:
    """Return a rig's message, known fields only, or None if invalid.

    Any program of this machine can send to the port.
    """
    try:
        content = json.loads(datagram) if len(datagram) <= _MAX_DATAGRAM else None
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or content.get("schema") != LIVE_SCHEMA:
        return None
    numbers, texts = {name: content.get(name) for name in _NUMBERS}, {name: content.get(name) for name in _TEXTS}
    if not all(value is None or _is_number(value) for value in numbers.values()):
        return None
    if not all(value is None or (isinstance(value, str) and len(value) <= _MAX_TEXT) for value in texts.values()):
        return None
    return numbers | texts


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12 and math.isfinite(value)


def live_routes(live: LiveRig | None, site: ClassSite) -> list[Route]:
    """Return routes of the teacher's live page; none without a rig.

    Readings go to the browser as server-sent events: by their protocol nothing can be sent back.
    """
    if live is None:
        return []
    viewers = 0

    def rig_page(_: Request, __: FormData) -> Response:
        answer = site.page("rig.html", code=_SCRIPT.read_text(encoding="utf-8"))
        answer.headers["Content-Security-Policy"] = "frame-ancestors 'none'"  # the rest stands in the page
        return answer

    async def readings(request: Request) -> Response:
        await site.teacher(request)
        if viewers >= _MOST_VIEWERS:
            raise HTTPException(503, "Too many watch this rig.")
        last = request.headers.get("last-event-id", "0")
        number = int(last) if last.isdecimal() and len(last) < 16 else 0
        return StreamingResponse(events(number), media_type="text/event-stream")

    async def events(number: int) -> AsyncIterator[str]:
        nonlocal viewers
        viewers += 1
        until = time.monotonic() + _CONNECTED
        try:
            yield "retry: 200\n\n"
            while time.monotonic() < until and not live.ended():
                for each, message in live.since(number):
                    yield f"id: {each}\ndata: {json.dumps(message)}\n\n"
                    number = each
                await asyncio.sleep(_LOOK_EVERY)
        finally:
            viewers -= 1

    return [site.teachers_route("GET", "/rig", rig_page), Route("/rig/readings", readings, methods=["GET"])]
