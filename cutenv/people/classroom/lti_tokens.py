"""Access tokens of platforms (OAuth 2.0 client credentials), by signed assertion."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime
from urllib.parse import urlencode

from cutenv.people.classroom.lti_keys import ToolKey
from cutenv.people.classroom.lti_platforms import Platform, PlatformUnreachable, asked_for_json

_ASSERTED, _EARLY = 120, 30.0  # [s] for which a statement to the platform holds; by which a token is renewed early
_ASSERTION_TYPE = "urn:ietf:params:oauth:client-assertion-type:jwt-bearer"


class AccessTokens:
    """Access tokens by platform and scope, cached until they expire.

    Parameters
    ----------
    key : ToolKey
        Key of the class.
    clock : callable
        Returns the present time, UTC.
    """

    def __init__(self, key: ToolKey, clock: Callable[[], datetime]) -> None:
        self._key, self._clock = key, clock
        self._tokens: dict[tuple[str, str, str], tuple[str, float]] = {}

    def forget(self, platform: Platform, scope: str) -> None:
        """Drop a rejected token, so that the next use requests one."""
        self._tokens.pop((*platform.key, scope), None)

    def find(self, platform: Platform, scope: str) -> str:
        """Return an access token of a platform for a scope.

        Raises
        ------
        PlatformRefused
            If the platform answers with an error.
        PlatformUnreachable
            If it answers without a token, or not at all.
        ValueError
            If the class's key cannot be read.
        """
        token, until = self._tokens.get((*platform.key, scope), ("", 0.0))
        if time.monotonic() < until:
            return token
        claims = {"iss": platform.client_id, "sub": platform.client_id}
        audience = platform.token_audience or platform.token_url
        form = {
            "grant_type": "client_credentials",
            "client_assertion_type": _ASSERTION_TYPE,
            "client_assertion": self._key.signed(claims, audience, self._clock(), _ASSERTED),
            "scope": scope,
        }
        headers = {"Content-Type": "application/x-www-form-urlencoded"}
        answer = asked_for_json(platform.token_url, urlencode(form).encode(), headers)
        given, lasts = answer.get("access_token"), str(answer.get("expires_in"))
        if not isinstance(given, str) or not (given and given.isascii() and given.isprintable()):
            raise PlatformUnreachable(f"{platform.token_url} gives no access token")
        seconds = float(lasts[:9]) if lasts.isascii() and lasts.isdecimal() else 60.0
        self._tokens[(*platform.key, scope)] = (given, time.monotonic() + max(0.0, seconds - _EARLY))
        return given
