"""Teacher's pages: people, codes, records, studies, pass marks, uploads."""

from __future__ import annotations

import functools
import hmac
import re
import time
from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from cutenv.display.report.page import embedded_figure
from cutenv.display.report.record_figure import record_figure
from cutenv.people.classroom.analysis import PASS_MARK_KIND, STUDY_KIND, StudiedRecord
from cutenv.people.classroom.class_overview import (
    CUTTING,
    LIVE_ORDERS,
    STALLED,
    live_list,
    marks_in_force,
    only_of,
    overview,
    people_of,
)
from cutenv.people.classroom.class_site import UPLOAD_PATH, ClassSite, Trials, download, text_of
from cutenv.people.classroom.class_store import LONGEST_COMMENT, Place
from cutenv.people.classroom.class_tables import KEPT, LEFT, SAVED, TRIAL
from cutenv.people.classroom.foreign_upload import PICKED, picked_length, units_by_field
from cutenv.people.classroom.host_names import is_loopback
from cutenv.people.classroom.lesson import name_of
from cutenv.people.classroom.live_rig import LiveRig
from cutenv.people.play.course import WARM_UP
from cutenv.records.scoring.study.estimate import FEWEST_PEOPLE

_MOST_CODES = 500
_MOST_PICTURES = 12
_TICKET_LASTS = 60.0  # [s]


