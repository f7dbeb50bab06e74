"""Site of a class: its words, its look, who is signed in; and its guard: trials by address, limits of size, headers."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cutenv._base.document import render
from cutenv.browser.page_alone import page_data, script_digest
from cutenv.classroom.class_store import TEACHER
from cutenv.classroom.foreign_upload import LARGEST_UPLOAD
from cutenv.classroom.lesson import LONGEST_CUT, Lesson
from cutenv.classroom.xapi_statements import Courier

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


PERSON_COOKIE, TEACHER_COOKIE = "cutenv_person", "cutenv_teacher"
"""Cookies of a person who cuts, and of the teacher."""
_PAGES = Path(__file__).parent / "pages"
_SIGNED_IN = 12 * 3600  # [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassSite:
    """Site of a class.

    Attributes
    ----------
    lesson : Lesson
        The class at work.
    title : str
        Name of the class on its pages.
    language : {"en", "de"}
        Language until the reader chooses.
    secure : bool
        True if it is served over TLS: cookies are never sent without.
    courier : Courier, optional
        Who delivers statements of cuts to a learning record store; whoever enters is told, and agrees.
    """

    lesson: Lesson
    title: str = "cutenv"
    language: str = "en"
    secure: bool = False
    courier: Courier | None = None

    @cached_property
    def page_data(self) -> dict[str, Any]:
        """Facts that the page that cuts needs, whatever the specimen."""
        return page_data(self.lesson.kinds)

    @property
    def words(self) -> Mapping[str, str]:
        """Words of the class's language, by key."""
        words: Mapping[str, str] = self.page_data["texts"][self.language]
        return words

    def page(self, name: str, status: int = 200, **values: Any) -> HTMLResponse:
        """Answer with a page, from its template and the template's values."""
        shared = {"title": self.title, "words": self.words, "language": self.language, "courier": self.courier}
        return HTMLResponse(render(_PAGES / name, shared | values, filters={"digest": script_digest}), status)

    def sign(self, response: Response, cookie: str, token: str) -> Response:
        """Let an answer sign somebody in."""
        response.set_cookie(cookie, token, max_age=_SIGNED_IN, httponly=True, samesite="strict", secure=self.secure)
        return response

    async def signed_in(self, request: Request, cookie: str) -> str | None:
        """Return the code of whom a cookie has signed in; None for nobody."""
        token = request.cookies.get(cookie, "")
        return None if not token else await run_in_threadpool(self.lesson.store.signed_in, token)

    async def person(self, request: Request) -> str:
        """Return the code of the person who asks; HTTPException 401 if nobody is signed in."""
        code = await self.signed_in(request, PERSON_COOKIE)
        if not code:
            raise HTTPException(401, "Sign in with your code first.")
        return code

    async def teacher(self, request: Request) -> None:
        """Raise HTTPException 401 if it is not the teacher who asks."""
        if await self.signed_in(request, TEACHER_COOKIE) != TEACHER:
            raise HTTPException(401, "Sign in as the teacher first.")

    def teachers_route(self, method: str, path: str, answer: Callable[[Request], Awaitable[Response]]) -> Route:
        """Return a route for the teacher alone; what its answer cannot find is 404, what it cannot use is 422."""

        async def checked(request: Request) -> Response:
            await self.teacher(request)
            try:
                return await answer(request)
            except LookupError as error:
                raise HTTPException(404, str(error)) from None
            except ValueError as error:
                raise HTTPException(422, str(error)) from None

        return Route(path, checked, methods=[method])


def text_of(form: FormData, name: str) -> str:
    """Return a form's text; "" for none, and for a file."""
    value = form.get(name, "")
    return value if isinstance(value, str) else ""


def download(content: bytes, name: str, kind: str) -> Response:
    """Answer with a file to be saved."""
    return Response(content, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'})
