"""Teacher's pages: people, codes, records, studies, pass marks, uploads."""

from __future__ import annotations

import functools
import hmac
import re
import time
from collections import Counter
from collections.abc import Mapping
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
from cutenv.people.classroom.class_site import UPLOAD_PATH, ClassSite, Pages, Trials, download, text_of
from cutenv.people.classroom.class_store import LONGEST_COMMENT, Place
from cutenv.people.classroom.class_tables import KEPT, LEFT, SAVED, TRIAL
from cutenv.people.classroom.foreign_upload import PICKED, Upload, picked_length
from cutenv.people.classroom.host_names import is_loopback
from cutenv.people.classroom.lesson import name_of
from cutenv.people.classroom.live_rig import LiveRig
from cutenv.people.play.course import WARM_UP
from cutenv.records.schema import FIELD_UNITS
from cutenv.records.scoring.study.estimate import FEWEST_PEOPLE

_MOST_CODES = 500
_MOST_PICTURES = 12
_TICKET_LASTS = 60.0  # [s]


class TeacherPages(Pages):
    """Pages and answers for the teacher."""

    def __init__(self, site: ClassSite, *, ticket: str | None = None, live: LiveRig | None = None) -> None:
        super().__init__(site)
        self._live, self._trials = live, Trials()
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
        return await run_in_threadpool(self._site.sign_in, self._site.teacher_name, "teacher")

    async def open_once(self, request: Request) -> Response:
        """Sign the teacher in by the ticket, once."""
        given, ticket = request.path_params["ticket"].encode(), self._ticket
        late = time.monotonic() > self._opened + _TICKET_LASTS
        if ticket is None or late or not hmac.compare_digest(given, ticket.encode()):
            return RedirectResponse("../../teacher", 303)
        self._ticket = None
        return await run_in_threadpool(self._site.sign_in, self._site.teacher_name, "../../teacher")

    def leave_everywhere(self, _: Request, __: FormData) -> Response:
        """Sign the teacher out wherever the token was used."""
        self._lesson.store.sign_out_everywhere(self._site.teacher_name)
        return RedirectResponse("../teacher", 303)

    def add_codes(self, _: Request, form: FormData) -> Response:
        """Make codes for people."""
        count, class_name = str(form.get("count", "")), str(form.get("class_name", "")).strip()
        course = text_of(form, "course")
        if not (count.isascii() and count.isdecimal()) or not 1 <= int(count) <= _MOST_CODES:
            raise HTTPException(422, f"count = {count!r} is outside 1 to {_MOST_CODES}. Give how many codes.")
        self._lesson.put([], class_name=class_name, course=course)  # a bad one makes no codes
        self._lesson.put(self._lesson.store.add_codes(int(count)), class_name=class_name, course=course)
        return RedirectResponse("../teacher", 303)

    def live_people(self, request: Request, _: FormData) -> Response:
        """Show what everybody does now; the page looks again by itself."""
        by, chosen = request.query_params.get("by", "doing"), request.query_params.get("class", "")
        rows = live_list(self._lesson, self._site.language, by=by, class_name=chosen or None)
        classes = sorted({place.class_name for place in self._lesson.store.places().values() if place.class_name})
        answer = self._site.page(
            "teacher_live.html", rows=rows, by=by, orders=LIVE_ORDERS, classes=classes, chosen=chosen, root="../",
            course=any(row["course"] for row in rows), several=bool(self._lesson.courses.further()),
            counts={state: sum(row["doing"] == state for row in rows) for state in (CUTTING, STALLED)},
        )  # fmt: skip
        answer.headers["Refresh"] = "5"  # the page has no script that could ask
        return answer

    def try_lesson(self, _: Request, form: FormData) -> Response:
        """Let the teacher cut as a learner without code, uncounted."""
        self._lesson.delete(TRIAL)
        self._lesson.store.add_code(TRIAL)
        self._lesson.put([TRIAL], course=text_of(form, "course"))
        return self._site.sign_in(TRIAL, "../cut")

    def comment(self, request: Request, form: FormData) -> Response:
        """Write a comment to a person, or take one back."""
        code = request.path_params["code"]
        if back := text_of(form, "take_back"):
            self._lesson.store.take_back(back, code)
        else:
            self._lesson.store.comment(code, text_of(form, "said"))
        return RedirectResponse(f"../{code}", 303)

    def sheet(self, request: Request, _: FormData) -> Response:
        """Show codes for printing, of everybody or one class."""
        chosen, places = request.query_params.get("class", ""), self._lesson.store.places()
        slips = [(code, places.get(code, Place()).class_name) for code, _ in self._lesson.store.codes()]
        address = str(request.base_url)
        return self._site.page(
            "code_sheet.html",
            codes=[slip for slip in slips if not chosen or slip[1] == chosen],
            classes=sorted({name for _, name in slips if name}),
            chosen=chosen,
            address=address,
            qr=functools.partial(qr_code, address),
            here_alone=is_loopback(request.url.hostname or ""),
        )

    def records(self, request: Request, _: FormData) -> Response:
        """Send all records, or those of one person, packed."""
        code = request.path_params.get("code")
        if code is not None and not self._lesson.store.knows(code):
            raise HTTPException(404, "There is no such code.")
        return download(self._lesson.records(code), f"{code or 'records'}.zip", "application/zip")

    def card(self, request: Request, _: FormData) -> Response:
        """Show the score card of a cut."""
        code, number = request.path_params["code"], request.path_params["number"]
        return HTMLResponse(self._lesson.card_page(code, number, self._site.language))

    def remove(self, _: Request, form: FormData) -> Response:
        """Delete a person, with all cuts."""
        code, again = (text_of(form, name).strip().upper() for name in ("code", "again"))
        if code != again:
            raise HTTPException(422, "The code was not typed a second time: nobody was deleted.")
        if not self._lesson.delete(code):
            raise HTTPException(404, "There is no such code.")
        return RedirectResponse("../teacher", 303)

    def person(self, request: Request, _: FormData) -> Response:
        """Show a person's cuts."""
        code, rows = request.path_params["code"], overview(self._lesson, self._site.language)["people"]
        codes = [row["code"] for row in rows]
        if code not in codes:
            raise HTTPException(404, "There is no such code.")
        k = codes.index(code)
        return self._site.page(
            "teacher_person.html", person=rows[k], mark=rows[k]["mark"], root="../../", longest=LONGEST_COMMENT,
            comments=self._lesson.store.comments(code), before=codes[k - 1] if k else "",
            after="".join(codes[k + 1 : k + 2]),
        )  # fmt: skip

    def example(self, request: Request, form: FormData) -> Response:
        """Show a person's cut as an example, or no longer."""
        code = request.path_params["code"]
        self._lesson.store.set_example(text_of(form, "cut"), code, text_of(form, "shown") == "yes")
        return RedirectResponse(f"../{code}", 303)

    def place(self, _: Request, form: FormData) -> Response:
        """Put people into classes, groups and courses."""
        codes = [str(code) for code in form.getlist("code")]
        if not codes:
            raise HTTPException(422, self._site.words["nobody_chosen"])
        given = {name: text_of(form, name).strip() for name in ("class_name", "group", "course")}
        new = {name: "" if text == "-" else text for name, text in given.items() if text}  # a dash takes out
        self._lesson.put(codes, **new)
        return RedirectResponse("../teacher", 303)

    def cut_table(self, _: Request, __: FormData) -> Response:
        """Send a table of all cuts."""
        return download(self._lesson.table().encode(), "cuts.csv", "text/csv")


