"""Pages and answers for people who cut."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from cutenv.people.browser.page_data import page_text
from cutenv.people.classroom.class_overview import score_curve
from cutenv.people.classroom.class_site import ClassSite, Pages, Trials
from cutenv.people.classroom.class_tables import SAVED, TRIAL

_LONGEST_CODE = 64
_FAILURES_BY_CODE = 2  # wrong codes in a minute, for each code there is


class PeoplePages(Pages):
    """Pages and answers for people who cut."""

    def __init__(self, site: ClassSite) -> None:
        super().__init__(site)
        self._trials = Trials(each=_FAILURES_BY_CODE)

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        lesson, answered = self._lesson, self._answered
        return [
            Route("/", self.enter_page, methods=["GET"]), Route("/", self.enter, methods=["POST"]),
            Route("/leave", self.leave, methods=["POST"]), Route("/cut", self.cut_page, methods=["GET"]),
            answered("POST", "/cuts", self.begin), answered("GET", "/cuts", lambda code, *_: lesson.history(code)),
            answered("GET", "/curve", self.curve), answered("GET", "/comments", self.comments),
            answered("POST", "/cuts/{number:str}", self.finish),
            answered("GET", "/demonstration", lambda code, *_: lesson.demonstration(code)),
            answered("POST", "/cuts/{number:str}/begun", self.begun),
            answered("GET", "/cuts/{number:str}/replay", self.replay),
        ]  # fmt: skip

    def _answered(self, method: str, path: str, answer: Callable[[str, Request, bytes], Any]) -> Route:
        """Return a route by which ``answer`` tells a signed-in person something as JSON.

        It gets the person's code, the request and its body, and runs in a thread; a LookupError becomes 404, a
        ValueError 422.
        """

        async def checked(request: Request) -> Response:
            code = await self._site.person(request)
            body = await request.body()
            try:
                return JSONResponse(await run_in_threadpool(answer, code, request, body))
            except LookupError as error:
                raise HTTPException(404, str(error)) from None
            except ValueError as error:
                raise HTTPException(422, str(error)) from None

        return Route(path, checked, methods=[method])

    async def enter_page(self, request: Request) -> Response:
        """Show the page on which a code is entered."""
        if await self._site.signed_in(request, self._site.person_cookie):
            return RedirectResponse("cut", 303)
        return self._site.page("enter.html", trouble="", code=request.query_params.get("code", "")[:_LONGEST_CODE])

    async def enter(self, request: Request) -> Response:
        """Sign a person in who has a code and consents."""
        site, store = self._site, self._lesson.store
        address = request.client.host if request.client else ""
        self._trials.check(address, len(await run_in_threadpool(store.codes)))
        form = await request.form()
        code = str(form.get("code", "")).strip().upper()
        if not (code and code.isprintable() and code != TRIAL) or not await run_in_threadpool(store.knows, code):
            self._trials.failed(address)
            return site.page("enter.html", 403, trouble=site.words["wrong_code"], code="")
        if form.get("consent") != "yes":
            return site.page("enter.html", 403, trouble=site.words["no_consent"], code=code)
        await run_in_threadpool(store.consent, code)
        if site.courier is not None:
            await run_in_threadpool(site.courier.queue.agree, code)
        return await run_in_threadpool(site.sign_in, code, "cut")

    async def leave(self, request: Request) -> Response:
        """Sign out."""
        response = RedirectResponse(".", 303)
        for name in (self._site.person_cookie, self._site.teacher_cookie):
            if token := request.cookies.get(name):
                await run_in_threadpool(self._lesson.store.sign_out, token)
            response.delete_cookie(name)
        return response

    async def cut_page(self, request: Request) -> Response:
        """Show the page that cuts."""
        code = await self._site.signed_in(request, self._site.person_cookie)
        if not code:
            return RedirectResponse(".", 303)
        told = self._site.page_data | {"language": self._site.language, "specimens": [], "served": True}
        text = await run_in_threadpool(page_text, "page_served.html", told, code_of_person=code)
        return HTMLResponse(text, headers={"Content-Security-Policy": "frame-ancestors 'none'"})

    def begin(self, code: str, _: Request, __: bytes) -> dict[str, Any]:
        """Hand out a cut."""
        try:
            return self._lesson.begin(code)
        except OSError as error:
            raise HTTPException(507, f"No cut can be handed out: {error}.") from None

    def begun(self, code: str, request: Request, _: bytes) -> dict[str, Any]:
        """Note that a cut has begun."""
        if not self._lesson.store.begun(request.path_params["number"], code):
            raise HTTPException(409, "This cut is not to be begun any more. Load the page again.")
        return {}

    def replay(self, code: str, request: Request, _: bytes) -> dict[str, Any]:
        """Return a saved cut for its replay."""
        try:
            return self._lesson.replay(code, request.path_params["number"])
        except OSError as error:
            raise HTTPException(422, str(error)) from None

    def finish(self, code: str, request: Request, movements: bytes) -> dict[str, Any]:
        """Repeat, score and keep a cut that has ended."""
        number, said = request.path_params["number"], request.headers
        try:
            stalled = float(said.get("x-stalled", "0"))
        except ValueError:
            stalled = 0.0
        digest, aids = said.get("x-readings", ""), said.get("x-aids", "").split(",")
        try:
            return self._lesson.finish(code, number, movements, digest, stalled=stalled, aids=aids)
        except OSError as error:
            raise HTTPException(507, f"The record cannot be written: {error.strerror}.") from None

    def comments(self, code: str, _: Request, __: bytes) -> list[dict[str, str]]:
        """Return the teacher's comments to the person."""
        return [{"when": each.written, "said": each.said} for each in self._lesson.store.comments(code)]

    def curve(self, code: str, _: Request, __: bytes) -> dict[str, str]:
        """Return the person's learning curve."""
        cuts, mark = self._lesson.history(code), self._lesson.mark_of(code)
        scores = [cut["score"] for cut in cuts if cut["state"] == SAVED and not cut["warm_up"]]
        label = self._site.words["score"]
        return {"curve": score_curve([scores], mark=None if mark is None else mark.mark, label=label)}