class TeacherPages:
    """Pages and answers for the teacher.

    The ticket is that of :func:`~cutenv.people.classroom.class_server.class_app`.
    """

    def __init__(self, site: ClassSite, *, ticket: str | None = None, live: LiveRig | None = None) -> None:
        self._site, self._lesson, self._live = site, site.lesson, live
        self._trials = Trials()
        self._ticket, self._opened = ticket, time.monotonic()

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route = self._site.teachers_route
        return [
            Route("/teacher/open/{ticket:str}", self.open_once, methods=["GET"]),
            Route("/teacher", self.teacher_page, methods=["GET"]),
            Route("/teacher", self.teacher_sign_in, methods=["POST"]),
            route("POST", "/teacher/leave", self.leave_everywhere),
            route("POST", "/teacher/codes", self.add_codes), route("GET", "/teacher/sheet", self.sheet),
            route("GET", "/teacher/records.zip", self.records), route("POST", "/teacher/delete", self.remove),
            route("POST", "/teacher/places", self.place), route("GET", "/teacher/cuts.csv", self.cut_table),
            route("GET", "/teacher/people/{code:str}", self.person),
            route("POST", "/teacher/people/{code:str}/example", self.example),
            route("POST", "/teacher/people/{code:str}/comment", self.comment),
            route("GET", "/teacher/live", self.live_people), route("POST", "/teacher/try", self.try_lesson),
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
        """Show the class list, or the teacher's sign-in."""
        if not await self._site.is_teacher(request):
            return self._site.page("teacher_sign_in.html", trouble="")
        shown = await run_in_threadpool(overview, self._lesson, self._site.language)
        return self._site.page("teacher.html", most=_MOST_CODES, root="", rig=self._live, **shown)

    async def teacher_sign_in(self, request: Request) -> Response:
        """Sign the teacher in."""
        address = request.client.host if request.client else ""
        form = await request.form()
        if not hmac.compare_digest(str(form.get("token", "")).encode(), self._site.secret.encode()):
            self._trials.check(address)  # the right one is let in: it cannot be guessed
            self._trials.failed(address)
            return self._site.page("teacher_sign_in.html", 403, trouble=self._site.words["wrong_token"])
        return await self._signed_in("teacher")

    async def _signed_in(self, page: str) -> Response:
        token = await run_in_threadpool(self._lesson.store.sign_in, self._site.teacher_name)
        return self._site.sign(RedirectResponse(page, 303), self._site.teacher_cookie, token)

    async def leave_everywhere(self, request: Request) -> Response:
        """Sign the teacher out wherever the token was used."""
        await run_in_threadpool(self._lesson.store.sign_out_everywhere, self._site.teacher_name)
        return RedirectResponse("../teacher", 303)

    async def open_once(self, request: Request) -> Response:
        """Sign the teacher in by the ticket, once."""
        given, ticket = request.path_params["ticket"].encode(), self._ticket
        late = time.monotonic() > self._opened + _TICKET_LASTS
        if ticket is None or late or not hmac.compare_digest(given, ticket.encode()):
            return RedirectResponse("../../teacher", 303)
        self._ticket = None
        return await self._signed_in("../../teacher")

    async def add_codes(self, request: Request) -> Response:
        """Make codes for people."""
        form = await request.form()
        count, class_name = str(form.get("count", "")), str(form.get("class_name", "")).strip()
        course = text_of(form, "course")
        if not (count.isascii() and count.isdecimal()) or not 1 <= int(count) <= _MOST_CODES:
            raise HTTPException(422, f"count = {count!r} is outside 1 to {_MOST_CODES}. Give how many codes.")
        await run_in_threadpool(self._lesson.put, [], class_name=class_name, course=course)  # a bad one makes no codes
        codes = await run_in_threadpool(self._lesson.store.add_codes, int(count))
        await run_in_threadpool(self._lesson.put, codes, class_name=class_name, course=course)
        return RedirectResponse("../teacher", 303)

    async def live_people(self, request: Request) -> Response:
        """Show what everybody does now; the page looks again by itself."""
        by, chosen = request.query_params.get("by", "doing"), request.query_params.get("class", "")
        rows = await run_in_threadpool(
            lambda: live_list(self._lesson, self._site.language, by=by, class_name=chosen or None)
        )
        places = await run_in_threadpool(self._lesson.store.places)
        classes = sorted({place.class_name for place in places.values() if place.class_name})
        answer = self._site.page(
            "teacher_live.html", rows=rows, by=by, orders=LIVE_ORDERS, classes=classes, chosen=chosen, root="../",
            course=any(row["course"] for row in rows), several=bool(self._lesson.courses.further()),
            counts={state: _count(rows, state) for state in (CUTTING, STALLED)},
        )  # fmt: skip
        answer.headers["Refresh"] = "5"  # the page has no script that could ask
        return answer

    async def try_lesson(self, request: Request) -> Response:
        """Let the teacher cut as a learner without code, uncounted."""
        await run_in_threadpool(self._lesson.delete, TRIAL)
        await run_in_threadpool(self._lesson.store.add_code, TRIAL)
        await run_in_threadpool(self._lesson.put, [TRIAL], course=text_of(await request.form(), "course"))
        token = await run_in_threadpool(self._lesson.store.sign_in, TRIAL)
        return self._site.sign(RedirectResponse("../cut", 303), self._site.person_cookie, token)

    async def comment(self, request: Request) -> Response:
        """Write a comment to a person, or take one back."""
        form, code = await request.form(), request.path_params["code"]
        if back := text_of(form, "take_back"):
            await run_in_threadpool(self._lesson.store.take_back, back, code)
        else:
            await run_in_threadpool(self._lesson.store.comment, code, text_of(form, "said"))
        return RedirectResponse(f"../{code}", 303)

    async def sheet(self, request: Request) -> Response:
        """Show codes for printing, of everybody or one class."""
        store, chosen = self._lesson.store, request.query_params.get("class", "")
        codes, places = await run_in_threadpool(lambda: (store.codes(), store.places()))
        slips = [(code, places.get(code, Place()).class_name) for code, _ in codes]
        classes = sorted({name for _, name in slips if name})
        return self._site.page(
            "code_sheet.html",
            codes=[slip for slip in slips if not chosen or slip[1] == chosen],
            classes=classes,
            chosen=chosen,
            address=str(request.base_url),
            qr=functools.partial(qr_code, str(request.base_url)),
            here_alone=is_loopback(request.url.hostname or ""),
        )

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
        return HTMLResponse(await run_in_threadpool(self._lesson.card_page, code, number, self._site.language))

    async def remove(self, request: Request) -> Response:
        """Delete a person, with all cuts."""
        form = await request.form()
        code, again = (text_of(form, name).strip().upper() for name in ("code", "again"))
        if code != again:
            raise HTTPException(422, "The code was not typed a second time: nobody was deleted.")
        if not await run_in_threadpool(self._lesson.delete, code):
            raise HTTPException(404, "There is no such code.")
        return RedirectResponse("../teacher", 303)

    async def person(self, request: Request) -> Response:
        """Show a person's cuts."""
        code = request.path_params["code"]
        rows = (await run_in_threadpool(overview, self._lesson, self._site.language))["people"]
        codes = [row["code"] for row in rows]
        for row in (row for row in rows if row["code"] == code):
            k, comments = codes.index(code), await run_in_threadpool(self._lesson.store.comments, code)
            return self._site.page(
                "teacher_person.html", person=row, mark=row["mark"], root="../../", comments=comments,
                longest=LONGEST_COMMENT, before=codes[k - 1] if k else "", after="".join(codes[k + 1 : k + 2]),
            )  # fmt: skip
        raise HTTPException(404, "There is no such code.")

    async def example(self, request: Request) -> Response:
        """Show a person's cut as an example, or no longer."""
        form, code = await request.form(), request.path_params["code"]
        number, shown = text_of(form, "cut"), text_of(form, "shown") == "yes"
        await run_in_threadpool(self._lesson.store.set_example, number, code, shown)
        return RedirectResponse(f"../{code}", 303)

    async def place(self, request: Request) -> Response:
        """Put people into classes, groups and courses."""
        form = await request.form()
        codes = [str(code) for code in form.getlist("code")]
        if not codes:
            raise HTTPException(422, self._site.words["nobody_chosen"])
        given = {name: text_of(form, name).strip() for name in ("class_name", "group", "course")}
        new = {name: "" if text == "-" else text for name, text in given.items() if text}  # a dash takes out
        await run_in_threadpool(self._lesson.put, codes, **new)
        return RedirectResponse("../teacher", 303)

    async def cut_table(self, request: Request) -> Response:
        """Send a table of all cuts."""
        return download((await run_in_threadpool(self._lesson.table)).encode(), "cuts.csv", "text/csv")


def qr_code(address: str, code: str) -> str:
    """Return an SVG QR code of the sign-in address, "" without segno."""
    try:
        import segno  # an extra
    except ImportError:
        return ""
    made = segno.make(f"{address}?code={code}", error="m", micro=False)
    return str(made.svg_inline(scale=2, border=4, light="white", title=code))


def _count(rows: Sequence[Mapping[str, Any]], state: str) -> int:
    return sum(row["doing"] == state for row in rows)


_TYPES = {".html": "text/html", ".csv": "text/csv", ".json": "application/json"}


class StudyPages:
    """Pages and answers for studies and pass marks."""

    def __init__(self, site: ClassSite) -> None:
        self._site, self._lesson = site, site.lesson

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route = self._site.teachers_route
        return [
            route("GET", "/teacher/studies", self.studies), route("POST", "/teacher/studies", self.study),
            route("GET", "/teacher/studies/{number:str}", self.analysis),
            route("POST", "/teacher/studies/{number:str}/drop", self.drop_analysis),
            route("GET", "/teacher/studies/{number:str}/{name:str}", self.analysis_file),
            route("POST", "/teacher/pass-mark", self.set_mark),
        ]  # fmt: skip

    def studies_page(self, trouble: str = "", status: int = 200) -> Response:
        """Return the page of studies and pass marks."""
        places = self._lesson.store.places()
        everybody = [(code, places.get(code, Place()), cuts) for code, _, cuts in people_of(self._lesson)]
        counts: dict[str, int] = {}
        groups: dict[str, int] = {}
        for _, where, cuts in everybody:
            counts[where.class_name] = counts.get(where.class_name, 0) + 1
            if where.group:
                groups[where.group] = groups.get(where.group, 0) + any(cut.state == SAVED for cut in cuts)
        return self._site.page(
            "teacher_studies.html", status, trouble=trouble, classes=sorted(counts.items()),
            groups=sorted(groups.items()), marks=marks_in_force(self._lesson), analyses=self._lesson.analyses.all(),
            fewest=FEWEST_PEOPLE, root="../",
        )  # fmt: skip

    async def studies(self, request: Request) -> Response:
        """Show the page of studies and pass marks."""
        return await run_in_threadpool(self.studies_page)

    async def study(self, request: Request) -> Response:
        """Begin a study, or the setting of pass marks."""
        form = await request.form()
        try:
            made = await run_in_threadpool(_begun, self._site, form)
        except ValueError as error:
            return await run_in_threadpool(self.studies_page, str(error), 422)
        return RedirectResponse(f"studies/{made}", 303)

    async def analysis(self, request: Request) -> Response:
        """Show a study that is going on or done."""
        made = self._lesson.analyses.find(request.path_params["number"])
        state = made.state  # first of all: it may end while the page is made
        shown: dict[str, Any] = {"state": state, "said": made.said(), "files": made.files(), "marks": made.marks()}
        source = f"{made.title}, {date.today().isoformat()}"
        answer = self._site.page(
            "teacher_analysis.html",
            analysis=made,
            source=source,
            root="../../",
            in_force=marks_in_force(self._lesson),
            **shown,
        )
        if state in ("waiting", "working"):
            answer.headers["Refresh"] = "2"  # the page has no script that could ask
        return answer

    async def analysis_file(self, request: Request) -> Response:
        """Send a file of a study."""
        made = self._lesson.analyses.find(request.path_params["number"])
        name = request.path_params["name"]
        if name == "all.zip":
            return download(await run_in_threadpool(made.packed), f"{made.kind}.zip", "application/zip")
        if name not in made.files():
            raise HTTPException(404, "There is no such page.")
        path = made.files()[name]
        content = await run_in_threadpool(path.read_bytes)
        kind = _TYPES[path.suffix]
        return Response(content, media_type=kind) if kind == "text/html" else download(content, name, kind)

    async def drop_analysis(self, request: Request) -> Response:
        """Delete a study."""
        await run_in_threadpool(self._lesson.analyses.drop, request.path_params["number"])
        return RedirectResponse("../../studies", 303)

    async def set_mark(self, request: Request) -> Response:
        """Put a pass mark into force, or withdraw it."""
        form = await request.form()
        try:
            mark = None if form.get("withdraw") else _mark(form, self._site.words)
            if mark is None and not form.get("withdraw"):
                raise ValueError(self._site.words["no_mark"])
            source = text_of(form, "source") or self._site.words["mark_by_teacher"]
            known, course = await run_in_threadpool(marks_in_force, self._lesson), text_of(form, "course")
            course = course if course in known else next(iter(known))
            await run_in_threadpool(self._lesson.store.set_pass_mark, course, mark, source)
        except ValueError as error:
            return await run_in_threadpool(self.studies_page, str(error), 422)
        return RedirectResponse("studies", 303)


def _begun(site: ClassSite, form: FormData) -> str:
    """Begin a form's analysis; return its id, ValueError if impossible."""
    lesson, words = site.lesson, site.words
    kind = PASS_MARK_KIND if form.get("kind") == PASS_MARK_KIND else STUDY_KIND
    classes, codes = form.getlist("class"), form.getlist("code")
    passing, failing, mark = text_of(form, "passing"), text_of(form, "failing"), _mark(form, words)
    if passing and passing == failing:
        raise ValueError(words["same_group"])
    compared = (passing, failing) if passing and failing else None
    places = lesson.store.places()
    rows: list[StudiedRecord] = []
    course = text_of(form, "course")
    marks, marked = marks_in_force(lesson), []
    wanted = KEPT if form.get("foreign") else (SAVED,)
    for code, _, cuts in people_of(lesson):
        where = places.get(code, Place())
        chosen = code in codes if codes else where.class_name in classes
        own = lesson.course_of(code, where)
        chosen &= course in ("", name_of(own))
        if chosen and (compared is None or kind == STUDY_KIND or where.group in compared):
            group = where.group if compared else ""
            marked.append(marks.get(name_of(own)))
            rows += [
                StudiedRecord("" if cut.state == LEFT else f"{code}/{cut.record}", code, group)
                for cut in cuts
                if cut.task != WARM_UP and cut.state in (*wanted, LEFT) and (not course or cut.course == course)
            ]
    if not any(row.record for row in rows):
        raise ValueError(words["nobody_to_study"])
    options = ["--language", site.language]
    if kind == STUDY_KIND:
        options += ["--groups", passing, failing] if compared else []
        only = only_of(marked)
        mark = only.mark if mark is None and only is not None else mark
    else:
        grouped = {(row.group, row.code) for row in rows if row.record}
        people = {group: sum(of == group for of, _ in grouped) for group in compared or ()}
        if mark is None and (compared is None or min(people.values()) < FEWEST_PEOPLE):
            there = ", ".join(f"{group} {count}" for group, count in people.items()) or "–"
            raise ValueError(words["too_few"].format(fewest=FEWEST_PEOPLE, there=there))
        options += [f"--passing={passing}", f"--failing={failing}"] if compared else []
    options += [] if mark is None else [f"--mark={mark:g}"]
    title = ", ".join(map(str, codes or filter(None, classes))) or words["class"]
    return lesson.analyses.start(kind, title, rows, options).id


def _mark(form: FormData, words: Mapping[str, str]) -> float | None:
    text = text_of(form, "mark").strip().replace(",", ".")
    if not text:
        return None
    if not re.fullmatch(r"\d{1,3}(\.\d{1,3})?", text) or float(text) > 100.0:
        raise ValueError(words["no_mark"])
    return float(text)


class UploadPages:
    """Pages and answers for records of other programs."""

    def __init__(self, site: ClassSite) -> None:
        self._site, self._lesson = site, site.lesson

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route, staged = self._site.teachers_route, UPLOAD_PATH + "/{number:str}"
        return [
            route("GET", UPLOAD_PATH, self.upload_form), route("POST", UPLOAD_PATH, self.upload),
            route("GET", staged, self.staged_form), route("POST", staged, self.pick),
        ]  # fmt: skip

    def upload_page(self, upload: Any, status: int = 200, **values: Any) -> Response:
        """Return the page on which records are sent and read."""
        form = values.pop("form", None) or (upload.guess if upload else {})
        filled = {"trouble": "", "cuts": [], "notes": [], "kept": []} | values
        filled["pictures"] = [embedded_figure(record_figure(each)) for each in values.get("pictures", ())]
        codes = [code for code, _ in self._lesson.store.codes()]
        root = "../../" if upload else "../"
        return self._site.page(
            "teacher_upload.html", status, upload=upload, form=form, codes=codes, picked=PICKED, units=units_by_field(),
            root=root, **filled,
        )  # fmt: skip

    async def upload_form(self, request: Request) -> Response:
        """Show the page on which records are sent."""
        return await run_in_threadpool(self.upload_page, None)

    async def upload(self, request: Request) -> Response:
        """Take files."""
        form = await request.form(max_files=32, max_fields=8)
        given = [each for each in form.getlist("record") if isinstance(each, UploadFile) and each.filename]
        try:
            files = [(str(each.filename), await each.read()) for each in given]
            staged = await run_in_threadpool(self._lesson.uploads.add, files)
        except ValueError as error:
            return await run_in_threadpool(self.upload_page, None, 422, trouble=str(error))
        return RedirectResponse(f"upload/{staged.id}", 303)

    async def staged_form(self, request: Request) -> Response:
        """Show files that were sent."""
        return await run_in_threadpool(self.upload_page, self._lesson.uploads.find(request.path_params["number"]))

    async def pick(self, request: Request) -> Response:
        """Read uploaded cuts by the form, and save or drop them."""
        staged = self._lesson.uploads.find(request.path_params["number"])
        given = await request.form()
        form = {name: text_of(given, name) for name in given}
        if form.get("do") == "drop":
            await run_in_threadpool(self._lesson.uploads.drop, staged.id)
            return RedirectResponse("../upload", 303)
        try:
            target = picked_length(form)
            cuts, notes, pictures = await run_in_threadpool(staged.read, form)
            if form.get("do") != "keep":
                shown: dict[str, Any] = {"cuts": cuts, "notes": notes, "pictures": pictures[:_MOST_PICTURES]}
                return await run_in_threadpool(self.upload_page, staged, form=form, **shown)
            if form.get("consent") != "yes":
                raise ValueError(self._site.words["no_consent"])
            sound = [cut.trace for cut in cuts if not cut.flaw]
            if not sound:
                raise ValueError(self._site.words["no_sound_cut"])
            code = form.get("code", "")
            for trace in sound:
                await run_in_threadpool(self._lesson.add_foreign, code, trace, target)
        except ValueError as error:
            return await run_in_threadpool(self.upload_page, staged, 422, form=form, trouble=str(error))
        await run_in_threadpool(self._lesson.uploads.drop, staged.id)
        return RedirectResponse(f"../people/{code}", 303)
