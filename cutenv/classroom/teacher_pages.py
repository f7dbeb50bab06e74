"""The teacher's pages beyond the list of the class: people, groups, studies, pass marks, records of other programs."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from datetime import date
from typing import Any, Protocol

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route

from cutenv.classroom.analysis import PASS_MARK_KIND, STUDY_KIND, StudiedRecord
from cutenv.classroom.class_store import KEPT, SAVED, HandedOutCut, MarkInForce, Place
from cutenv.classroom.foreign_upload import PICKED, picked_length, units_by_field
from cutenv.classroom.lesson import Lesson
from cutenv.classroom.score_curve import score_curve
from cutenv.scoring.study import proficiency
from cutenv.scoring.study.estimate import FEWEST_PEOPLE

UPLOAD_PATH = "/teacher/upload"
"""Path to which files are sent."""
_TYPES = {".html": "text/html", ".csv": "text/csv", ".json": "application/json"}


class ShownPage(Protocol):
    """Answer with a page: template, status, and the template's values."""

    def __call__(self, name: str, status: int = 200, **values: Any) -> HTMLResponse:
        """Return the page."""
        ...


def overview(lesson: Lesson, language: str) -> dict[str, Any]:
    """Return what the list of the class shows, in a language: people, a curve for each class, and the pass mark."""
    mark, places = lesson.pass_mark, lesson.store.places()
    rows = [_person(lesson, language, mark, places.get(each[0], Place()), *each) for each in _people(lesson)]
    classes = sorted({row["place"].class_name for row in rows})
    curves = {
        name: score_curve(
            [row["scores"] for row in rows if row["place"].class_name == name and row["scores"]],
            mark=None if mark is None else mark.mark,
        )
        for name in classes
    }
    return {"people": rows, "mark": mark, "course": lesson.course_name} | {
        "curves": {name: curve for name, curve in curves.items() if curve}
    }


def _people(lesson: Lesson) -> list[tuple[str, bool, list[HandedOutCut]]]:
    by_code: dict[str, list[HandedOutCut]] = {}
    for cut in lesson.store.cuts():
        by_code.setdefault(cut.code, []).append(cut)
    return [(code, consented, by_code.get(code, [])) for code, consented in lesson.store.codes()]


def _person(
    lesson: Lesson,
    language: str,
    mark: MarkInForce | None,
    place: Place,
    code: str,
    consented: bool,
    cuts: Sequence[HandedOutCut],
) -> dict[str, Any]:
    progress = lesson.progress(code)
    confirmed = [cut.score for cut in cuts if cut.state == SAVED]
    scored = [score for score in confirmed if score is not None]
    found = proficiency(scored, mark.mark, better="higher") if mark is not None and scored else None
    return {
        "code": code,
        "consented": consented,
        "cuts": cuts,
        "place": place,
        "scores": confirmed,
        "passes": found,
        "curve": score_curve([confirmed], mark=None if mark is None else mark.mark) if confirmed else "",
        "ahead": "" if progress is None else progress.ahead(language),
    }


