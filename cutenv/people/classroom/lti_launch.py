"""Launch from a learning platform (LTI 1.3), and its checks.

The browser that comes back must be the one that was sent: it holds a secret as a cookie, from which alone state and
nonce follow, both of one platform.  So nothing is stored when anybody begins, and nothing of a browser's storage for
other sites is needed.  See the Security Framework of 1EdTech, version 1.0, sections 5.1.1 to 5.1.3.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode, urlsplit

from cutenv.people.classroom.lti_grades import HIGHEST_GRADE, SCORE_SCOPE
from cutenv.people.classroom.lti_keys import BadToken, PlatformKeys, ToolKey, unverified_claims, verified_claims
from cutenv.people.classroom.lti_people import Learner, LtiPeople
from cutenv.people.classroom.lti_platforms import Platform, PlatformFile, checked_address

RESOURCE_LINK, DEEP_LINKING = "LtiResourceLinkRequest", "LtiDeepLinkingRequest"
"""Messages that are taken."""
_CLAIM = "https://purl.imsglobal.org/spec/lti/claim/"
_AGS = "https://purl.imsglobal.org/spec/lti-ags/claim/endpoint"
_NRPS = "https://purl.imsglobal.org/spec/lti-nrps/claim/namesroleservice"
_DL = "https://purl.imsglobal.org/spec/lti-dl/claim/"
_ROLE = "http://purl.imsglobal.org/vocab/lis/v2/membership#"
_LEARNER, _INSTRUCTOR = f"{_ROLE}Learner", f"{_ROLE}Instructor"
_VERSION, _MEMBERS_VERSION = "1.3.0", "2.0"
_SKEW, _OLDEST = 60.0, 600.0  # [s] by which clocks may differ; since a launch was made
_STATE = re.compile(r"[0-9a-f]{64}")
_TASK = "cutenv_task"  # custom parameter of a link
_CHOSEN_WITHIN = 3600  # [s]
_OTHER_BROWSER = (
    "This browser did not begin this launch, or keeps no cookies here. Open the activity again, in a new window."
)
_MAX_CHARACTERS, _MAX_TIME = 255, 1e12  # characters of an identifier; [s] from 1970


class RefusedLaunch(ValueError):
    """Launch that proves too little or fits no use, with cure."""


@dataclass(frozen=True, kw_only=True)
class Launch:
    """Launch that has proved where it comes from."""

    platform: Platform
    claims: Mapping[str, Any]

    @property
    def is_choice(self) -> bool:
        """True if an instructor chooses a link's target (deep linking)."""
        return bool(self.claims[f"{_CLAIM}message_type"] == DEEP_LINKING)

    @property
    def is_instructors(self) -> bool:
        """True if the person is an instructor of this course."""
        return _INSTRUCTOR in self.claims[f"{_CLAIM}roles"]

    @property
    def course(self) -> str:
        """Identifier of the platform's course; "" if there is none."""
        return _text(self._part("context").get("id"))

    @property
    def class_name(self) -> str:
        """Short course name that serves as class, or ""."""
        return _text(self._part("context").get("label"), 32).strip()

    @property
    def may_teach(self) -> bool:
        """True if the person may open the teacher's pages as course instructor."""
        return self.is_instructors and bool(self.course) and self.course in self.platform.teacher_courses

    @property
    def members_url(self) -> str:
        """Address of the platform's member list, or ""."""
        offered = _table(self.claims.get(_NRPS))
        versions = offered.get("service_versions")
        if not isinstance(versions, list) or _MEMBERS_VERSION not in versions:
            return ""
        return _text(offered.get("context_memberships_url"), 1000)

    def _part(self, name: str) -> Mapping[str, Any]:
        return _table(self.claims.get(f"{_CLAIM}{name}"))

    @property
    def learner(self) -> Learner:
        """Person of the launch, as stored; RefusedLaunch if no learner."""
        if _LEARNER not in self.claims[f"{_CLAIM}roles"]:
            raise RefusedLaunch(
                "You are no learner of this course on the learning platform. Ask its teacher to enrol you."
            )
        grades = _table(self.claims.get(_AGS))
        scopes, line_item = grades.get("scope"), _text(grades.get("lineitem"), 1000)
        if line_item and isinstance(scopes, list) and SCORE_SCOPE in scopes:
            _checked("lineitem", line_item, self.platform)
        else:
            line_item = ""
        return Learner(
            issuer=self.platform.issuer,
            client_id=self.platform.client_id,
            deployment=self.claims[f"{_CLAIM}deployment_id"],
            subject=self.claims["sub"],
            class_name=self.class_name,
            line_item=line_item,
            task=_text(self._part("custom").get(_TASK), 200),
        )

    @property
    def return_url(self) -> str:
        """Address that takes the choice; RefusedLaunch without one."""
        settings = _table(self.claims.get(f"{_DL}deep_linking_settings"))
        accepted = settings.get("accept_types")
        if not isinstance(accepted, list) or "ltiResourceLink" not in accepted:
            raise RefusedLaunch("The learning platform takes no links here. Add the class as an activity.")
        if not self.is_instructors:
            raise RefusedLaunch("A teacher of the course on the learning platform chooses here. You are none.")
        address = _text(settings.get("deep_link_return_url"), 4000)
        return _checked("deep_link_return_url", address, self.platform)

    def choices(self, key: ToolKey, launch_url: str, titles: Mapping[str, str], now: Any) -> dict[str, str]:
        """Return signed answers, links with titles by task, "" for the course."""
        settings = _table(self.claims.get(f"{_DL}deep_linking_settings"))
        shared = {
            "iss": self.platform.client_id,
            "nonce": secrets.token_hex(16),
            f"{_CLAIM}deployment_id": self.claims[f"{_CLAIM}deployment_id"],
            f"{_CLAIM}message_type": "LtiDeepLinkingResponse",
            f"{_CLAIM}version": _VERSION,
        }
        if "data" in settings:
            shared[f"{_DL}data"] = settings["data"]
        made = {}
        for task, title in titles.items():
            item: dict[str, Any] = {
                "type": "ltiResourceLink", "title": title, "url": launch_url,
                "lineItem": {"scoreMaximum": HIGHEST_GRADE, "label": title}, "window": {"targetName": "_blank"},
            }  # fmt: skip
            if task:
                item["custom"] = {_TASK: task}
            claims = shared | {f"{_DL}content_items": [item]}
            made[task] = key.signed(claims, self.platform.issuer, now, _CHOSEN_WITHIN)
        return made


