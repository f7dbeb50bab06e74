"""Web server of a class, with pages for people and their teacher.

No page asks another host for anything.  A lock on the class's folder, released with the process, names its server.
Idle connections are limited, by address and time.
"""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import os
import secrets
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any, ClassVar

import h11
from sqlalchemy.exc import SQLAlchemyError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from uvicorn.protocols.http.h11_impl import H11Protocol

from cutenv.display.report.page import in_languages, translated
from cutenv.people.classroom.class_site import ClassSite, Guard
from cutenv.people.classroom.course_pages import CoursePages
from cutenv.people.classroom.live_rig import LiveRig, live_routes
from cutenv.people.classroom.people_pages import PeoplePages
from cutenv.people.classroom.teacher_pages import StudyPages, TeacherPages, UploadPages

CLAIM_FILE = "server.lock"
"""Name of the file in the class's folder.

It stays when a server has ended, and then claims nothing.
"""
HEADER_WITHIN = 10.0
"""Time that the header of a request may take [s]."""
MOST_SILENT = 128
"""Connections of one address that have sent no header; beyond, the one that has waited longest is closed.

A class behind one address may connect at once, before any of its headers is read.
"""
MOST_CONNECTIONS = 250
"""Connections of one address; beyond, new ones are closed."""
_TAKEN = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)  # others: a disk without locks, where nothing is known


def class_app(site: ClassSite, *, live: LiveRig | None = None, ticket: str | None = None) -> Starlette:
    """Return the ASGI application of a class.

    The ticket is a secret that signs the teacher in once, by the address ``teacher/open/TICKET``, within the first
    minute.
    """
    teacher, lti = TeacherPages(site, ticket=ticket, live=live), list[Route]()
    if site.lti is not None:
        from cutenv.people.classroom.lti_pages import LtiPages  # an extra

        lti = LtiPages(site, site.lti).routes

    async def failed(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if "text/html" in request.headers.get("accept", ""):  # a person asked, not the page's script
            return site.page("trouble.html", error.status_code, trouble=translated(error.detail, site.language))
        return JSONResponse({"error": error.detail, "said": in_languages(error.detail)}, error.status_code)

    async def unwritten(request: Request, error: Exception) -> Response:
        print(f"cutenv serve: {error}", file=sys.stderr, flush=True)
        said = "The class's database cannot be read or written; the server says why."
        return JSONResponse({"error": said, "said": in_languages(said)}, 507)

    return Starlette(
        routes=[
            *live_routes(live, site),
            *PeoplePages(site).routes,
            *teacher.routes,
            *CoursePages(site).routes,
            *lti,
            *StudyPages(site).routes,
            *UploadPages(site).routes,
            *teacher.routes_of_any_name,
        ],
        middleware=[Middleware(Guard, hosts=site.hosts)],
        exception_handlers={HTTPException: failed, SQLAlchemyError: unwritten},
    )


def new_token() -> str:
    """Return a new secret for the teacher."""
    return secrets.token_urlsafe(16)


class FolderClaim:
    """Lock on a folder that names its server to the next one.

    ``other`` is the address of a server in another process that has the folder already, else "".
    """

    def __init__(self, folder: Path, address: str) -> None:
        self._file = (folder / CLAIM_FILE).open("a+", encoding="utf-8")
        self.other = ""
        if self._is_taken():
            self._file.seek(1)  # the first byte is what is locked
            self.other = self._file.read().strip() or "an address that is not known"
        else:
            self._file.truncate(0)
            self._file.write(f" {address}\n")
            self._file.flush()

    def _is_taken(self) -> bool:
        """Lock the first byte; return True if another process has it."""
        try:
            if os.name == "nt":
                import msvcrt

                self._file.seek(0)
                msvcrt.locking(self._file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
            else:
                import fcntl

                fcntl.lockf(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB, 1, 0)
        except OSError as error:
            return error.errno in _TAKEN
        return False

    def close(self) -> None:
        """Give the folder back."""
        self._file.close()


class PatientProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn that closes slow or too numerous connections."""

    _of_address: ClassVar[defaultdict[str, dict[PatientProtocol, None]]] = defaultdict(dict)  # in order

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._address = ""
        self._impatience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, and make room for it."""
        super().connection_made(transport)
        self._address = _network(self.client[0] if self.client else "")
        others = self._of_address[self._address]
        silent = [each for each in others if each._impatience is not None]
        if len(silent) >= MOST_SILENT:
            silent[0]._drop()
        others[self] = None
        if len(others) > MOST_CONNECTIONS:
            self._drop()
        else:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._forget()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read data; a partial header is waited for."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._answer()
        elif self._impatience is None:
            self._wait()

    def _drop(self) -> None:
        """Close a connection, which stops counting at once."""
        self._forget()
        self.connections.discard(self)
        self.transport.close()

    def _forget(self) -> None:
        self._answer()
        others = self._of_address[self._address]
        others.pop(self, None)
        if not others:
            del self._of_address[self._address]

    def _wait(self) -> None:
        self._impatience = self.loop.call_later(HEADER_WITHIN, self._drop)

    def _answer(self) -> None:
        if self._impatience is not None:
            self._impatience.cancel()
            self._impatience = None


def _network(address: str) -> str:
    """Return the address, or of IPv6 the /64 network of a household."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    return str(ipaddress.ip_network((found, 64), strict=False)) if found.version == 6 else str(found)
