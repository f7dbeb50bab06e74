"""Guard of a class's server: trials counted by address, limits of size, headers that forbid what no page needs."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cutenv.classroom.foreign_upload import LARGEST_UPLOAD
from cutenv.classroom.lesson import LONGEST_CUT

LARGEST_BODY = 24 * LONGEST_CUT + 4096
"""Largest body of a request that is read [bytes]: the movements of the longest cut."""
UPLOAD_PATH = "/teacher/upload"
"""Path to which files are sent."""
_TRIALS, _MINUTE = 10, 60.0  # wrong codes and tokens that one address may try in a minute
_MOST_ADDRESSES = 10_000  # whose failures are remembered
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; form-action 'self'; frame-ancestors 'none'"
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Trials:
    """Counter of failed trials by address: whoever guesses too often has to wait."""

    def __init__(
        self, most: int = _TRIALS, period: float = _MINUTE, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._most, self._period, self._clock = most, period, clock
        self._failed: dict[str, deque[float]] = {}
        self._lock = threading.Lock()

    def check(self, address: str) -> None:
        """Raise HTTPException 429 if the address has failed too often."""
        with self._lock:
            failed = self._failed.get(address, deque())
            while failed and failed[0] < self._clock() - self._period:
                failed.popleft()
            if len(failed) >= self._most:
                raise HTTPException(429, "Too many wrong codes. Wait a minute.")

    def failed(self, address: str) -> None:
        """Count a failed trial."""
        with self._lock:
            if len(self._failed) >= _MOST_ADDRESSES:
                self._failed.clear()
            self._failed.setdefault(address, deque(maxlen=self._most)).append(self._clock())


class Guard:
    """ASGI middleware: size limit, requests of other sites refused, and headers that forbid what no page needs."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        refused = _refused(request)
        if refused is not None:
            await refused(scope, receive, send)
            return
        size, largest = 0, _largest(request)

        async def limited() -> Message:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            if size > largest:
                raise HTTPException(413, "The request is too large.")
            return message

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = message["headers"]
                present = {name.lower() for name, _ in headers}
                headers += [(k.encode(), v.encode()) for k, v in _HEADERS.items() if k.lower().encode() not in present]
                if b"content-security-policy" not in present:
                    headers.append((b"content-security-policy", _POLICY.encode()))
            await send(message)

        await self._app(scope, limited, guarded)


def _largest(request: Request) -> int:
    return LARGEST_UPLOAD if request.url.path == UPLOAD_PATH else LARGEST_BODY


def _refused(request: Request) -> Response | None:
    length = request.headers.get("content-length", "0")
    if not length.isdecimal() or int(length) > _largest(request):
        return JSONResponse({"error": "The request is too large."}, 413)
    origin = request.headers.get("origin")
    if request.method not in ("GET", "HEAD") and origin is not None and urlsplit(origin).netloc != request.url.netloc:
        return JSONResponse({"error": "This request comes from another site."}, 403)
    return None
