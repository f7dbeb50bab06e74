"""Learning platforms of a class (LTI 1.3): their file, and requests to them.

The file is TOML.  Requests are limited in time and size, and follow no redirects.
"""

from __future__ import annotations

import dataclasses
import http.client
import json
import re
import time
import tomllib
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from email.message import Message
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from cutenv._base.output import atomic_write
from cutenv._base.validation import nearest_choices
from cutenv.people.classroom.host_names import is_loopback
from cutenv.people.classroom.xapi_statements import NoRedirects

PLATFORMS_FILE = "platforms.toml"
"""Name of the file in the class's folder."""
_HOST = re.compile(r"[A-Za-z0-9.:\[\]-]+")
_MAX_CHARACTERS, _MAX_ENTRIES = 255, 100  # characters of an identifier, as LTI has it; entries of a list
_WITHIN, _MAX_ANSWER_BYTES = 10.0, 256 * 1024  # [s] and [bytes] of an answer
_OPENER = urllib.request.build_opener(NoRedirects)


def checked_address(field: str, address: str, *, local: bool = False) -> str:
    """Return a platform's address if https, or http on a local platform.

    The platform is ``local`` if it runs on this machine, as in a trial. Raises ValueError if it is none.
    """
    cure = f"Copy {field} from the platform's page of the registration: it begins with https://."
    try:
        parts = urlsplit(address)
        host = parts.hostname or ""
        _ = parts.port  # refuses one that is no number
    except ValueError:
        raise ValueError(f"{field} = {address!r} is no address. {cure}") from None
    if not (address.isascii() and address.isprintable() and " " not in address and _HOST.fullmatch(parts.netloc)):
        raise ValueError(f"{field} = {address!r} is no address. {cure}")
    if parts.scheme != "https" and not (parts.scheme == "http" and local and is_loopback(host)):
        raise ValueError(f"{field} = {address!r} is not encrypted. {cure}")
    return address


@dataclass(frozen=True, kw_only=True)
class Platform:
    """Registration of the class with one platform.

    Raises TypeError or ValueError if a field cannot be that; the text names it with its value and cure.
    """

    issuer: str
    client_id: str  # of the class at the issuer
    auth_url: str  # of its sign-in
    token_url: str  # of its access tokens
    jwks_url: str  # of its public keys
    deployments: tuple[str, ...]  # that may launch the class
    name: str = ""  # on the pages; by default the issuer
    token_audience: str = ""  # of the class's statements to token_url; by default that
    teacher_courses: tuple[str, ...] = ()  # whose instructors are let into the teacher's pages

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, tuple) or field.name == "deployments":
                _check_list(field.name, value)
            else:
                _check_text(field.name, value, needed=field.default is dataclasses.MISSING)
        if not self.deployments:
            raise ValueError("deployments is empty. Give the deployment ID that the platform shows.")
        checked_address("issuer", self.issuer, local=True)
        for name in ("auth_url", "token_url", "jwks_url"):
            checked_address(name, getattr(self, name), local=self.is_local)

    @property
    def is_local(self) -> bool:
        """True if the platform runs on this machine for trials."""
        return is_loopback(urlsplit(self.issuer).hostname or "")

    @property
    def key(self) -> tuple[str, str]:
        """Issuer and client, which no two registrations share."""
        return self.issuer, self.client_id

    @property
    def title(self) -> str:
        """Name on the pages."""
        return self.name or self.issuer


_FIELDS = tuple(field.name for field in dataclasses.fields(Platform))


def _check_text(field: str, value: Any, *, needed: bool) -> None:
    if not isinstance(value, str):
        raise TypeError(f"{field} must be a text, got {value!r}. Put it between quotation marks.")
    if needed and not value:
        raise ValueError(f"{field} is missing. Copy it from the platform's page of the registration.")
    if len(value) > _MAX_CHARACTERS or not (value.isprintable() and value == value.strip()):
        raise ValueError(
            f"{field} = {value!r} has characters that no identifier has, or more than {_MAX_CHARACTERS}. Shorten it."
        )


def _check_list(field: str, value: Any) -> None:
    if not isinstance(value, tuple) or len(value) > _MAX_ENTRIES:
        raise TypeError(f'{field} must be a list of up to {_MAX_ENTRIES} texts, got {value!r}. Write it such as ["1"].')
    for each in value:
        _check_text(field, each, needed=True)


