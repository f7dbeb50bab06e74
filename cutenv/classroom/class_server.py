"""Web server of a class: pages for people who cut, and for their teacher; no page asks another host for anything."""

from __future__ import annotations

import hmac
import secrets
import sys
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from sqlalchemy.exc import SQLAlchemyError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cutenv._base.document import render
from cutenv.browser.page_alone import page_data, page_text, script_digest
from cutenv.classroom.class_store import SAVED, TEACHER
from cutenv.classroom.foreign_upload import LARGEST_UPLOAD
from cutenv.classroom.lesson import LONGEST_CUT, Lesson, RefusedCut
from cutenv.classroom.live_rig import LiveRig, live_routes
from cutenv.classroom.score_curve import score_curve
from cutenv.classroom.teacher_pages import UPLOAD_PATH, overview, teacher_routes
from cutenv.classroom.xapi_statements import Courier

LARGEST_BODY = 24 * LONGEST_CUT + 4096
"""Largest body of a request that is read [bytes]: the movements of the longest cut."""
_PAGES = Path(__file__).parent / "pages"
_PERSON, _TEACHER = "cutenv_person", "cutenv_teacher"
_TRIALS, _MINUTE = 10, 60.0  # wrong codes and tokens that one address may try in a minute
_MOST_ADDRESSES = 10_000  # whose failures are remembered
_MOST_CODES = 500
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


