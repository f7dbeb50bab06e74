"""A learning platform for tests, as strict as LTI 1.3 lets one be: its own keys, launches, gradebook, on loopback.

It follows 1EdTech's LTI Core 1.3, Security Framework 1.0, Deep Linking 2.0, Assignment and Grade Services 2.0, Names
and Role Provisioning Services 2.0 and Dynamic Registration 1.0, and shares no code with the class: tokens are made and
checked here by the arithmetic of RSA in ``cryptography``.
"""

from __future__ import annotations

import base64
import hmac
import json
import secrets
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, parse_qsl, urlsplit

import pytest

pytest.importorskip("joserfc", reason="learning platforms are an extra: pip install 'cutenv[lti]'")

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import padding, rsa

CLAIM = "https://purl.imsglobal.org/spec/lti/claim/"
DL = "https://purl.imsglobal.org/spec/lti-dl/claim/"
AGS = "https://purl.imsglobal.org/spec/lti-ags/claim/endpoint"
SCORE = "https://purl.imsglobal.org/spec/lti-ags/scope/score"
NRPS = "https://purl.imsglobal.org/spec/lti-nrps/claim/namesroleservice"
MEMBERS = "https://purl.imsglobal.org/spec/lti-nrps/scope/contextmembership.readonly"
CONTAINER = "application/vnd.ims.lti-nrps.v2.membershipcontainer+json"
TOOL = "https://purl.imsglobal.org/spec/lti-tool-configuration"
ROLE = "http://purl.imsglobal.org/vocab/lis/v2/membership#"
CLIENT, DEPLOYMENT, COURSE = "cutting-class", "1", "12"


def encoded(content: bytes) -> str:
    return base64.urlsafe_b64encode(content).rstrip(b"=").decode()


def decoded(text: str) -> bytes:
    return base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))


