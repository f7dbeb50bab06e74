"""Web server of a class: pages for people who cut, and for their teacher; no page asks another host for anything."""

from __future__ import annotations

import secrets
import sys

from sqlalchemy.exc import SQLAlchemyError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from cutenv.classroom.class_site import ClassSite
from cutenv.classroom.live_rig import LiveRig, live_routes
from cutenv.classroom.people_pages import PeoplePages
from cutenv.classroom.request_guard import Guard, Trials
from cutenv.classroom.study_pages import StudyPages
from cutenv.classroom.teacher_pages import TeacherPages
from cutenv.classroom.upload_pages import UploadPages


def class_app(
    site: ClassSite, teacher_token: str, *, live: LiveRig | None = None, ticket: str | None = None
) -> Starlette:
    """Return the ASGI application of a class.

    Parameters
    ----------
    site : ClassSite
        Site of the class.
    teacher_token : str
        Secret with which the teacher signs in.
    live : LiveRig, optional
        Rig that the teacher may watch.
    ticket : str, optional
        Secret that signs the teacher in once, by the address ``teacher/open/TICKET``, within the first minute.
    """
    trials = Trials()
    teacher = TeacherPages(site, trials, teacher_token, ticket=ticket, live=live)

    async def failed(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if "text/html" in request.headers.get("accept", ""):  # a person asked, not the page's script
            return site.page("trouble.html", error.status_code, trouble=error.detail)
        return JSONResponse({"error": error.detail}, error.status_code)

    async def unwritten(request: Request, error: Exception) -> Response:
        print(f"cutenv serve: {error}", file=sys.stderr, flush=True)
        return JSONResponse({"error": "The class's database cannot be read or written; the server says why."}, 507)

    return Starlette(
        routes=[
            *live_routes(live, site.teacher, site.page),
            *PeoplePages(site, trials).routes,
            *teacher.routes,
            *StudyPages(site).routes,
            *UploadPages(site).routes,
            *teacher.routes_of_any_name,
        ],
        middleware=[Middleware(Guard)],
        exception_handlers={HTTPException: failed, SQLAlchemyError: unwritten},
    )


def new_token() -> str:
    """Return a new secret for the teacher."""
    return secrets.token_urlsafe(16)
