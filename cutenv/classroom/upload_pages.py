"""The teacher's pages for records of other programs."""

from __future__ import annotations

from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from cutenv.classroom.class_site import ClassSite, text_of
from cutenv.classroom.foreign_upload import PICKED, picked_length, units_by_field
from cutenv.classroom.request_guard import UPLOAD_PATH


class UploadPages:
    """Pages and answers for records of other programs.

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
        route, staged = self._site.teachers_route, UPLOAD_PATH + "/{number:str}"
        return [
            route("GET", UPLOAD_PATH, self.upload_form), route("POST", UPLOAD_PATH, self.upload),
            route("GET", staged, self.staged_form), route("POST", staged, self.pick),
        ]  # fmt: skip

    def upload_page(self, upload: Any, status: int = 200, **values: Any) -> Response:
        """Return the page on which records are sent and read."""
        form = values.pop("form", None) or (upload.guess if upload else {})
        filled = {"trouble": "", "cuts": [], "notes": [], "kept": []} | values
        codes = [code for code, _ in self._lesson.store.codes()]
        root = "../../" if upload else "../"
        return self._site.page(
            "upload.html", status, upload=upload, form=form, codes=codes, picked=PICKED, units=units_by_field(),
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
        """Read the cuts of files as the form says, keep or drop them."""
        staged = self._lesson.uploads.find(request.path_params["number"])
        given = await request.form()
        form = {name: text_of(given, name) for name in given}
        if form.get("do") == "drop":
            await run_in_threadpool(self._lesson.uploads.drop, staged.id)
            return RedirectResponse("../upload", 303)
        try:
            target = picked_length(form)
            cuts, notes = await run_in_threadpool(staged.read, form)
            if form.get("do") != "keep":
                return await run_in_threadpool(self.upload_page, staged, form=form, cuts=cuts, notes=notes)
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