def class_app(
    lesson: Lesson,
    teacher_token: str,
    *,
    title: str = "cutenv",
    language: str = "en",
    secure: bool = False,
    live: LiveRig | None = None,
    courier: Courier | None = None,
    ticket: str | None = None,
) -> Starlette:
    """Return the ASGI application of a class.

    Parameters
    ----------
    lesson : Lesson
        The class at work.
    teacher_token : str
        Secret with which the teacher signs in.
    title : str
        Name of the class on its pages.
    language : {"en", "de"}
        Language until the reader chooses.
    secure : bool
        True if it is served over TLS: cookies are never sent without.
    live : LiveRig, optional
        Rig that the teacher may watch.
    courier : Courier, optional
        Who delivers statements of cuts to a learning record store; whoever enters is told, and agrees.
    ticket : str, optional
        Secret that signs the teacher in once, by the address ``teacher/open/TICKET``, within the first minute.
    """
    common = page_data(lesson.kinds)
    trials, opened = Trials(), time.monotonic()
    words = common["texts"][language]

    def page(name: str, status: int = 200, **values: Any) -> HTMLResponse:
        filled = {"title": title, "words": words, "language": language, "courier": courier, **values}
        return HTMLResponse(render(_PAGES / name, filled, filters={"digest": script_digest}), status)

    def sign(response: Response, name: str, token: str) -> Response:
        response.set_cookie(name, token, max_age=12 * 3600, httponly=True, samesite="strict", secure=secure)
        return response

    async def signed_in(request: Request, name: str) -> str | None:
        token = request.cookies.get(name, "")
        return None if not token else await run_in_threadpool(lesson.store.signed_in, token)

    async def person(request: Request) -> str:
        code = await signed_in(request, _PERSON)
        if not code:
            raise HTTPException(401, "Sign in with your code first.")
        return code

    async def teacher(request: Request) -> None:
        if await signed_in(request, _TEACHER) != TEACHER:
            raise HTTPException(401, "Sign in as the teacher first.")

    # People who cut

    async def enter_page(request: Request) -> Response:
        if await signed_in(request, _PERSON):
            return RedirectResponse("cut", 303)
        return page("enter.html", trouble="")

    async def enter(request: Request) -> Response:
        address = request.client.host if request.client else ""
        trials.check(address)
        form = await request.form()
        code = str(form.get("code", "")).strip().upper()
        if not (code and code.isprintable()) or not await run_in_threadpool(lesson.store.knows, code):
            trials.failed(address)
            return page("enter.html", 403, trouble=words["wrong_code"])
        if form.get("consent") != "yes":
            return page("enter.html", 403, trouble=words["no_consent"])
        await run_in_threadpool(lesson.store.consent, code)
        if courier is not None:
            await run_in_threadpool(courier.queue.agree, code)
        token = await run_in_threadpool(lesson.store.sign_in, code)
        return sign(RedirectResponse("cut", 303), _PERSON, token)

    async def leave(request: Request) -> Response:
        for name in (_PERSON, _TEACHER):
            if token := request.cookies.get(name):
                await run_in_threadpool(lesson.store.sign_out, token)
        response = RedirectResponse(".", 303)
        response.delete_cookie(_PERSON)
        response.delete_cookie(_TEACHER)
        return response

    async def cut_page(request: Request) -> Response:
        code = await signed_in(request, _PERSON)
        if not code:
            return RedirectResponse(".", 303)
        told = common | {"language": language, "specimens": [], "served": True}
        text = await run_in_threadpool(page_text, "page_served.html", told, code_of_person=code)
        return HTMLResponse(text, headers={"Content-Security-Policy": "frame-ancestors 'none'"})

    async def begin(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(lesson.begin, await person(request)))

    async def begun(request: Request) -> Response:
        code = await person(request)
        await run_in_threadpool(lesson.store.begun, request.path_params["number"], code)
        return JSONResponse({})

    async def finish(request: Request) -> Response:
        code = await person(request)
        try:
            stalled = float(request.headers.get("x-stalled", "0"))
        except ValueError:
            stalled = 0.0
        number, digest = request.path_params["number"], request.headers.get("x-readings", "")
        movements = await request.body()
        try:
            said = await run_in_threadpool(lesson.finish, code, number, movements, digest, stalled=stalled)
        except RefusedCut as error:
            raise HTTPException(422, str(error)) from None
        except LookupError as error:
            raise HTTPException(404, str(error)) from None
        except OSError as error:
            raise HTTPException(507, f"The record cannot be written: {error.strerror}.") from None
        return JSONResponse(said)

    async def history(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(lesson.history, await person(request)))

    async def curve(request: Request) -> Response:
        cuts = await run_in_threadpool(lesson.history, await person(request))
        mark = await run_in_threadpool(lambda: lesson.pass_mark)
        scores = [cut["score"] for cut in cuts if cut["state"] == SAVED]
        return JSONResponse({"curve": score_curve([scores], mark=None if mark is None else mark.mark)})

    # Teacher

    async def teacher_sign_in(request: Request) -> Response:
        address = request.client.host if request.client else ""
        trials.check(address)
        form = await request.form()
        if not hmac.compare_digest(str(form.get("token", "")).encode(), teacher_token.encode()):
            trials.failed(address)
            return page("teacher_sign_in.html", 403, trouble=words["wrong_token"])
        token = await run_in_threadpool(lesson.store.sign_in, TEACHER)
        return sign(RedirectResponse("teacher", 303), _TEACHER, token)

    async def open_once(request: Request) -> Response:
        nonlocal ticket
        given = request.path_params["ticket"].encode()
        if ticket is None or time.monotonic() > opened + _MINUTE or not hmac.compare_digest(given, ticket.encode()):
            return RedirectResponse("../../teacher", 303)
        ticket = None
        token = await run_in_threadpool(lesson.store.sign_in, TEACHER)
        return sign(RedirectResponse("../../teacher", 303), _TEACHER, token)

    async def teacher_page(request: Request) -> Response:
        if await signed_in(request, _TEACHER) != TEACHER:
            return page("teacher_sign_in.html", trouble="")
        shown = await run_in_threadpool(overview, lesson, language)
        return page("teacher.html", most=_MOST_CODES, root="", rig=live, **shown)

    async def add_codes(request: Request) -> Response:
        await teacher(request)
        form = await request.form()
        count, class_name = str(form.get("count", "")), str(form.get("class_name", "")).strip()
        if not (count.isascii() and count.isdecimal()) or not 1 <= int(count) <= _MOST_CODES:
            raise HTTPException(422, f"count = {count!r} is outside 1 to {_MOST_CODES}. Give how many codes.")
        try:
            await run_in_threadpool(lesson.store.put, [], class_name=class_name)  # a bad name makes no codes
        except ValueError as error:
            raise HTTPException(422, str(error)) from None
        codes = await run_in_threadpool(lesson.store.add_codes, int(count))
        await run_in_threadpool(lesson.store.put, codes, class_name=class_name)
        return RedirectResponse("../teacher", 303)

    async def sheet(request: Request) -> Response:
        await teacher(request)
        codes = [code for code, _ in await run_in_threadpool(lesson.store.codes)]
        return page("code_sheet.html", codes=codes, address=str(request.base_url))

    async def records(request: Request) -> Response:
        await teacher(request)
        code = request.path_params.get("code")
        if code is not None and not await run_in_threadpool(lesson.store.knows, code):
            raise HTTPException(404, "There is no such code.")
        content = await run_in_threadpool(lesson.records, code)
        name = "records.zip" if code is None else f"{code}.zip"
        return Response(
            content, media_type="application/zip", headers={"Content-Disposition": f'attachment; filename="{name}"'}
        )

    async def card(request: Request) -> Response:
        await teacher(request)
        code, number = request.path_params["code"], request.path_params["number"]
        try:
            text = await run_in_threadpool(lesson.card_page, code, number)
        except LookupError as error:
            raise HTTPException(404, str(error)) from None
        return HTMLResponse(text)

    async def remove(request: Request) -> Response:
        await teacher(request)
        form = await request.form()
        if form.get("code") != form.get("again"):
            raise HTTPException(422, "The code was not typed a second time: nobody was deleted.")
        if not await run_in_threadpool(lesson.delete, str(form.get("code", ""))):
            raise HTTPException(404, "There is no such code.")
        return RedirectResponse("../teacher", 303)

    async def failed(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if "text/html" in request.headers.get("accept", ""):  # a person asked, not the page's script
            return page("trouble.html", error.status_code, trouble=error.detail)
        return JSONResponse({"error": error.detail}, error.status_code)

    async def unwritten(request: Request, error: Exception) -> Response:
        print(f"cutenv serve: {error}", file=sys.stderr, flush=True)
        return JSONResponse({"error": "The class's database cannot be read or written; the server says why."}, 507)

    def get(path: str, answer: Callable[[Request], Awaitable[Response]]) -> Route:
        return Route(path, answer, methods=["GET"])

    def post(path: str, answer: Callable[[Request], Awaitable[Response]]) -> Route:
        return Route(path, answer, methods=["POST"])

    return Starlette(
        routes=[
            *live_routes(live, teacher, page), get("/teacher/open/{ticket:str}", open_once),
            get("/", enter_page), post("/", enter), post("/leave", leave), get("/cut", cut_page),
            post("/cuts", begin), get("/cuts", history), get("/curve", curve), post("/cuts/{number:str}", finish),
            post("/cuts/{number:str}/begun", begun),
            get("/teacher", teacher_page), post("/teacher", teacher_sign_in), post("/teacher/codes", add_codes),
            get("/teacher/sheet", sheet), get("/teacher/records.zip", records), post("/teacher/delete", remove),
            *teacher_routes(lesson, teacher, page, words, language),
            get("/teacher/{code:str}/records.zip", records), get("/teacher/{code:str}/{number:str}", card),
        ],
        middleware=[Middleware(Guard)],
        exception_handlers={HTTPException: failed, SQLAlchemyError: unwritten},
    )  # fmt: skip


def new_token() -> str:
    """Return a new secret for the teacher."""
    return secrets.token_urlsafe(16)
