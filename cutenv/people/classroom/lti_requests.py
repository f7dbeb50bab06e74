"""Requests to platforms, limited in time and size, without redirects."""

from __future__ import annotations

import http.client
import json
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from email.message import Message
from typing import Any

from cutenv.people.classroom.xapi_statements import NoRedirects

_WITHIN, _LARGEST = 10.0, 256 * 1024  # [s], [bytes]
_OPENER = urllib.request.build_opener(NoRedirects)


class PlatformUnreachable(OSError):
    """Platform without a proper answer; a retry may succeed."""


class PlatformRefused(PlatformUnreachable):
    """Platform that answers with an error, of HTTP ``status``."""

    def __init__(self, url: str, status: int) -> None:
        super().__init__(f"{without_query(url)} answers {status}")
        self.status = status


def asked(url: str, content: bytes | None = None, headers: Mapping[str, str] | None = None) -> tuple[bytes, Message]:
    """Return a platform's answer and headers: POST with ``content``, else GET.

    Raises
    ------
    PlatformRefused
        If it answers with an error or a redirect.
    PlatformUnreachable
        If it answers too late, too much or not at all.
    """
    ends = time.monotonic() + _WITHIN
    request = urllib.request.Request(url, content, dict(headers or {}))
    try:
        with _OPENER.open(request, timeout=_WITHIN) as answer:
            found = b""
            while part := answer.read1(65_536):
                found += part
                if len(found) > _LARGEST:
                    raise PlatformUnreachable(f"{without_query(url)} answers with more than {_LARGEST // 1024} kB")
                if time.monotonic() > ends:
                    raise PlatformUnreachable(f"{without_query(url)} takes longer than {_WITHIN:g} s to answer")
            return found, answer.headers
    except urllib.error.HTTPError as error:
        with error:
            raise PlatformRefused(url, error.code) from None
    except PlatformUnreachable:
        raise
    except (OSError, ValueError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", None) or error
        raise PlatformUnreachable(f"{without_query(url)} cannot be reached ({reason})") from None


def asked_for_json(url: str, content: bytes | None = None, headers: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return an answer's JSON object; PlatformUnreachable as in :func:`asked`, or if invalid."""
    return json_object(url, asked(url, content, {"Accept": "application/json", **(headers or {})})[0])


def json_object(url: str, content: bytes) -> dict[str, Any]:
    """Return an answer's JSON object; PlatformUnreachable if it is none."""
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise PlatformUnreachable(f"{without_query(url)} does not answer with a JSON object")
    return found


def without_query(url: str) -> str:
    """Return an address without its query, which may hold personal data."""
    return url.partition("?")[0]
