"""The teacher's pages of studies and pass marks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import date
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from cutenv.classroom.analysis import PASS_MARK_KIND, STUDY_KIND, StudiedRecord
from cutenv.classroom.class_overview import people_of
from cutenv.classroom.class_site import ClassSite, download, text_of
from cutenv.classroom.class_store import KEPT, SAVED, Place
from cutenv.scoring.study.estimate import FEWEST_PEOPLE

_TYPES = {".html": "text/html", ".csv": "text/csv", ".json": "application/json"}


class StudyPages:
    """Pages and answers for studies and pass marks.

    Parameters
    ----------
    site : ClassSite
        Site of the class.
    """

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
            "studies.html", status, trouble=trouble, classes=sorted(counts.items()), groups=sorted(groups.items()),
            mark=self._lesson.pass_mark, course=self._lesson.course_name, analyses=self._lesson.analyses.all(),
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
            "analysis.html", analysis=made, source=source, root="../../", mark=self._lesson.pass_mark, **shown
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
            await run_in_threadpool(self._lesson.store.set_pass_mark, self._lesson.course_name, mark, source)
        except ValueError as error:
            return await run_in_threadpool(self.studies_page, str(error), 422)
        return RedirectResponse("studies", 303)


def _begun(site: ClassSite, form: FormData) -> str:
    """Begin the study or the setting of pass marks that a form asks for; return its id, ValueError if it cannot be."""
    lesson, words = site.lesson, site.words
    kind = PASS_MARK_KIND if form.get("kind") == PASS_MARK_KIND else STUDY_KIND
    classes, codes = form.getlist("class"), form.getlist("code")
    passing, failing, mark = text_of(form, "passing"), text_of(form, "failing"), _mark(form, words)
    if passing and passing == failing:
        raise ValueError(words["same_group"])
    compared = (passing, failing) if passing and failing else None
    places = lesson.store.places()
    rows: list[StudiedRecord] = []
    wanted = KEPT if form.get("foreign") else (SAVED,)
    for code, _, cuts in people_of(lesson):
        where = places.get(code, Place())
        chosen = code in codes if codes else where.class_name in classes
        if chosen and (compared is None or kind == STUDY_KIND or where.group in compared):
            group = where.group if compared else ""
            rows += [StudiedRecord(f"{code}/{cut.record}", code, group) for cut in cuts if cut.state in wanted]
    if not rows:
        raise ValueError(words["nobody_to_study"])
    options = ["--language", site.language]
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
    text = text_of(form, "mark").strip().replace(",", ".")
    if not text:
        return None
    if not re.fullmatch(r"\d{1,3}(\.\d{1,3})?", text) or float(text) > 100.0:
        raise ValueError(words["no_mark"])
    return float(text)
