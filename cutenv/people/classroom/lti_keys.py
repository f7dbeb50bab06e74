"""Keys of LTI 1.3, of class and platforms, and access tokens.

Tokens are signed and checked by joserfc.  Only RS256 is accepted, which LTI requires: the header of a token can make it
neither unsigned nor checked with a public key in place of a shared secret.

Access tokens of platforms (OAuth 2.0 client credentials) are asked for by an assertion that the class's key signs.
"""

from __future__ import annotations

import json
import os
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from joserfc import jws, jwt
from joserfc.errors import JoseError
from joserfc.jwk import RSAKey

from cutenv.people.classroom.lti_platforms import Platform, PlatformUnreachable, asked_for_json

KEY_FILE = "lti_key.pem"
"""Name of the file of the class's private key, in its folder."""
_RS256 = ["RS256"]
_FEWEST_BITS, _MOST_KEYS = 2048, 50
_LONGEST_TOKEN = 64 * 1024
_FRESH, _PAUSE = 3600.0, 10.0  # [s] for which keys hold; between two looks for a key that is not known
_ASSERTED, _EARLY = 120, 30.0  # [s] for which a statement to the platform holds; by which a token is renewed early
_ASSERTION_TYPE = "urn:ietf:params:oauth:client-assertion-type:jwt-bearer"


class BadToken(ValueError):
    """Token whose signature does not hold, or that is none."""


class ToolKey:
    """Signing key pair of the class, made at first use and filed for its account alone."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()

    @property
    def public(self) -> dict[str, Any]:
        """Public key as a key set (JWKS) for platforms."""
        return {"keys": [self._key.as_dict(private=False, use="sig", alg="RS256")]}

    @cached_property
    def _key(self) -> RSAKey:
        with self._lock:
            if not self.path.exists():
                made = RSAKey.generate_key(_FEWEST_BITS).as_pem(private=True)
                with suppress(FileExistsError):  # another server was quicker
                    handle = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                    with os.fdopen(handle, "wb") as file:
                        file.write(made)
            return self._read()

    def _read(self) -> RSAKey:
        try:
            key = RSAKey.import_key(self.path.read_bytes())
            key.ensure_kid()
            key.as_dict(private=True)  # refuses a public one
        except (JoseError, ValueError) as error:
            raise ValueError(f"{self.path} is no private key ({error}). Delete it: a new one is made.") from None
        return key

    def signed(self, claims: Mapping[str, Any], audience: str, now: datetime, lasts: int) -> str:
        """Return claims as a unique signed token, valid for some seconds."""
        moment = int(now.timestamp())
        timed = {"aud": audience, "iat": moment, "exp": moment + lasts, "jti": secrets.token_hex(16)}
        return jwt.encode({"alg": "RS256", "kid": self._key.kid}, {**claims, **timed}, self._key, _RS256)

    def opened(self, token: str, audience: str, now: datetime) -> dict[str, Any]:
        """Return claims of a :meth:`signed` token; BadToken if invalid or expired."""
        claims = verified_claims(token, self._key)
        if claims.get("aud") != audience or not claims["exp"] > now.timestamp():
            raise BadToken("it is too old")
        return claims


def verified_claims(token: str, key: RSAKey) -> dict[str, Any]:
    """Return a token's claims after RS256 verification; BadToken otherwise."""
    try:
        return jwt.decode(token, key, _RS256).claims
    except (JoseError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise BadToken(str(error) or type(error).__name__) from None


def unverified_claims(token: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a token's header and claims unverified; BadToken if malformed."""
    if len(token) > _LONGEST_TOKEN:
        raise BadToken("it is too long")
    try:
        parsed = jws.extract_compact(token.encode())
        head, claims = parsed.headers(), json.loads(parsed.payload or b"")
    except (JoseError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise BadToken(str(error) or type(error).__name__) from None
    if not isinstance(claims, dict):
        raise BadToken("it has no claims")
    return head, claims


class PlatformKeys:
    """Public keys of platforms, fetched on demand and cached an hour.

    A platform changes its keys whenever it likes: one that is not known is looked for again, but not more often than
    every ten seconds, so that forged launches cannot flood a platform with requests.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._known: dict[str, tuple[float, dict[str, RSAKey], str]] = {}  # when, keys, trouble
        self._guard = threading.Lock()
        self._locks: dict[str, threading.Lock] = {}

    def find(self, platform: Platform, kid: str) -> RSAKey | None:
        """Return a platform's key or None; PlatformUnreachable on failure."""
        url = platform.jwks_url
        with self._guard:
            lock = self._locks.setdefault(url, threading.Lock())
        with lock:
            since, keys, trouble = self._known.get(url, (-_FRESH, {}, ""))
            age = self._clock() - since
            if age >= _FRESH or (kid not in keys and age >= _PAUSE):
                try:
                    keys, trouble = _keys_of(asked_for_json(url)), ""
                except PlatformUnreachable as error:
                    keys, trouble = {} if age >= _FRESH else keys, str(error)
                self._known[url] = (self._clock(), keys, trouble)
            if kid not in keys and trouble:
                raise PlatformUnreachable(trouble)
            return keys.get(kid)


def _keys_of(content: Mapping[str, Any]) -> dict[str, RSAKey]:
    """Return a key set's signing keys by identifier."""
    given, found = content.get("keys"), {}
    for each in given[:_MOST_KEYS] if isinstance(given, list) else ():
        if not isinstance(each, dict) or each.get("kty") != "RSA" or not isinstance(each.get("kid"), str):
            continue
        if each.get("use", "sig") != "sig" or each.get("alg", "RS256") != "RS256":
            continue
        try:
            key = RSAKey.import_key({name: each[name] for name in ("kty", "n", "e", "kid")})
            if key.public_key.key_size >= _FEWEST_BITS:
                found[each["kid"]] = key
        except (JoseError, ValueError, TypeError, KeyError):
            continue  # another key of the set may be sound
    return found


class AccessTokens:
    """Access tokens by platform and scope, cached until they expire."""

    def __init__(self, key: ToolKey, clock: Callable[[], datetime]) -> None:
        self._key, self._clock = key, clock
        self._tokens: dict[tuple[str, str, str], tuple[str, float]] = {}

    def forget(self, platform: Platform, scope: str) -> None:
        """Drop a rejected token, so that the next use requests one."""
        self._tokens.pop((*platform.key, scope), None)

    def find(self, platform: Platform, scope: str) -> str:
        """Return an access token of a platform for a scope, or raise PlatformUnreachable."""
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