def qr_code(address: str, code: str) -> str:
    """Return an SVG QR code of the sign-in address, "" without segno."""
    try:
        import segno  # an extra
    except ImportError:
        return ""
    made = segno.make(f"{address}?code={code}", error="m", micro=False)
    return str(made.svg_inline(scale=2, border=4, light="white", title=code))


_TYPES = {".html": "text/html", ".csv": "text/csv", ".json": "application/json"}


class StudyPages(Pages):
    """Pages and answers for studies and pass marks."""

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route = self._site.teachers_route
        return [
            route("GET", "/teacher/studies", lambda *_: self.studies_page()),
            route("POST", "/teacher/studies", self.study),
            route("GET", "/teacher/studies/{number:str}", self.analysis),
            route("POST", "/teacher/studies/{number:str}/drop", self.drop_analysis),
            route("GET", "/teacher/studies/{number:str}/{name:str}", self.analysis_file),
            route("POST", "/teacher/pass-mark", self.set_mark),
        ]  # fmt: skip

    def studies_page(self, trouble: str = "") -> Response:
        """Return the page of studies and pass marks."""
        places = self._lesson.store.places()
        everybody = [(places.get(code, Place()), cuts) for code, _, cuts in people_of(self._lesson)]
        classes = Counter(where.class_name for where, _ in everybody)
        groups = {where.group: 0 for where, _ in everybody if where.group}
        for where, cuts in everybody:
            if where.group:
                groups[where.group] += any(cut.state == SAVED for cut in cuts)
        return self._site.page(
            "teacher_studies.html", 422 if trouble else 200, trouble=trouble, classes=sorted(classes.items()),
            groups=sorted(groups.items()), marks=marks_in_force(self._lesson), analyses=self._lesson.analyses.all(),
            fewest=FEWEST_PEOPLE, root="../",
        )  # fmt: skip

    def study(self, _: Request, form: FormData) -> Response:
        """Begin a study, or the setting of pass marks."""
        try:
            return RedirectResponse(f"studies/{_begun(self._site, form)}", 303)
        except ValueError as error:
            return self.studies_page(str(error))

    def analysis(self, request: Request, _: FormData) -> Response:
        """Show a study that is going on or done."""
        made = self._lesson.analyses.find(request.path_params["number"])
        state = made.state  # first of all: it may end while the page is made
        answer = self._site.page(
            "teacher_analysis.html", analysis=made, state=state, said=made.said(), files=made.files(),
            marks=made.marks(), source=f"{made.title}, {date.today().isoformat()}", root="../../",
            in_force=marks_in_force(self._lesson),
        )  # fmt: skip
        if state in ("waiting", "working"):
            answer.headers["Refresh"] = "2"  # the page has no script that could ask
        return answer

    def analysis_file(self, request: Request, _: FormData) -> Response:
        """Send a file of a study."""
        made, name = self._lesson.analyses.find(request.path_params["number"]), request.path_params["name"]
        if name == "all.zip":
            return download(made.packed(), f"{made.kind}.zip", "application/zip")
        if name not in made.files():
            raise HTTPException(404, "There is no such page.")
        path = made.files()[name]
        content, kind = path.read_bytes(), _TYPES[path.suffix]
        return Response(content, media_type=kind) if kind == "text/html" else download(content, name, kind)

    def drop_analysis(self, request: Request, _: FormData) -> Response:
        """Delete a study."""
        self._lesson.analyses.drop(request.path_params["number"])
        return RedirectResponse("../../studies", 303)

    def set_mark(self, _: Request, form: FormData) -> Response:
        """Put a pass mark into force, or withdraw it."""
        try:
            mark = None if form.get("withdraw") else _mark(form, self._site.words)
            if mark is None and not form.get("withdraw"):
                raise ValueError(self._site.words["no_mark"])
            source = text_of(form, "source") or self._site.words["mark_by_teacher"]
            known, course = marks_in_force(self._lesson), text_of(form, "course")
            self._lesson.store.set_pass_mark(course if course in known else next(iter(known)), mark, source)
        except ValueError as error:
            return self.studies_page(str(error))
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