class LaunchDoor:
    """Door through which launches come in."""

    def __init__(self, file: PlatformFile, people: LtiPeople, clock: Any, keys: PlatformKeys | None = None) -> None:
        self._file, self._people, self._clock = file, people, clock
        self._keys = PlatformKeys() if keys is None else keys

    def sign_in(self, asked: Mapping[str, str], redirect_url: str) -> tuple[str, str, str]:
        """Return redirect address, state and browser secret of a sign-in request.

        The platform is to send the launch to ``redirect_url``. Raises RefusedLaunch if the class is not registered
        there, or a parameter is missing.
        """
        for name in ("iss", "login_hint", "target_link_uri"):
            if not asked.get(name):
                raise RefusedLaunch(
                    f"The request of the learning platform has no {name}. Open the activity there again."
                )
        client = asked.get("client_id", "")
        found = self._file.find(asked["iss"], [client] if client else ())
        if len(found) != 1:
            raise RefusedLaunch(_unknown(asked["iss"], client))
        (platform,) = found
        deployment = asked.get("lti_deployment_id", "")
        if deployment and deployment not in platform.deployments:
            raise RefusedLaunch(_no_deployment(deployment))
        secret = secrets.token_urlsafe(32)
        state = _derived("state", secret, platform)
        sent = {
            "scope": "openid", "response_type": "id_token", "response_mode": "form_post", "prompt": "none",
            "client_id": platform.client_id, "redirect_uri": redirect_url, "login_hint": asked["login_hint"],
            "state": state, "nonce": _derived("nonce", secret, platform),
        }  # fmt: skip
        if hint := asked.get("lti_message_hint"):
            sent["lti_message_hint"] = hint
        joint = "&" if urlsplit(platform.auth_url).query else "?"
        return f"{platform.auth_url}{joint}{urlencode(sent)}", state, secret

    def enter(self, token: str, state: str, secret: str) -> Launch:
        """Return a launch that is sound, and use it up.

        Token and state are sent by the platform, the secret is what the browser has kept, or "". Raises RefusedLaunch,
        or PlatformUnreachable if the platform's keys cannot be had.
        """
        if not secret or not _STATE.fullmatch(state):
            raise RefusedLaunch(_OTHER_BROWSER)
        try:
            head, stated = unverified_claims(token)
        except BadToken as error:
            raise RefusedLaunch(f"The launch is no signed token: {error}.") from None
        platform = self._platform(stated)
        if not hmac.compare_digest(state, _derived("state", secret, platform)):
            raise RefusedLaunch(_OTHER_BROWSER)
        if head.get("alg") != "RS256":
            raise RefusedLaunch(f"The launch is signed by {head.get('alg')!r}, which is not RS256.")
        kid = head.get("kid")
        key = self._keys.find(platform, kid) if isinstance(kid, str) else None
        if key is None:
            raise RefusedLaunch(f"The launch is signed by the key {kid!r}, which the platform does not have.")
        try:
            claims = verified_claims(token, key)
        except BadToken:
            raise RefusedLaunch("The signature of the launch does not hold.") from None
        self._check(claims, platform, _derived("nonce", secret, platform))
        if not self._people.use_once(claims["nonce"]):
            raise RefusedLaunch("This launch was used before. Open the activity again.")
        return Launch(platform=platform, claims=claims)

    def _platform(self, claims: Mapping[str, Any]) -> Platform:
        """Return the platform that a launch names, for this class."""
        issuer, audience = claims.get("iss"), _audience(claims)
        found = self._file.find(issuer, audience) if isinstance(issuer, str) and audience else []
        if len(found) != 1:
            raise RefusedLaunch(_unknown(issuer, ", ".join(audience)))
        return found[0]

    def _check(self, claims: Mapping[str, Any], platform: Platform, nonce: str) -> None:
        now = self._clock().timestamp()
        party, several = claims.get("azp"), len(_audience(claims)) > 1
        if (party is not None or several) and party != platform.client_id:
            raise RefusedLaunch(f"The launch is meant for {party!r}, not for this class.")
        if not _number(claims, "exp") > now - _SKEW:
            raise RefusedLaunch("The launch is too old. Open the activity again.")
        if not now - _OLDEST <= _number(claims, "iat") <= now + _SKEW:
            raise RefusedLaunch(
                "The launch is too old, or a clock is wrong. Set the clocks, and open the activity again."
            )
        if "nbf" in claims and not _number(claims, "nbf") <= now + _SKEW:
            raise RefusedLaunch("The launch is not valid yet: a clock is wrong. Set the clocks.")
        if not hmac.compare_digest(_text(claims.get("nonce")).encode(), nonce.encode()):
            raise RefusedLaunch("The launch answers no request of this browser. Open the activity again.")
        deployment = claims.get(f"{_CLAIM}deployment_id")
        if not isinstance(deployment, str) or deployment not in platform.deployments:
            raise RefusedLaunch(_no_deployment(deployment))
        kind, version = claims.get(f"{_CLAIM}message_type"), claims.get(f"{_CLAIM}version")
        if version != _VERSION:
            raise RefusedLaunch(f"The launch is of version {version!r}, not {_VERSION}.")
        if kind not in (RESOURCE_LINK, DEEP_LINKING):
            raise RefusedLaunch(f"The launch is a message {kind!r}, of which the class has no use.")
        subject = claims.get("sub")
        if not isinstance(subject, str) or not 1 <= len(subject) <= _MAX_CHARACTERS or not subject.isprintable():
            raise RefusedLaunch("The launch does not say who comes. Sign in to the learning platform.")
        roles = claims.get(f"{_CLAIM}roles")
        if not isinstance(roles, list) or not all(isinstance(each, str) for each in roles):
            raise RefusedLaunch("The launch names no roles.")
        link = _table(claims.get(f"{_CLAIM}resource_link")).get("id")
        if kind == RESOURCE_LINK and not _text(link):
            raise RefusedLaunch("The launch names no link of the learning platform.")