def _number(value: int) -> str:
    return encoded(value.to_bytes((value.bit_length() + 7) // 8, "big"))


class Signer:
    """A key pair and its identifier."""

    def __init__(self, kid: str, bits: int = 2048) -> None:
        self.kid, self._key = kid, rsa.generate_private_key(65537, bits)

    @property
    def jwk(self) -> dict[str, Any]:
        numbers = self._key.public_key().public_numbers()
        made = {"kty": "RSA", "use": "sig", "alg": "RS256", "kid": self.kid}
        return made | {"n": _number(numbers.n), "e": _number(numbers.e)}

    @property
    def pem(self) -> bytes:
        kind = serialization.PublicFormat.SubjectPublicKeyInfo
        return self._key.public_key().public_bytes(serialization.Encoding.PEM, kind)

    def token(self, claims: Mapping[str, Any], alg: str = "RS256", /, **head: Any) -> str:
        """A signed token; by ``alg`` "none" and "HS256" the forgeries that a tool must not believe."""
        parts = [{"alg": alg, "typ": "JWT", "kid": self.kid} | head, claims]
        signed = ".".join(encoded(json.dumps(part).encode()) for part in parts)
        if alg == "none":
            return f"{signed}."
        if alg == "HS256":
            return f"{signed}.{encoded(hmac.digest(self.pem, signed.encode(), 'sha256'))}"
        return f"{signed}.{encoded(self._key.sign(signed.encode(), padding.PKCS1v15(), hashes.SHA256()))}"


FIRST = Signer("first")  # of every platform: a key takes a while


def verified(token: str, keys: Mapping[str, Any], audience: str, now: datetime) -> dict[str, Any]:
    """Claims of a tool's token, checked as a platform has to; AssertionError says what is wrong."""
    head, body, signature = token.split(".")
    about, claims = json.loads(decoded(head)), json.loads(decoded(body))
    assert about["alg"] == "RS256"
    (key,) = (each for each in keys["keys"] if each["kid"] == about["kid"])
    assert set(key) == {"kty", "n", "e", "kid", "use", "alg"}, "a public key has no other member"
    n, e = (int.from_bytes(decoded(key[name]), "big") for name in ("n", "e"))
    try:
        rsa.RSAPublicNumbers(e, n).public_key().verify(
            decoded(signature), f"{head}.{body}".encode(), padding.PKCS1v15(), hashes.SHA256()
        )
    except InvalidSignature:
        raise AssertionError("the signature does not hold") from None
    assert audience in (claims["aud"] if isinstance(claims["aud"], list) else [claims["aud"]])
    assert claims["iat"] <= now.timestamp() + 5 < claims["exp"] + 5
    return claims


class LearningPlatform(ThreadingHTTPServer):
    """The platform: addresses, people, gradebook; ``answers`` are planned failures of its next answers."""

    daemon_threads = True

    def __init__(
        self,
        clock: Callable[[], datetime],
        tool_keys: Callable[[], Mapping[str, Any]],
        host: str = "127.0.0.1",
        answer: type[PlatformAnswer] | None = None,
    ) -> None:
        super().__init__((host, 0), answer or PlatformAnswer)
        self.issuer = f"http://{host}:{self.server_address[1]}"
        self.tool = ""
        self.clock, self.tool_keys = clock, tool_keys
        self.signers = [FIRST]
        self.answers: list[int | threading.Event | None] = []  # None for an answer as it is
        self.asked: list[str] = []
        self.scores: list[tuple[str, dict[str, Any]]] = []
        self.troubles: list[str] = []
        self.scopes = {SCORE, MEMBERS}
        self.members: list[dict[str, Any]] = []
        self.largest_page = 2
        self.container: dict[str, Any] = {"id": f"{self.issuer}/{COURSE}/members", "context": {"id": COURSE}}
        self.kind = CONTAINER
        self.next_page: Callable[[int], str] = lambda start: f"{self.members_url}&start={start}"
        self.described: dict[str, Any] = {}  # what its configuration says otherwise
        self.registered: dict[str, Any] = {}  # what its answer to a registration says otherwise
        self.registrations: list[dict[str, Any]] = []
        self.registration_token = secrets.token_urlsafe(24)
        self._tokens: dict[str, str] = {}
        self._used: set[str] = set()
        self._latest: dict[tuple[str, str], str] = {}
        self._thread = threading.Thread(target=self.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self.shutdown()
        self._thread.join()
        self.server_close()

    @property
    def registration(self) -> dict[str, Any]:
        """Return the registration of this platform, as the file of the class has it."""
        return {
            "issuer": self.issuer, "client_id": CLIENT, "auth_url": f"{self.issuer}/auth?kind=lti",
            "token_url": f"{self.issuer}/token", "jwks_url": f"{self.issuer}/jwks", "deployments": [DEPLOYMENT],
        }  # fmt: skip

    @property
    def configuration(self) -> dict[str, Any]:
        """Return how this platform describes itself to a tool that is to register."""
        registration = self.registration
        made = {
            "issuer": self.issuer, "authorization_endpoint": registration["auth_url"],
            "token_endpoint": registration["token_url"], "jwks_uri": registration["jwks_url"],
            "registration_endpoint": f"{self.issuer}/register?kind=lti", "scopes_supported": ["openid", SCORE, MEMBERS],
            "token_endpoint_auth_methods_supported": ["private_key_jwt"], "response_types_supported": ["id_token"],
            "token_endpoint_auth_signing_alg_values_supported": ["RS256"], "subject_types_supported": ["public"],
            "id_token_signing_alg_values_supported": ["RS256"], "claims_supported": ["sub", "iss", "name", "email"],
            "https://purl.imsglobal.org/spec/lti-platform-configuration": {
                "product_family_code": "stand-in", "version": "1", "variables": [],
                "messages_supported": [{"type": "LtiResourceLinkRequest"}, {"type": "LtiDeepLinkingRequest"}],
            },
        }  # fmt: skip
        return {name: value for name, value in (made | self.described).items() if value is not None}

    def take_registration(self, headers: Mapping[str, str], content: bytes) -> dict[str, Any]:
        """Register a tool, whose request is checked; the token holds once."""
        assert headers["Authorization"] == f"Bearer {self.registration_token}"
        assert headers["Content-Type"] == "application/json"
        self.registration_token = secrets.token_urlsafe(24)
        asked = json.loads(content)
        about = asked[TOOL]
        assert set(asked) == {
            "application_type", "response_types", "grant_types", "initiate_login_uri", "redirect_uris", "client_name",
            "jwks_uri", "token_endpoint_auth_method", "scope", TOOL,
        }  # fmt: skip
        assert (asked["application_type"], asked["token_endpoint_auth_method"]) == ("web", "private_key_jwt")
        assert asked["response_types"] == ["id_token"]
        assert set(asked["grant_types"]) == {"implicit", "client_credentials"}
        assert set(asked["scope"].split(" ")) == {SCORE, MEMBERS}, "no more than is used"
        assert set(about) == {"domain", "target_link_uri", "claims", "messages"}
        assert set(about["claims"]) == {"iss", "sub"}, "nobody's name"
        (message,) = about["messages"]
        assert message["type"] == "LtiDeepLinkingRequest"
        assert {about["target_link_uri"], message["target_link_uri"]} == set(asked["redirect_uris"])
        assert asked["client_name"]
        assert message["label"]
        for address in (asked["initiate_login_uri"], asked["jwks_uri"], *asked["redirect_uris"]):
            parts = urlsplit(address)
            assert parts.scheme == "https" or parts.hostname == "127.0.0.1", address
            assert parts.hostname == about["domain"], address
        self.registrations.append(asked)
        answer = {"client_id": CLIENT, TOOL: about | {"deployment_id": DEPLOYMENT}} | self.registered
        return {name: value for name, value in (asked | answer).items() if value is not None}

    def line_item(self, name: str) -> str:
        """Address of a column of the gradebook; with a query, as Moodle has it."""
        return f"{self.issuer}/{COURSE}/lineitems/{name}/lineitem?type_id=1"

    @property
    def members_url(self) -> str:
        """Address of the members of the course; with a query, as Moodle has it."""
        return f"{self.issuer}/{COURSE}/memberships?type_id=1"

    def initiation(self, subject: str, target: str) -> dict[str, str]:
        """Parameters by which the platform sends a browser to the tool."""
        return {
            "iss": self.issuer, "login_hint": subject, "target_link_uri": target, "client_id": CLIENT,
            "lti_message_hint": f"hint of {subject}", "lti_deployment_id": DEPLOYMENT,
        }  # fmt: skip

    def authorized(self, address: str, subject: str, redirect: str) -> dict[str, str]:
        """State and nonce of the tool's request to sign in, which is checked."""
        assert address.startswith(f"{self.issuer}/auth?"), address
        given = parse_qs(urlsplit(address).query, strict_parsing=True)
        assert all(len(values) == 1 for values in given.values())
        asked = {name: value for name, (value,) in given.items()}
        wanted = {
            "kind": "lti", "scope": "openid", "response_type": "id_token", "response_mode": "form_post",
            "prompt": "none", "client_id": CLIENT, "redirect_uri": redirect, "login_hint": subject,
            "lti_message_hint": f"hint of {subject}",
        }  # fmt: skip
        assert {name: asked.get(name) for name in wanted} == wanted
        assert len(asked["state"]) >= 16
        assert len(asked["nonce"]) >= 16
        assert asked["state"] != asked["nonce"]
        return {"state": asked["state"], "nonce": asked["nonce"]}

    def claims(self, nonce: str, subject: str, /, **changed: Any) -> dict[str, Any]:
        """Claims of a launch; a change to None takes one out."""
        now = int(self.clock().timestamp())
        made = {
            "iss": self.issuer, "aud": CLIENT, "sub": subject, "iat": now, "exp": now + 60, "nonce": nonce,
            "name": "Ada Lovelace", "given_name": "Ada", "family_name": "Lovelace", "email": "ada@school.example",
            f"{CLAIM}message_type": "LtiResourceLinkRequest", f"{CLAIM}version": "1.3.0",
            f"{CLAIM}deployment_id": DEPLOYMENT, f"{CLAIM}target_link_uri": "http://class/lti/launch",
            f"{CLAIM}resource_link": {"id": "7"}, f"{CLAIM}roles": [f"{ROLE}Learner"],
            f"{CLAIM}context": {"id": COURSE, "label": "SURG101", "title": "Surgery 101"},
            AGS: {"scope": [SCORE], "lineitem": self.line_item("7")},
            NRPS: {"context_memberships_url": self.members_url, "service_versions": ["2.0"]},
        }  # fmt: skip
        return {name: value for name, value in (made | changed).items() if value is not None}

    def deep_linking(self, nonce: str, subject: str, /, **changed: Any) -> dict[str, Any]:
        """Claims of a request to choose a link."""
        settings = {
            "deep_link_return_url": f"{self.issuer}/chosen", "accept_types": ["ltiResourceLink"],
            "accept_presentation_document_targets": ["iframe", "window"], "data": "kept & returned",
        }  # fmt: skip
        shared = {
            f"{CLAIM}message_type": "LtiDeepLinkingRequest", f"{CLAIM}resource_link": None, AGS: None,
            f"{CLAIM}roles": [f"{ROLE}Instructor"], f"{DL}deep_linking_settings": settings,
        }  # fmt: skip
        return self.claims(nonce, subject, **shared | changed)

    def chosen(self, token: str) -> dict[str, Any]:
        """The one link that a tool's answer chooses, which is checked."""
        claims = verified(token, self.tool_keys(), self.issuer, self.clock())
        assert claims["iss"] == CLIENT
        assert claims["nonce"] not in self._used
        self._used.add(claims["nonce"])
        assert claims[f"{CLAIM}message_type"] == "LtiDeepLinkingResponse"
        assert claims[f"{CLAIM}version"] == "1.3.0"
        assert claims[f"{CLAIM}deployment_id"] == DEPLOYMENT
        assert claims[f"{DL}data"] == "kept & returned"
        (item,) = claims[f"{DL}content_items"]
        assert item["type"] == "ltiResourceLink"
        return item

    def token(self, form: Mapping[str, str]) -> tuple[int, dict[str, Any]]:
        """Answer to a request for an access token (RFC 7523)."""
        assert form["grant_type"] == "client_credentials"
        assert form["client_assertion_type"] == "urn:ietf:params:oauth:client-assertion-type:jwt-bearer"
        claims = verified(form["client_assertion"], self.tool_keys(), f"{self.issuer}/token", self.clock())
        assert claims["iss"] == claims["sub"] == CLIENT
        assert claims["exp"] - claims["iat"] <= 300
        assert claims["jti"] not in self._used, "each statement holds once"
        self._used.add(claims["jti"])
        assert form["scope"] in (SCORE, MEMBERS), "one scope, of what is needed"
        if form["scope"] not in self.scopes:
            return 400, {"error": "invalid_scope"}
        made = secrets.token_urlsafe(24)
        self._tokens[made] = form["scope"]
        return 200, {"access_token": made, "token_type": "Bearer", "expires_in": 3600, "scope": form["scope"]}

    def list_members(self, path: str, headers: Mapping[str, str]) -> tuple[int, dict[str, Any], dict[str, str]]:
        """A page of the members of the course: status, content and headers of the answer."""
        kind, _, token = headers["Authorization"].partition(" ")
        if kind != "Bearer" or token not in self._tokens:
            return 401, {}, {}
        if self._tokens[token] != MEMBERS:
            return 403, {}, {}
        if headers["Accept"] != CONTAINER:
            return 406, {}, {}
        place = urlsplit(path)
        asked = dict(parse_qsl(place.query, strict_parsing=True))
        assert place.path == f"/{COURSE}/memberships"
        assert set(asked) <= {"type_id", "limit", "start"}, asked
        assert asked["type_id"] == "1"
        start, limit = int(asked.get("start", "0")), int(asked.get("limit", "1000"))
        size = min(limit, self.largest_page)
        sent = {"Content-Type": f"{self.kind}; charset=utf-8"}
        links = [f'<{self.members_url}&since=1>; rel="differences"']
        if start + size < len(self.members):
            links.insert(0, f'<{self.next_page(start + size)}>; rel="next"')
        return 200, self.container | {"members": self.members[start : start + size]}, sent | {"Link": ", ".join(links)}

    def forget_tokens(self) -> None:
        """Let every access token end."""
        self._tokens.clear()

    def take_score(self, path: str, headers: Mapping[str, str], content: bytes) -> int:
        """Put a score into the gradebook; the status of the answer."""
        kind, _, token = headers["Authorization"].partition(" ")
        if kind != "Bearer" or token not in self._tokens:
            return 401
        if self._tokens[token] != SCORE:
            return 403
        assert headers["Content-Type"] == "application/vnd.ims.lis.v1.score+json"
        place = urlsplit(path)
        column = place.path.removesuffix("/scores").removesuffix("/lineitem").rpartition("/")[2]
        assert place.path == f"/{COURSE}/lineitems/{column}/lineitem/scores"
        assert place.query == "type_id=1"
        score = json.loads(content)
        required = {"userId", "timestamp", "activityProgress", "gradingProgress"}
        assert required <= set(score) <= required | {"scoreGiven", "scoreMaximum", "comment"}
        assert score["activityProgress"] in ("Initialized", "Started", "InProgress", "Submitted", "Completed")
        assert score["gradingProgress"] in ("FullyGraded", "Pending", "PendingManual", "Failed", "NotReady")
        assert 0 <= score["scoreGiven"] <= score["scoreMaximum"]
        moment = datetime.fromisoformat(score["timestamp"])
        assert moment.tzinfo is not None
        assert "." in score["timestamp"], "to less than a second"
        latest = self._latest.get((column, score["userId"]))
        if latest is not None and moment <= datetime.fromisoformat(latest):
            return 409
        self._latest[column, score["userId"]] = score["timestamp"]
        self.scores.append((column, score))
        return 200


class PlatformAnswer(BaseHTTPRequestHandler):
    server: LearningPlatform

    def do_GET(self) -> None:
        if self._fails():
            return
        try:
            if "/memberships?" in self.path:
                self._say(*self.server.list_members(self.path, self.headers))
            elif self.path == "/.well-known/openid-configuration":
                self._say(200, self.server.configuration)
            else:
                self._say(200, {"keys": [signer.jwk for signer in self.server.signers]} if self.path == "/jwks" else {})
        except (AssertionError, KeyError, ValueError) as error:
            self.server.troubles.append(f"{self.path}: {error!r}")
            self._say(400, {"error": "invalid_request"})

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        if self._fails():
            return
        try:
            if self.path == "/token":
                self._say(*self.server.token(dict(parse_qsl(content.decode(), strict_parsing=True))))
            elif self.path == "/register?kind=lti":
                self._say(200, self.server.take_registration(self.headers, content))
            else:
                self._say(self.server.take_score(self.path, self.headers, content), {})
        except (AssertionError, KeyError, ValueError) as error:
            self.server.troubles.append(f"{self.path}: {error!r}")
            self._say(400, {"error": "invalid_request"})

    def _fails(self) -> bool:
        self.server.asked.append(self.path)
        planned = self.server.answers.pop(0) if self.server.answers else None
        if isinstance(planned, threading.Event):
            planned.wait(60.0)
        if isinstance(planned, int):
            self._say(planned, {})
        return isinstance(planned, int)

    def _say(self, status: int, content: Mapping[str, Any], headers: Mapping[str, str] | None = None) -> None:
        made = json.dumps(content).encode()
        self.send_response(status)
        sent = {"Content-Type": "application/json", "Location": "http://127.0.0.1:1/elsewhere"} | dict(headers or {})
        for name, value in (sent | {"Content-Length": str(len(made))}).items():
            self.send_header(name, value)
        with suppress(ConnectionError):  # who asked did not wait
            self.end_headers()
            self.wfile.write(made)

    def log_message(self, *_: Any) -> None:
        pass
