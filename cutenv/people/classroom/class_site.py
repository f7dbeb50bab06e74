"""Site of a class: texts, look, sign-in, and request guard."""

from __future__ import annotations

import functools
import hashlib
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from anyio import CapacityLimiter, to_thread
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cutenv._base.document import render, script_digest
from cutenv._base.language_files import languages, local_moment
from cutenv.display.report.page import translated
from cutenv.envs.tissue_source import TissueSource
from cutenv.people.browser.page_data import page_data
from cutenv.people.classroom.class_store import teacher_of
from cutenv.people.classroom.foreign_upload import LARGEST_UPLOAD
from cutenv.people.classroom.host_names import is_address
from cutenv.people.classroom.lesson import LONGEST_CUT, Lesson
from cutenv.people.classroom.xapi_statements import Courier
from cutenv.people.play.course import course_name

if TYPE_CHECKING:
    from cutenv.people.classroom.lti_tool import LtiTool  # an extra

LARGEST_BODY = 24 * LONGEST_CUT + 4096
"""Largest body of a request that is read [bytes]: the movements of the longest cut."""
UPLOAD_PATH = "/teacher/upload"
"""Path to which files are sent."""
LAUNCH_PATHS = ("/lti/login", "/lti/launch", "/lti/choose")
"""Paths to which learning platforms send a browser: they alone take forms of another site, and change nothing."""
_TRIALS, _MINUTE = 10, 60.0  # wrong codes and tokens that one address may try in a minute
_MOST_ADDRESSES, _MOST_FAILURES = 10_000, 2_000  # addresses whose failures are remembered, and how many of each
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; form-action 'self'; frame-ancestors 'none'"
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Trials:
    """Rate limiter that counts failed trials by address.

    An address has ``fewest`` failures in a period [s], and ``each`` further ones for each code there is: a whole class
    may stand behind one address, and type.
    """

    def __init__(
        self, fewest: int = _TRIALS, each: int = 0, period: float = _MINUTE, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._fewest, self._each, self._period, self._clock = fewest, each, period, clock
        self._failed: dict[str, deque[float]] = {}
        self._lock = threading.Lock()

    def check(self, address: str, codes: int = 0) -> None:
        """Raise HTTPException 429 for an address with too many failures."""
        with self._lock:
            failed = self._failed.get(address, deque())
            while failed and failed[0] < self._clock() - self._period:
                failed.popleft()
            if len(failed) >= self._fewest + self._each * codes:
                raise HTTPException(429, "Too many failures. Wait a minute.")

    def failed(self, address: str) -> None:
        """Count a failed trial."""
        with self._lock:
            if len(self._failed) >= _MOST_ADDRESSES:
                self._failed.clear()
            self._failed.setdefault(address, deque(maxlen=_MOST_FAILURES)).append(self._clock())


class Guard:
    """ASGI middleware that limits sizes, refuses cross-site requests and sets headers.

    Besides ``hosts``, names of the server in lower case, only an address in digits is answered to; with None any name.
    A page whose own name leads to this machine could read the class otherwise.
    """

    def __init__(self, app: ASGIApp, hosts: Collection[str] | None = None) -> None:
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        refused = _refused(request, self._hosts)
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

        with suppress(ClientDisconnect):  # a telephone that loses its network is no fault of the server
            await self._app(scope, limited, guarded)


def _largest(request: Request) -> int:
    return LARGEST_UPLOAD if request.url.path == UPLOAD_PATH else LARGEST_BODY


def _refused(request: Request, hosts: Collection[str] | None) -> Response | None:
    length = request.headers.get("content-length", "0")
    if not length.isdecimal() or int(length) > _largest(request):
        return JSONResponse({"error": "The request is too large."}, 413)
    called = request.url.hostname or ""
    if hosts is not None and called.lower() not in hosts and not is_address(called):
        return JSONResponse({"error": f"This server is not known as {called!r}. Start it with --name {called}."}, 421)
    origin = request.headers.get("origin")
    foreign = origin is not None and urlsplit(origin).netloc != request.url.netloc
    if request.method not in ("GET", "HEAD") and foreign and request.url.path not in LAUNCH_PATHS:
        return JSONResponse({"error": "This request comes from another site."}, 403)
    return None


_PAGES = Path(__file__).parent / "pages"
_SIGNED_IN = 12 * 3600  # [s]


@functools.lru_cache(8)  # a second of work; a course that is edited may have other tasks
def _page_data(tasks: tuple[str, ...], tissue: str | Path | None, _languages: tuple[str, ...]) -> dict[str, Any]:
    return page_data(tasks, TissueSource(tissue).description)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassSite:
    """Site of a class."""

    lesson: Lesson
    secret: str  # token with which the teacher signs in
    title: str = "cutenv"
    language: str = "en"  # until the reader chooses
    secure: bool = False  # served over TLS: cookies are never sent without
    courier: Courier | None = None  # of statements to a record store; whoever enters is told, and agrees
    hosts: Collection[str] | None = None  # names by which it is reached, see Guard
    lti: LtiTool | None = None

    @cached_property
    def person_cookie(self) -> str:
        """Cookie name of a person who cuts, separate for each class."""
        return f"cutenv_person_{self._mark}"

    @cached_property
    def teacher_cookie(self) -> str:
        """Name of the teacher's cookie."""
        return f"cutenv_teacher_{self._mark}"

    @cached_property
    def _mark(self) -> str:
        return hashlib.sha256(str(self.lesson.folder.resolve()).encode()).hexdigest()[:8]

    @cached_property
    def teacher_name(self) -> str:
        """Name of the signed-in teacher; it ends with the secret."""
        return teacher_of(self.secret)

    @property
    def page_data(self) -> dict[str, Any]:
        """Facts that the page that cuts needs, whatever the specimen."""
        return _page_data(tuple(self.lesson.kinds), self.lesson.tissue, languages())

    @property
    def words(self) -> Mapping[str, str]:
        """Words of the class's language, by key."""
        words: Mapping[str, str] = self.page_data["texts"][self.language]
        return words

    def page(self, name: str, status: int = 200, **values: Any) -> HTMLResponse:
        """Answer with a page, from its template and the template's values."""
        shared: dict[str, Any] = {"title": self.title, "words": self.words, "language": self.language}
        shared |= {"courier": self.courier, "lti": self.lti}
        filters: dict[str, Callable[..., Any]] = {
            "digest": script_digest,
            "moment": lambda utc: local_moment(datetime.fromisoformat(utc), self.language),
            "said": functools.partial(translated, language=self.language),
            "task_name": functools.partial(course_name, self.language),
        }
        return HTMLResponse(render(_PAGES / name, shared | values, filters=filters), status)

    def sign_in(self, who: str, page: str) -> Response:
        """Sign a person in by code, or the teacher by name, and lead on to a page."""
        response, token = RedirectResponse(page, 303), self.lesson.store.sign_in(who)
        cookie = self.teacher_cookie if who == self.teacher_name else self.person_cookie
        response.set_cookie(cookie, token, max_age=_SIGNED_IN, httponly=True, samesite="strict", secure=self.secure)
        return response

    async def signed_in(self, request: Request, cookie: str) -> str | None:
        """Return the code that a cookie has signed in, or None."""
        token = request.cookies.get(cookie, "")
        return None if not token else await run_in_threadpool(self.lesson.store.signed_in, token)

    async def person(self, request: Request) -> str:
        """Return the requesting person's code; HTTPException 401 if not signed in."""
        code = await self.signed_in(request, self.person_cookie)
        if not code:
            raise HTTPException(401, "Sign in with your code first.")
        return code

    async def teacher(self, request: Request) -> None:
        """Raise HTTPException 401 if it is not the teacher who asks."""
        if not await self.is_teacher(request):
            raise HTTPException(401, "Sign in as the teacher first.")

    async def is_teacher(self, request: Request) -> bool:
        """Return whether it is the teacher who asks."""
        return await self.signed_in(request, self.teacher_cookie) == self.teacher_name

    def teachers_route(
        self,
        method: str,
        path: str,
        answer: Callable[[Request, FormData], Response],
        *,
        limiter: CapacityLimiter | None = None,
        **limits: int,
    ) -> Route:
        """Return a route for the teacher alone, whose ``answer`` to request and form runs in a thread.

        A LookupError becomes 404, a ValueError 422; ``limits`` are those of the form.
        """

        async def checked(request: Request) -> Response:
            await self.teacher(request)
            form = await request.form(**limits)
            try:
                return await to_thread.run_sync(answer, request, form, limiter=limiter)
            except LookupError as error:
                raise HTTPException(404, str(error)) from None
            except ValueError as error:
                raise HTTPException(422, str(error)) from None

        return Route(path, checked, methods=[method])


class Pages:
    """Pages and answers of a class."""

    def __init__(self, site: ClassSite) -> None:
        self._site, self._lesson = site, site.lesson


def text_of(form: FormData, name: str) -> str:
    """Return a form's text; "" for none, and for a file."""
    value = form.get(name, "")
    return value if isinstance(value, str) else ""


def download(content: bytes, name: str, kind: str) -> Response:
    """Answer with a file to be saved."""
    return Response(content, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'})
