"""Pages for learning platforms (LTI 1.3): launch, consent, deep linking, registration."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, TypeVar
from urllib.parse import urlencode, urlsplit

import anyio
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Route

from cutenv._base.document import script_digest
from cutenv.display.report.page import translated
from cutenv.people.classroom.class_site import LAUNCH_PATHS, ClassSite, Pages, text_of
from cutenv.people.classroom.host_names import is_loopback
from cutenv.people.classroom.lti_keys import BadToken
from cutenv.people.classroom.lti_launch import Launch, RefusedLaunch
from cutenv.people.classroom.lti_members import course_rosters
from cutenv.people.classroom.lti_people import Learner
from cutenv.people.classroom.lti_platforms import Platform, PlatformUnreachable, platform_of
from cutenv.people.classroom.lti_registration import RefusedRegistration, RegistrationDesk
from cutenv.people.classroom.lti_tool import LtiTool
from cutenv.people.play.course import course_name

T = TypeVar("T")

_LOGIN, _LAUNCH, _CHOOSE = LAUNCH_PATHS
_PATHS = {"login": _LOGIN, "launch": _LAUNCH, "choose": _CHOOSE, "jwks": "/lti/jwks"}
_ASKED = ("iss", "login_hint", "target_link_uri", "client_id", "lti_deployment_id", "lti_message_hint")
_FRAMES = ("iframe", "frame", "embed", "object")
_SUBMIT = (
    'const form = document.getElementById("launch");\nform.querySelector("button").disabled = true;\nform.submit();\n'
)
_CLOSE = '(window.opener || window.parent).postMessage({subject: "org.imsglobal.lti.close"}, "*");\n'
_CONSENT, _CONSENT_WITHIN = "consent", 900  # audience of what a person is to agree to; [s]
_STATE_KEPT = 600  # [s]
_AT_ONCE = 4  # launches that are checked at once, each of which may wait for a platform
_LONGEST_TROUBLE = 600


class LtiPages(Pages):
    """Pages and answers for learning platforms."""

    def __init__(self, site: ClassSite, tool: LtiTool) -> None:
        super().__init__(site)
        self._tool = tool
        self._desk = RegistrationDesk(tool, site.lesson.store.clock, site.title, _PATHS)
        self._limit = anyio.CapacityLimiter(_AT_ONCE)

    @property
    def routes(self) -> list[Route]:
        """Routes of these pages."""
        route, framed = partial(self._site.teachers_route, limiter=self._limit), self._framed
        return [
            Route(_LOGIN, framed(self.login), methods=["GET", "POST"]),
            Route(_LAUNCH, framed(self.launch), methods=["POST"]),
            Route(_CHOOSE, framed(self.launch), methods=["POST"]),
            Route("/lti/enter", framed(self.enter), methods=["POST"]),
            Route("/lti/agree", framed(self.agree), methods=["POST"]),
            Route(_PATHS["jwks"], self.jwks, methods=["GET"]),
            Route("/lti/register/{invitation}", framed(self.registered), methods=["GET"]),
            route("GET", "/teacher/platforms", lambda request, _: self.platforms(request, {})),
            route("POST", "/teacher/platforms", self.register),
            route("GET", "/teacher/members", self.members),
        ]  # fmt: skip

    def _framed(self, answer: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
        """Return an answer whose refusals may be shown in a frame."""

        async def answered(request: Request) -> Response:
            try:
                return await answer(request)
            except PlatformUnreachable as error:
                return self._page("trouble.html", 502, trouble=self._said(str(error)))
            except (RefusedLaunch, RefusedRegistration, BadToken) as error:
                return self._page("trouble.html", 403, trouble=self._said(str(error)))

        return answered

    def _said(self, trouble: str) -> str:
        return translated(trouble[:_LONGEST_TROUBLE], self._site.language)

    async def _in_thread(self, called: Callable[..., T], *given: Any, **named: Any) -> T:
        """Run a call that may wait for a platform in separate threads."""
        return await anyio.to_thread.run_sync(partial(called, *given, **named), limiter=self._limit)

    def _page(self, name: str, status: int = 200, *, script: str = "", form: str = "'self'", **values: Any) -> Response:
        """Return a page that is harmless inside another site's frame."""
        answer = self._site.page(name, status, **values)
        run = f" script-src 'sha256-{script_digest(script)}';" if script else ""
        answer.headers["Content-Security-Policy"] = (
            f"default-src 'none'; style-src 'unsafe-inline';{run} form-action {form}; frame-ancestors *"
        )
        return answer

    async def login(self, request: Request) -> Response:
        """Redirect a platform's login request back to sign in there."""
        if not (request.url.scheme == "https" or is_loopback(request.url.hostname or "")):
            raise RefusedLaunch("The class is not served over https. Start it with --certificate and --key.")
        given: Any = request.query_params if request.method == "GET" else await request.form()
        asked = {name: value for name in _ASKED if isinstance(value := given.get(name), str) and value}
        base = str(request.base_url).rstrip("/")
        address, state, secret = await self._in_thread(self._tool.door.sign_in, asked, base + _LAUNCH)
        chooses = urlsplit(asked["target_link_uri"]).path == _CHOOSE
        if request.headers.get("sec-fetch-dest") in _FRAMES and not chooses:
            return self._page("lti_window.html", again=f"login?{urlencode(asked)}")
        response = RedirectResponse(address, 303)
        # In a frame of the platform's page nothing but a partitioned cookie is kept, and that over https alone.
        kind = "SameSite=None; Secure; Partitioned" if request.url.scheme == "https" else "SameSite=Strict"
        cookie = f"{self._cookie(state)}={secret}; Max-Age={_STATE_KEPT}; Path=/lti; HttpOnly; {kind}"
        response.headers.append("Set-Cookie", cookie)
        return response

    def _cookie(self, state: str) -> str:
        return f"{self._site.person_cookie}_{state[:16] if state.isalnum() and state.isascii() else ''}"

    async def launch(self, request: Request) -> Response:
        """Resend a launch from the class's own page, with its cookies."""
        form = await request.form()
        if trouble := text_of(form, "error_description") or text_of(form, "error"):
            raise RefusedLaunch(f"The learning platform says: {trouble}")
        sent = {name: text_of(form, name) for name in ("id_token", "state")}
        return self._page("lti_launch.html", script=_SUBMIT, code=_SUBMIT, sent=sent)

    async def enter(self, request: Request) -> Response:
        """Admit a sound launch: an instructor or a learner."""
        form = await request.form()
        state = text_of(form, "state")
        secret = request.cookies.get(self._cookie(state), "")
        launch = await self._in_thread(self._tool.door.enter, text_of(form, "id_token"), state, secret)
        answer = await self._in_thread(self._let_in, launch, str(request.base_url).rstrip("/") + _LAUNCH)
        answer.delete_cookie(self._cookie(state), path="/lti")
        return answer

    def _let_in(self, launch: Launch, launch_url: str) -> Response:
        if launch.course and launch.course in launch.platform.teacher_courses:  # of no other one are members shown
            self._tool.people.note_members_url(*launch.platform.key, launch.course, launch.members_url)
        if launch.is_choice:
            return self._choice(launch, launch_url)
        if launch.may_teach:
            return self._site.sign_in(self._site.teacher_name, "../teacher")
        if launch.is_instructors:
            return self._page("lti_instructor.html", course=launch.course)
        learner = launch.learner
        code = self._tool.people.code_of(learner)
        # Where cuts are sent on, too, everybody agrees at every sign-in, as by a code.
        if code is not None and self._site.courier is None and (code, True) in self._lesson.store.codes():
            return self._site.sign_in(self._tool.people.enter(learner), "../cut")
        ticket = self._tool.key.signed(learner._asdict(), _CONSENT, self._lesson.store.clock(), _CONSENT_WITHIN)
        return self._site.page("lti_agree.html", ticket=ticket, platform=launch.platform.title, trouble="")

    async def agree(self, request: Request) -> Response:
        """Sign in a person who consents; nothing was stored before."""
        return await self._in_thread(self._agreed, await request.form())

    def _agreed(self, form: FormData) -> Response:
        ticket, store = text_of(form, "ticket"), self._lesson.store
        try:
            claims = self._tool.key.opened(ticket, _CONSENT, store.clock())
        except BadToken:
            raise RefusedLaunch("You took too long. Open the activity again.") from None
        learner = Learner(**{name: claims[name] for name in Learner._fields})
        if form.get("consent") != "yes":
            names = [each.title for each in self._tool.file.find(learner.issuer, [learner.client_id])]
            trouble, platform = self._site.words["no_consent"], "".join(names)
            return self._site.page("lti_agree.html", 403, ticket=ticket, platform=platform, trouble=trouble)
        code = self._tool.people.enter(learner)
        store.consent(code)
        if self._site.courier is not None:
            self._site.courier.queue.agree(code)
        return self._site.sign_in(code, "../cut")

    def _choice(self, launch: Launch, launch_url: str) -> Response:
        address, courses = launch.return_url, self._lesson.courses_open_to(launch.class_name)
        name = partial(course_name, self._site.language)
        titles = {"": name(courses[0].name) if len(courses) == 1 else self._site.title}
        titles |= {each.name: name(each.name) for course in courses for each in course.tasks}
        answers = launch.choices(self._tool.key, launch_url, titles, self._lesson.store.clock())
        origin = "{0.scheme}://{0.netloc}".format(urlsplit(address))
        return self._page(
            "lti_choose.html",
            form=origin,
            origin=origin,
            address=address,
            answers=answers,
            titles=titles,
            courses=[(name(course.name), [each.name for each in course.tasks]) for course in courses],
        )

    async def jwks(self, request: Request) -> Response:
        """Answer with the class's public key, for platforms."""
        return JSONResponse(await self._in_thread(lambda: self._tool.key.public))

    def platforms(
        self, request: Request, filled: dict[str, str], trouble: str = "", *, invite: bool = False
    ) -> Response:
        """Show the registrations, and the grades that go to the platforms."""
        base = str(request.base_url).rstrip("/")
        safe = request.url.scheme == "https" or is_loopback(request.url.hostname or "")
        invitation = f"{base}/lti/register/{self._desk.invite(base)}" if invite and safe else ""
        return self._site.page(
            "lti_platforms.html", 422 if trouble else 200, root="../", platforms=self._tool.file.platforms,
            rows=self._tool.people.grades(), filled=filled, trouble=trouble, troubles=self._tool.troubles(),
            fields=_FIELDS, safe=safe, addresses={name: base + path for name, path in _PATHS.items()},
            invitation=invitation,
        )  # fmt: skip

    async def registered(self, request: Request) -> Response:
        """Register the class with an invited platform and close its window."""
        asked = [request.query_params.get(name, "") for name in ("openid_configuration", "registration_token")]
        platform = await self._in_thread(self._desk.register, request.path_params["invitation"], *asked)
        return self._page("lti_registered.html", script=_CLOSE, code=_CLOSE, platform=platform)

    def members(self, _: Request, __: FormData) -> Response:
        """Show who of the platforms' courses has cut, by name."""
        rosters = list(course_rosters(self._tool, self._lesson))
        return self._site.page("lti_members.html", root="../", rosters=rosters)

    def register(self, request: Request, form: FormData) -> Response:
        """Add, invite or remove a platform, or resend refused grades."""
        do = text_of(form, "do")
        if do == "invite":
            return self.platforms(request, {}, invite=True)
        if do == "again":
            self._tool.grades.send_again()
        elif do == "drop":
            self._tool.file.drop(text_of(form, "issuer"), text_of(form, "client_id"))
        elif do == "add":
            filled = {name: text_of(form, name).strip() for name in _FIELDS}
            try:
                self._tool.file.add(_platform_of(filled))
            except (TypeError, ValueError) as error:
                return self.platforms(request, filled, self._said(str(error)))
        else:
            raise HTTPException(422, f"do = {do!r} is none of add, invite, drop, again.")
        return RedirectResponse("platforms", 303)


_FIELDS = {
    "name": False, "issuer": True, "client_id": True, "auth_url": True, "token_url": True, "jwks_url": True,
    "deployments": True, "token_audience": False, "teacher_courses": False,
}  # fmt: skip
"""Fields of the form, and whether each is needed."""


def _platform_of(filled: dict[str, str]) -> Platform:
    """Return a form's platform, from lists separated by commas."""
    content: dict[str, Any] = dict(filled)
    for name in ("deployments", "teacher_courses"):
        content[name] = [part.strip() for part in filled[name].split(",") if part.strip()]
    return platform_of(content)
