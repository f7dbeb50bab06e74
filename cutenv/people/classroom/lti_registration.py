"""Registration on a platform's request (LTI Dynamic Registration 1.0).

The teacher's page makes an invitation, and an administrator gives its address to the platform, which opens it with the
address of its configuration.  An invitation is signed by the class's key and names the address of the class, so that
nothing is stored for it, and no header of a request can put another address there.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from cutenv.people.classroom.host_names import is_loopback
from cutenv.people.classroom.lti_grades import SCORE_SCOPE
from cutenv.people.classroom.lti_keys import BadToken
from cutenv.people.classroom.lti_launch import DEEP_LINKING
from cutenv.people.classroom.lti_members import MEMBERS_SCOPE
from cutenv.people.classroom.lti_platforms import Platform, asked_for_json, checked_address, platform_of

if TYPE_CHECKING:
    from cutenv.people.classroom.lti_tool import LtiTool

_INVITATION, _HOLDS = "registration", 3600  # audience of an invitation; [s], shorter than use is remembered
_TOOL = "https://purl.imsglobal.org/spec/lti-tool-configuration"
_ENDPOINTS = {"auth_url": "authorization_endpoint", "token_url": "token_endpoint", "jwks_url": "jwks_uri"}
_BY_HAND = "Enter the platform by hand."


class RefusedRegistration(ValueError):
    """Registration without valid invitation, or with an unsound platform description."""


class RegistrationDesk:
    """Registration of invited platforms, once within an hour per invitation.

    The title is the class's name on the platform, the paths are by what they are for: login, launch, choose, jwks.
    """

    def __init__(self, tool: LtiTool, clock: Callable[[], datetime], title: str, paths: Mapping[str, str]) -> None:
        self._tool, self._clock, self._title, self._paths = tool, clock, title, paths

    def invite(self, base: str) -> str:
        """Return an invitation to the class at an address."""
        return self._tool.key.signed({"base": base}, _INVITATION, self._clock(), _HOLDS)

    def register(self, invitation: str, configuration_url: str, token: str) -> Platform:
        """Register the class with a platform, and save the platform.

        The invitation is used up once the platform is asked. The platform describes itself at ``configuration_url``,
        and wants to see the token again, if any. Raises RefusedRegistration if the invitation does not hold, or the
        platform's configuration or answer is not sound, PlatformUnreachable if it does not answer.
        """
        try:
            claims = self._tool.key.opened(invitation, _INVITATION, self._clock())
        except BadToken:
            raise RefusedRegistration(_OVER) from None
        if not configuration_url:
            raise RefusedRegistration("Paste this address into the learning platform, which opens it by itself.")
        if not (token.isascii() and token.isprintable()):
            raise RefusedRegistration("registration_token has characters that no token has. Begin again there.")
        local = is_loopback(urlsplit(claims["base"]).hostname or "")  # a trial: else this machine is not asked
        with _refusing():
            checked_address("openid_configuration", configuration_url, local=local)
            self._tool.file.sound()
        if not self._tool.people.use_once(claims["jti"]):
            raise RefusedRegistration(_OVER)
        described = asked_for_json(configuration_url)
        with _refusing():
            content = _content_of(described, configuration_url, local=local)
            address = checked_address("registration_endpoint", _text(described, "registration_endpoint"), local=local)
        if _origin(address) != _origin(content["issuer"]):  # which alone gets the token
            raise RefusedRegistration(f"registration_endpoint = {address!r} is not on the platform. {_BY_HAND}")
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {token}"} if token else {})
        answer = asked_for_json(address, json.dumps(self._asked_for(claims["base"])).encode(), headers)
        with _refusing():
            return self._keep(content, answer)

    def _asked_for(self, base: str) -> dict[str, Any]:
        """Return the registration request, without names and e-mail addresses."""
        at = {name: base + path for name, path in self._paths.items()}
        choice = {"type": DEEP_LINKING, "target_link_uri": at["choose"], "label": self._title}
        return {
            "application_type": "web", "response_types": ["id_token"],
            "grant_types": ["implicit", "client_credentials"], "client_name": self._title,
            "initiate_login_uri": at["login"], "redirect_uris": [at["launch"], at["choose"]], "jwks_uri": at["jwks"],
            "token_endpoint_auth_method": "private_key_jwt", "scope": f"{SCORE_SCOPE} {MEMBERS_SCOPE}",
            _TOOL: {
                "domain": urlsplit(base).hostname, "target_link_uri": at["launch"], "claims": ["iss", "sub"],
                "messages": [choice],
            },
        }  # fmt: skip

    def _keep(self, content: dict[str, Any], answer: Mapping[str, Any]) -> Platform:
        client, tool = _text(answer, "client_id"), answer.get(_TOOL)
        deployment = tool.get("deployment_id") if isinstance(tool, dict) else None
        if not isinstance(deployment, str) or not deployment:
            raise RefusedRegistration(f"The platform names no deployment of its client {client!r}. {_BY_HAND}")
        if self._tool.file.find(content["issuer"], [client]):  # courses whose teachers teach here may stand there
            raise RefusedRegistration(f"The client {client!r} is registered already. Remove it first.")
        platform = platform_of(content | {"client_id": client, "deployments": [deployment]})
        self._tool.file.add(platform)
        return platform


_OVER = "This registration address has been used or is too old. Make a new one on the page of learning platforms."


def _content_of(described: Mapping[str, Any], url: str, *, local: bool) -> dict[str, Any]:
    """Return the file content from the configuration of a platform itself."""
    issuer = checked_address("issuer", _text(described, "issuer"), local=local)
    if not url.startswith(f"{issuer.rstrip('/')}/"):
        raise RefusedRegistration(f"{url} cannot speak for the platform {issuer!r}. {_BY_HAND}")
    content: dict[str, Any] = {"issuer": issuer}
    for field, name in _ENDPOINTS.items():
        content[field] = checked_address(name, _text(described, name), local=local)
    if "authorization_server" in described:
        content["token_audience"] = _text(described, "authorization_server")
    return content


def _text(content: Mapping[str, Any], name: str) -> str:
    value = content.get(name)
    if not isinstance(value, str) or not value:
        raise RefusedRegistration(f"The platform does not say its {name}. {_BY_HAND}")
    return value


@contextmanager
def _refusing() -> Iterator[None]:
    try:
        yield
    except (TypeError, ValueError) as error:
        raise RefusedRegistration(str(error)) from None


def _origin(address: str) -> tuple[str, str]:
    parts = urlsplit(address)
    return parts.scheme, parts.netloc
