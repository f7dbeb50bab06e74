"""Pages of a class for its teacher: the list of the class, people, codes, records."""

from __future__ import annotations

import hmac
import time

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from cutenv.classroom.class_overview import overview
from cutenv.classroom.class_site import TEACHER_COOKIE, ClassSite, download, text_of
from cutenv.classroom.class_store import TEACHER
from cutenv.classroom.live_rig import LiveRig
from cutenv.classroom.request_guard import Trials

_MOST_CODES = 500
_TICKET_LASTS = 60.0  # [s]


class TeacherPages:
    """Pages and answers for the teacher.

    Parameters
    ----------
    site : ClassSite
        Site of the class.
    trials : Trials
        Failed trials, by address.
    token : str
        Secret with which the teacher signs in.
    ticket : str, optional
        Secret that signs the teacher in once, by the address ``teacher/open/TICKET``, within the first minute.
    live : LiveRig, optional
        Rig that the teacher may watch.
    """

    def __init__(
        self,
        site: ClassSite,
        trials: Trials,
        token: str,
        *,
        ticket: str | None = None,
        live: LiveRig | None = None,
    ) -> None:
        self._site, self._trials, self._lesson, self._live = site, trials, site.lesson, live
        self._token, self._ticket, self._opened = token, ticket, time.monotonic()

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route = self._site.teachers_route
        return [
            Route("/teacher/open/{ticket:str}", self.open_once, methods=["GET"]),
            Route("/teacher", self.teacher_page, methods=["GET"]),
            Route("/teacher", self.teacher_sign_in, methods=["POST"]),
            route("POST", "/teacher/codes", self.add_codes), route("GET", "/teacher/sheet", self.sheet),
            route("GET", "/teacher/records.zip", self.records), route("POST", "/teacher/delete", self.remove),
            route("POST", "/teacher/places", self.place), route("GET", "/teacher/cuts.csv", self.cut_table),
            route("GET", "/teacher/people/{code:str}", self.person),
        ]  # fmt: skip

    @property
    def routes_of_any_name(self) -> list[Route]:
        """Routes that take any name, and so come after all others."""
        route = self._site.teachers_route
        return [
            route("GET", "/teacher/{code:str}/records.zip", self.records),
            route("GET", "/teacher/{code:str}/{number:str}", self.card),
        ]

    async def teacher_page(self, request: Request) -> Response:
        """Show the list of the class, or where the teacher signs in."""
        if await self._site.signed_in(request, TEACHER_COOKIE) != TEACHER:
            return self._site.page("teacher_sign_in.html", trouble="")
        shown = await run_in_threadpool(overview, self._lesson, self._site.language)
        return self._site.page("teacher.html", most=_MOST_CODES, root="", rig=self._live, **shown)

    async def teacher_sign_in(self, request: Request) -> Response:
        """Sign the teacher in."""
        address = request.client.host if request.client else ""
        self._trials.check(address)
        form = await request.form()
        if not hmac.compare_digest(str(form.get("token", "")).encode(), self._token.encode()):
            self._trials.failed(address)
            return self._site.page("teacher_sign_in.html", 403, trouble=self._site.words["wrong_token"])
        token = await run_in_threadpool(self._lesson.store.sign_in, TEACHER)
        return self._site.sign(RedirectResponse("teacher", 303), TEACHER_COOKIE, token)

    async def open_once(self, request: Request) -> Response:
        """Sign the teacher in by the ticket, once."""
        given, ticket = request.path_params["ticket"].encode(), self._ticket
        late = time.monotonic() > self._opened + _TICKET_LASTS
        if ticket is None or late or not hmac.compare_digest(given, ticket.encode()):
            return RedirectResponse("../../teacher", 303)
        self._ticket = None
        token = await run_in_threadpool(self._lesson.store.sign_in, TEACHER)
        return self._site.sign(RedirectResponse("../../teacher", 303), TEACHER_COOKIE, token)

    async def add_codes(self, request: Request) -> Response:
        """Make codes for people."""
        form = await request.form()
        count, class_name = str(form.get("count", "")), str(form.get("class_name", "")).strip()
        if not (count.isascii() and count.isdecimal()) or not 1 <= int(count) <= _MOST_CODES:
            raise HTTPException(422, f"count = {count!r} is outside 1 to {_MOST_CODES}. Give how many codes.")
        await run_in_threadpool(self._lesson.store.put, [], class_name=class_name)  # a bad name makes no codes
        codes = await run_in_threadpool(self._lesson.store.add_codes, int(count))
        await run_in_threadpool(self._lesson.store.put, codes, class_name=class_name)
        return RedirectResponse("../teacher", 303)

    async def sheet(self, request: Request) -> Response:
        """Show codes to print and cut apart."""
        codes = [code for code, _ in await run_in_threadpool(self._lesson.store.codes)]
        return self._site.page("code_sheet.html", codes=codes, address=str(request.base_url))

    async def records(self, request: Request) -> Response:
        """Send all records, or those of one person, packed."""
        code = request.path_params.get("code")
        if code is not None and not await run_in_threadpool(self._lesson.store.knows, code):
            raise HTTPException(404, "There is no such code.")
        content = await run_in_threadpool(self._lesson.records, code)
        name = "records.zip" if code is None else f"{code}.zip"
        return download(content, name, "application/zip")

    async def card(self, request: Request) -> Response:
        """Show the score card of a cut."""
        code, number = request.path_params["code"], request.path_params["number"]
        return HTMLResponse(await run_in_threadpool(self._lesson.card_page, code, number))

    async def remove(self, request: Request) -> Response:
        """Delete a person, with all cuts."""
        form = await request.form()
        if form.get("code") != form.get("again"):
            raise HTTPException(422, "The code was not typed a second time: nobody was deleted.")
        if not await run_in_threadpool(self._lesson.delete, str(form.get("code", ""))):
            raise HTTPException(404, "There is no such code.")
        return RedirectResponse("../teacher", 303)

    async def person(self, request: Request) -> Response:
        """Show a person's cuts."""
        code = request.path_params["code"]
        rows = (await run_in_threadpool(overview, self._lesson, self._site.language))["people"]
        for row in (row for row in rows if row["code"] == code):
            return self._site.page("person.html", person=row, mark=self._lesson.pass_mark, root="../../")
        raise HTTPException(404, "There is no such code.")

    async def place(self, request: Request) -> Response:
        """Put people into classes and groups."""
        form = await request.form()
        codes = [str(code) for code in form.getlist("code")]
        if not codes:
            raise HTTPException(422, self._site.words["nobody_chosen"])
        given = {name: text_of(form, name).strip() for name in ("class_name", "group")}
        new = {name: "" if text == "-" else text for name, text in given.items() if text}  # a dash takes out
        await run_in_threadpool(self._lesson.store.put, codes, **new)
        return RedirectResponse("../teacher", 303)

    async def cut_table(self, request: Request) -> Response:
        """Send a table of all cuts."""
        return download((await run_in_threadpool(self._lesson.table)).encode(), "cuts.csv", "text/csv")