class UploadPages(Pages):
    """Pages and answers for records of other programs."""

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route, staged = self._site.teachers_route, UPLOAD_PATH + "/{number:str}"
        return [
            route("GET", UPLOAD_PATH, lambda *_: self.upload_page(None)),
            route("POST", UPLOAD_PATH, self.upload, max_files=32, max_fields=8),
            route("GET", staged, lambda request, _: self.upload_page(self._staged(request))),
            route("POST", staged, self.pick),
        ]  # fmt: skip

    def _staged(self, request: Request) -> Upload:
        return self._lesson.uploads.find(request.path_params["number"])

    def upload_page(self, upload: Upload | None, *, trouble: str = "", **values: Any) -> Response:
        """Return the page on which records are sent and read."""
        form = values.pop("form", None) or (upload.guess if upload else {})
        filled = {"cuts": [], "notes": [], "kept": []} | values
        filled["pictures"] = [embedded_figure(record_figure(each)) for each in values.get("pictures", ())]
        return self._site.page(
            "teacher_upload.html", 422 if trouble else 200, trouble=trouble, upload=upload, form=form, picked=PICKED,
            codes=[code for code, _ in self._lesson.store.codes()], units={each: FIELD_UNITS[each] for each in PICKED},
            root="../../" if upload else "../", **filled,
        )  # fmt: skip

    def upload(self, _: Request, form: FormData) -> Response:
        """Take files."""
        given = [each for each in form.getlist("record") if isinstance(each, UploadFile) and each.filename]
        try:
            staged = self._lesson.uploads.add([(str(each.filename), each.file.read()) for each in given])
        except ValueError as error:
            return self.upload_page(None, trouble=str(error))
        return RedirectResponse(f"upload/{staged.id}", 303)

    def pick(self, request: Request, given: FormData) -> Response:
        """Read uploaded cuts by the form, and save or drop them."""
        staged, form = self._staged(request), {name: text_of(given, name) for name in given}
        if form.get("do") == "drop":
            self._lesson.uploads.drop(staged.id)
            return RedirectResponse("../upload", 303)
        code = form.get("code", "")
        try:
            target = picked_length(form)
            cuts, notes, pictures = staged.read(form)
            if form.get("do") != "keep":
                return self.upload_page(staged, form=form, cuts=cuts, notes=notes, pictures=pictures[:_MOST_PICTURES])
            if form.get("consent") != "yes":
                raise ValueError(self._site.words["no_consent"])
            sound = [cut.trace for cut in cuts if not cut.flaw]
            if not sound:
                raise ValueError(self._site.words["no_sound_cut"])
            for trace in sound:
                self._lesson.add_foreign(code, trace, target)
        except ValueError as error:
            return self.upload_page(staged, form=form, trouble=str(error))
        self._lesson.uploads.drop(staged.id)
        return RedirectResponse(f"../people/{code}", 303)
