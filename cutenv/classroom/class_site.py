"""Site of a class: its words, its look, and who is signed in."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Route

from cutenv._base.document import render
from cutenv.browser.page_alone import page_data, script_digest
from cutenv.classroom.class_store import TEACHER
from cutenv.classroom.lesson import Lesson
from cutenv.classroom.xapi_statements import Courier

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