def teacher_routes(
    lesson: Lesson,
    teacher: Callable[[Request], Awaitable[None]],
    page: ShownPage,
    words: Mapping[str, str],
    language: str,
) -> list[Route]:
    """Return the routes of these pages.

    Parameters
    ----------
    lesson : Lesson
        The class at work.
    teacher : callable
        Check that raises HTTPException if a request is not the teacher's.
    page : callable
        Answer with a page.
    words : mapping of str to str
        Words of the class's language.
    language : {"en", "de"}
        That language.
    """
    uploads = lesson.uploads

    async def person(request: Request) -> Response:
        code = request.path_params["code"]
        rows = (await run_in_threadpool(overview, lesson, language))["people"]
        for row in (row for row in rows if row["code"] == code):
            return page("person.html", person=row, mark=lesson.pass_mark, root="../../")
        raise HTTPException(404, "There is no such code.")

    async def place(request: Request) -> Response:
        form = await request.form()
        codes = [str(code) for code in form.getlist("code")]
        if not codes:
            raise HTTPException(422, words["nobody_chosen"])
        given = {name: _text(form, name).strip() for name in ("class_name", "group")}
        new = {name: "" if text == "-" else text for name, text in given.items() if text}  # a dash takes out
        await run_in_threadpool(lesson.store.put, codes, **new)
        return RedirectResponse("../teacher", 303)

    async def cut_table(request: Request) -> Response:
        return _download((await run_in_threadpool(lesson.table)).encode(), "cuts.csv", "text/csv")

    # Studies and pass marks

    def studies_page(trouble: str = "", status: int = 200) -> Response:
        places = lesson.store.places()
        everybody = [(code, places.get(code, Place()), cuts) for code, _, cuts in _people(lesson)]
        counts: dict[str, int] = {}
        groups: dict[str, int] = {}
        for _, where, cuts in everybody:
            counts[where.class_name] = counts.get(where.class_name, 0) + 1
            if where.group:
                groups[where.group] = groups.get(where.group, 0) + any(cut.state == SAVED for cut in cuts)
        return page(
            "studies.html", status, trouble=trouble, classes=sorted(counts.items()), groups=sorted(groups.items()),
            mark=lesson.pass_mark, course=lesson.course_name, analyses=lesson.analyses.all(), fewest=FEWEST_PEOPLE,
            root="../",
        )  # fmt: skip

    async def studies(request: Request) -> Response:
        return await run_in_threadpool(studies_page)

    async def study(request: Request) -> Response:
        form = await request.form()
        try:
            made = await run_in_threadpool(_begun, lesson, form, words, language)
        except ValueError as error:
            return await run_in_threadpool(studies_page, str(error), 422)
        return RedirectResponse(f"studies/{made}", 303)

    async def analysis(request: Request) -> Response:
        made = lesson.analyses.find(request.path_params["number"])
        state = made.state  # first of all: it may end while the page is made
        shown: dict[str, Any] = {"state": state, "said": made.said(), "files": made.files(), "marks": made.marks()}
        source = f"{made.title}, {date.today().isoformat()}"
        answer = page("analysis.html", analysis=made, source=source, root="../../", mark=lesson.pass_mark, **shown)
        if state in ("waiting", "working"):
            answer.headers["Refresh"] = "2"  # the page has no script that could ask
        return answer

    async def analysis_file(request: Request) -> Response:
        made = lesson.analyses.find(request.path_params["number"])
        name = request.path_params["name"]
        if name == "all.zip":
            return _download(await run_in_threadpool(made.packed), f"{made.kind}.zip", "application/zip")
        if name not in made.files():
            raise HTTPException(404, "There is no such page.")
        path = made.files()[name]
        content = await run_in_threadpool(path.read_bytes)
        kind = _TYPES[path.suffix]
        return Response(content, media_type=kind) if kind == "text/html" else _download(content, name, kind)

    async def drop_analysis(request: Request) -> Response:
        await run_in_threadpool(lesson.analyses.drop, request.path_params["number"])
        return RedirectResponse("../../studies", 303)

    async def set_mark(request: Request) -> Response:
        form = await request.form()
        try:
            mark = None if form.get("withdraw") else _mark(form, words)
            if mark is None and not form.get("withdraw"):
                raise ValueError(words["no_mark"])
            source = _text(form, "source") or words["mark_by_teacher"]
            await run_in_threadpool(lesson.store.set_pass_mark, lesson.course_name, mark, source)
        except ValueError as error:
            return await run_in_threadpool(studies_page, str(error), 422)
        return RedirectResponse("studies", 303)

    # Records of other programs

    def upload_page(upload: Any, status: int = 200, **values: Any) -> Response:
        form = values.pop("form", None) or (upload.guess if upload else {})
        filled = {"trouble": "", "cuts": [], "notes": [], "kept": []} | values
        codes = [code for code, _ in lesson.store.codes()]
        root = "../../" if upload else "../"
        return page(
            "upload.html", status, upload=upload, form=form, codes=codes, picked=PICKED, units=units_by_field(),
            root=root, **filled,
        )  # fmt: skip

    async def upload_form(request: Request) -> Response:
        return await run_in_threadpool(upload_page, None)

    async def upload(request: Request) -> Response:
        form = await request.form(max_files=32, max_fields=8)
        given = [each for each in form.getlist("record") if isinstance(each, UploadFile) and each.filename]
        try:
            files = [(str(each.filename), await each.read()) for each in given]
            staged = await run_in_threadpool(uploads.add, files)
        except ValueError as error:
            return await run_in_threadpool(upload_page, None, 422, trouble=str(error))
        return RedirectResponse(f"upload/{staged.id}", 303)

    async def staged_form(request: Request) -> Response:
        return await run_in_threadpool(upload_page, uploads.find(request.path_params["number"]))

    async def pick(request: Request) -> Response:
        staged = uploads.find(request.path_params["number"])
        given = await request.form()
        form = {name: _text(given, name) for name in given}
        if form.get("do") == "drop":
            await run_in_threadpool(uploads.drop, staged.id)
            return RedirectResponse("../upload", 303)
        try:
            target = picked_length(form)
            cuts, notes = await run_in_threadpool(staged.read, form)
            if form.get("do") != "keep":
                return await run_in_threadpool(upload_page, staged, form=form, cuts=cuts, notes=notes)
            if form.get("consent") != "yes":
                raise ValueError(words["no_consent"])
            sound = [cut.trace for cut in cuts if not cut.flaw]
            if not sound:
                raise ValueError(words["no_sound_cut"])
            code = form.get("code", "")
            for trace in sound:
                await run_in_threadpool(lesson.add_foreign, code, trace, target)
        except ValueError as error:
            return await run_in_threadpool(upload_page, staged, 422, form=form, trouble=str(error))
        await run_in_threadpool(uploads.drop, staged.id)
        return RedirectResponse(f"../people/{code}", 303)

    def guarded(answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
        async def checked(request: Request) -> Response:
            await teacher(request)
            try:
                return await answer(request)
            except LookupError as error:
                raise HTTPException(404, str(error)) from None
            except ValueError as error:
                raise HTTPException(422, str(error)) from None

        return checked

    def route(method: str, path: str, answer: Callable[[Request], Awaitable[Response]]) -> Route:
        return Route(path, guarded(answer), methods=[method])

    return [
        route("POST", "/teacher/places", place), route("GET", "/teacher/cuts.csv", cut_table),
        route("GET", "/teacher/people/{code:str}", person),
        route("GET", "/teacher/studies", studies), route("POST", "/teacher/studies", study),
        route("GET", "/teacher/studies/{number:str}", analysis),
        route("POST", "/teacher/studies/{number:str}/drop", drop_analysis),
        route("GET", "/teacher/studies/{number:str}/{name:str}", analysis_file),
        route("POST", "/teacher/pass-mark", set_mark),
        route("GET", UPLOAD_PATH, upload_form), route("POST", UPLOAD_PATH, upload),
        route("GET", UPLOAD_PATH + "/{number:str}", staged_form), route("POST", UPLOAD_PATH + "/{number:str}", pick),
    ]  # fmt: skip


def _begun(lesson: Lesson, form: FormData, words: Mapping[str, str], language: str) -> str:
    """Begin the study or the setting of pass marks that a form asks for; return its id, ValueError if it cannot be."""
    kind = PASS_MARK_KIND if form.get("kind") == PASS_MARK_KIND else STUDY_KIND
    classes, codes = form.getlist("class"), form.getlist("code")
    passing, failing, mark = _text(form, "passing"), _text(form, "failing"), _mark(form, words)
    if passing and passing == failing:
        raise ValueError(words["same_group"])
    compared = (passing, failing) if passing and failing else None
    places = lesson.store.places()
    rows: list[StudiedRecord] = []
    wanted = KEPT if form.get("foreign") else (SAVED,)
    for code, _, cuts in _people(lesson):
        where = places.get(code, Place())
        chosen = code in codes if codes else where.class_name in classes
        if chosen and (compared is None or kind == STUDY_KIND or where.group in compared):
            group = where.group if compared else ""
            rows += [StudiedRecord(f"{code}/{cut.record}", code, group) for cut in cuts if cut.state in wanted]
    if not rows:
        raise ValueError(words["nobody_to_study"])
    options = ["--language", language]
    if kind == STUDY_KIND:
        options += ["--groups", passing, failing] if compared else []
        mark = mark if mark is not None else lesson.pass_mark.mark if lesson.pass_mark else None
    else:
        people = {group: len({row.code for row in rows if row.group == group}) for group in compared or ()}
        if mark is None and (compared is None or min(people.values()) < FEWEST_PEOPLE):
            there = ", ".join(f"{group} {count}" for group, count in people.items()) or "–"
            raise ValueError(words["too_few"].format(fewest=FEWEST_PEOPLE, there=there))
        options += [f"--passing={passing}", f"--failing={failing}"] if compared else []
    options += [] if mark is None else [f"--mark={mark:g}"]
    title = ", ".join(map(str, codes or filter(None, classes))) or words["class"]
    return lesson.analyses.start(kind, title, rows, options).id


def _mark(form: FormData, words: Mapping[str, str]) -> float | None:
    text = _text(form, "mark").strip().replace(",", ".")
    if not text:
        return None
    if not re.fullmatch(r"\d{1,3}(\.\d{1,3})?", text) or float(text) > 100.0:
        raise ValueError(words["no_mark"])
    return float(text)


def _text(form: FormData, name: str) -> str:
    value = form.get(name, "")
    return value if isinstance(value, str) else ""


def _download(content: bytes, name: str, kind: str) -> Response:
    return Response(content, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'})