def _derived(what: str, secret: str, platform: Platform) -> str:
    """Return a launch's state or nonce, which reveals neither secret nor the other."""
    return hashlib.sha256("\0".join((what, secret, *platform.key)).encode()).hexdigest()


def _unknown(issuer: Any, client: str) -> str:
    return (
        f"The class is not registered with the platform {issuer!r} as the client {client!r}. "
        "Its teacher registers it on the page of learning platforms."
    )


def _no_deployment(deployment: Any) -> str:
    return (
        f"The deployment {deployment!r} of the platform is not one that the class knows. "
        "Its teacher adds it on the page of learning platforms."
    )


def _audience(claims: Mapping[str, Any]) -> list[str]:
    given = claims.get("aud")
    given = given if isinstance(given, list) else [given]
    return given if all(isinstance(each, str) for each in given) else []


def _number(claims: Mapping[str, Any], name: str) -> float:
    value = claims.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _MAX_TIME:  # NaN is not, too
        raise RefusedLaunch(f"The launch has no {name}.")
    return float(value)


def _text(value: Any, longest: int = _MAX_CHARACTERS) -> str:
    """Return a claim's text, "" if missing, too long or unprintable."""
    return value if isinstance(value, str) and len(value) <= longest and value.isprintable() else ""


def _table(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _checked(field: str, address: str, platform: Platform) -> str:
    try:
        return checked_address(field, address, local=platform.is_local)
    except ValueError as error:
        raise RefusedLaunch(str(error)) from None