class PlatformFile:
    """File of the platforms, read again whenever it has changed.

    It need not be there. ``trouble`` says why the present file cannot be read, "" if it can; the platforms that were
    read before hold then.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.trouble = path, ""
        self._stamp: tuple[int, ...] | None = None
        self._known: tuple[Platform, ...] = ()

    @property
    def platforms(self) -> tuple[Platform, ...]:
        """The platforms."""
        try:
            about = self.path.stat()
        except OSError:
            self._stamp, self._known, self.trouble = None, (), ""
            return ()
        stamp = (about.st_mtime_ns, about.st_size, about.st_ino)
        if stamp != self._stamp:
            try:
                self._known, self.trouble = read_platforms(self.path), ""
            except (OSError, TypeError, ValueError) as error:
                self.trouble = str(error)
            self._stamp = stamp
        return self._known

    def find(self, issuer: str, client_ids: Sequence[str] = ()) -> list[Platform]:
        """Return registrations of an issuer, optionally of some clients."""
        known = [each for each in self.platforms if each.issuer == issuer]
        return [each for each in known if not client_ids or each.client_id in client_ids]

    def add(self, platform: Platform) -> None:
        """Add or replace a client's registration; ValueError for a damaged file."""
        self._write([each for each in self.sound() if each.key != platform.key] + [platform])

    def drop(self, issuer: str, client_id: str) -> None:
        """Remove a registration; ValueError if the file is damaged."""
        self._write([each for each in self.sound() if each.key != (issuer, client_id)])

    def sound(self) -> tuple[Platform, ...]:
        """Return the platforms; ValueError if the file is damaged."""
        known = self.platforms
        if self.trouble:  # it would be overwritten
            raise ValueError(self.trouble)
        return known

    def _write(self, platforms: Sequence[Platform]) -> None:
        with atomic_write(self.path) as part:
            part.touch(0o600)
            part.write_text(platforms_toml(platforms), encoding="utf-8")


def read_platforms(path: Path) -> tuple[Platform, ...]:
    """Return the platforms of a file; an error names file, field, value and cure."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: it is no TOML file ({error}).") from None
    given = content.get("platform", [])
    if set(content) - {"platform"} or not isinstance(given, list) or not all(isinstance(each, dict) for each in given):
        raise ValueError(f"{path}: begin each platform with a line [[platform]].")
    found: list[Platform] = []
    for number, each in enumerate(given, 1):
        try:
            platform = platform_of(each)
            if platform.key in [other.key for other in found]:
                raise ValueError(f"client_id = {platform.client_id!r} is registered twice. Write its deployments once.")
        except (TypeError, ValueError) as error:
            raise type(error)(f"{path}: platform {number}: {error}") from None
        found.append(platform)
    return tuple(found)


def platform_of(content: Mapping[str, Any]) -> Platform:
    """Return a file table's platform; TypeError or ValueError names the fault."""
    for key in content:
        if key not in _FIELDS:
            raise ValueError(f"{key!r} is not known.{nearest_choices(key, _FIELDS)} It takes {', '.join(_FIELDS)}.")
    for field in dataclasses.fields(Platform):
        if field.default is dataclasses.MISSING and field.name not in content:
            raise ValueError(f"{field.name} is missing. Copy it from the platform's page of the registration.")
    given: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in content.items()}
    return Platform(**given)


def platforms_toml(platforms: Sequence[Platform]) -> str:
    """Return the file's text, as :func:`read_platforms` reads it."""
    tables = []
    for each in platforms:
        filled = {key: value for key, value in dataclasses.asdict(each).items() if value}
        # JSON's texts and lists are TOML's.
        lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in filled.items()]
        tables.append("\n".join(["[[platform]]", *lines, ""]))
    return "\n".join(tables)


class PlatformUnreachable(OSError):
    """Platform without a proper answer; a retry may succeed."""


class PlatformRefused(PlatformUnreachable):
    """Platform that answers with an error, of HTTP ``status``."""

    def __init__(self, url: str, status: int) -> None:
        super().__init__(f"{without_query(url)} answers {status}")
        self.status = status


def asked(url: str, content: bytes | None = None, headers: Mapping[str, str] | None = None) -> tuple[bytes, Message]:
    """Return a platform's answer and headers: POST with ``content``, else GET.

    Raises PlatformRefused for an error or a redirect, PlatformUnreachable for an answer too late, too large or missing.
    """
    ends = time.monotonic() + _WITHIN
    request = urllib.request.Request(url, content, dict(headers or {}))
    try:
        with _OPENER.open(request, timeout=_WITHIN) as answer:
            found = b""
            while part := answer.read1(65_536):
                found += part
                if len(found) > _MAX_ANSWER_BYTES:
                    raise PlatformUnreachable(
                        f"{without_query(url)} answers with more than {_MAX_ANSWER_BYTES // 1024} kB"
                    )
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
