"""Serve a class that cuts in browsers, with codes and a teacher's page."""

from __future__ import annotations

import argparse
import ipaddress
import os
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv._base.language_files import ENGLISH, languages
from cutenv._base.validation import in_range
from cutenv.commands.options import (
    add_tissue,
    add_watch,
    command_parser,
    drawn_given,
    made_folder,
    made_place,
    note_missing,
    reports_errors,
)
from cutenv.people.play.course import SHIPPED_COURSES, Course, named_course
from cutenv.sim.tissue.specimen import CLASSES

if TYPE_CHECKING:
    from cutenv.people.classroom.lesson import Lesson
    from cutenv.people.classroom.lti_tool import LtiTool


@reports_errors("serve")
def main(argv: Sequence[str]) -> int:
    """Serve until Ctrl-C; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    port = round(in_range("--port", arguments.port, 0, 65535, "1", "Give a port such as 8800; 0 takes a free one."))
    if (arguments.certificate is None) != (arguments.key is None):
        raise ValueError("--certificate and --key belong together: give the files of both, or of none.")
    if (arguments.lrs is None) != (arguments.lrs_login is None):
        raise ValueError("--lrs and --lrs-login belong together: give the address and the file, or neither.")
    files = {"--certificate": arguments.certificate, "--key": arguments.key, "--lrs-login": arguments.lrs_login}
    for option, path in files.items():
        if path is not None and not path.is_file():
            raise ValueError(f"{option} {path} is no file. Give the path of one.")
    course = None if arguments.course is None else named_course(arguments.course)
    note_missing(arguments.language)
    drawn_given(arguments)  # refuses a file that is no tissue
    before = os.umask(0o077)  # records of people's movements are nobody else's on this machine
    try:
        return _serve(arguments, argv, port, course)
    finally:
        os.umask(before)


def _serve(arguments: argparse.Namespace, argv: Sequence[str], port: int, course: Course | None) -> int:
    made_folder("FOLDER", arguments.folder)
    if arguments.backup is not None:
        made_place("--backup", arguments.backup)
    if arguments.shortcut:
        from cutenv.people.classroom.desktop_shortcut import write_shortcut

        options = [each for each in argv if each not in ("--shortcut", "--open")]
        command = [sys.executable, "-m", "cutenv", "serve", *options, "--open"]
        print(f"shortcut: {write_shortcut(command, f'{arguments.title} {arguments.folder.name}')}")
        return 0

    import uvicorn

    from cutenv.people.classroom.class_backup import restore_backup, write_backup
    from cutenv.people.classroom.class_server import FolderClaim, PatientProtocol, class_app, new_token
    from cutenv.people.classroom.class_site import ClassSite
    from cutenv.people.classroom.class_store import ClassStore
    from cutenv.people.classroom.lesson import Lesson
    from cutenv.people.classroom.live_rig import LiveRig
    from cutenv.people.classroom.xapi_statements import Courier, StatementQueue

    database = arguments.folder / "class.db"
    fresh = arguments.database is None and not database.exists()
    store = ClassStore(arguments.database or f"sqlite:///{database}")
    if arguments.backup is not None:
        count = write_backup(store, arguments.folder / "records", arguments.backup)
        print(f"backup: {arguments.backup} ({count} records)")
        return 0
    if arguments.restore is not None:
        try:
            count = restore_backup(store, arguments.folder / "records", arguments.restore)
        except BaseException:
            store.close()
            for each in arguments.folder.glob("class.db*") if fresh else ():
                each.unlink()
            raise
        print(f"restored: {count} records into {arguments.folder}; 'cutenv serve {arguments.folder}' goes on")
        return 0
    lesson = Lesson(store, arguments.folder / "records", course, arguments.specimen_class, arguments.tissue)
    lti = _lti_tool(lesson, arguments.language)
    lost = lesson.recover()
    secure = arguments.certificate is not None
    token, ticket = new_token(), new_token()
    live = None if arguments.watch is None else LiveRig(arguments.watch)
    listening = _listening(arguments.host, port)
    address = f"http{'s' * secure}://{_shown_host(arguments.host)}:{listening.getsockname()[1]}/"
    claim = FolderClaim(arguments.folder, address)
    if claim.other:
        print(
            f"note: {arguments.folder} is served already, at {claim.other}, with another token for the teacher. If "
            "that is not meant, end one of the two servers, or give this one a folder of its own",
            file=sys.stderr,
        )
    courier = None
    if arguments.lrs is not None:
        login = arguments.lrs_login.read_text(encoding="utf-8").strip()
        courier = Courier(lesson, StatementQueue(store), arguments.lrs, login, address)
        courier.start()
    if lti is not None:
        lti.grades.start()
    site = ClassSite(
        lesson=lesson, secret=token, title=arguments.title, language=arguments.language, secure=secure, courier=courier,
        hosts=_names(arguments.host, arguments.name), lti=lti,
    )  # fmt: skip
    app = class_app(site, live=live, ticket=ticket)
    if lost:
        print(f"note: {lost} cut{'s were' * (lost > 1) or ' was'} going on when the server ended", file=sys.stderr)
    if not secure and not _is_loopback(arguments.host):
        print("note: without --certificate codes travel unencrypted; use it on a network of your own", file=sys.stderr)
    print(f"class: {address}\nteacher: {address}teacher with the token {token}")
    if live is not None:
        print(f"rig: {address}rig for the teacher, as soon as 'cutenv rig run ... --watch {live.port}' works")
    print("end with Ctrl-C", flush=True)
    if arguments.open:
        import webbrowser

        webbrowser.open(f"{address}teacher/open/{ticket}")
    tls: dict[str, Any] = {"ssl_certfile": arguments.certificate, "ssl_keyfile": arguments.key} if secure else {}
    settings = uvicorn.Config(
        app,
        http=PatientProtocol,
        log_level="warning",
        server_header=False,
        timeout_keep_alive=30,
        limit_concurrency=500,
        proxy_headers=False,
        **tls,
    )
    server = uvicorn.Server(settings)
    if live is not None:
        live.ended = lambda: server.should_exit
    try:
        server.run(sockets=[listening])
    except KeyboardInterrupt:
        pass  # it has let the requests at hand end
    finally:
        if courier is not None:
            courier.close()
        if lti is not None:
            lti.grades.close()
        lesson.close()
        claim.close()
    return 0


def _lti_tool(lesson: Lesson, language: str) -> LtiTool | None:
    """Return the class as an LTI tool, or None."""
    from cutenv.people.classroom.lti_platforms import PLATFORMS_FILE

    try:
        from cutenv.people.classroom.lti_tool import LtiTool
    except ModuleNotFoundError:
        if (lesson.folder.parent / PLATFORMS_FILE).exists():
            raise
        return None
    tool = LtiTool(lesson, language)
    if tool.file.platforms == () and tool.file.trouble:
        lesson.close()
        raise ValueError(tool.file.trouble)
    return tool


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(256)  # who comes before the server has begun waits
    except OSError as error:
        listening.close()
        raise ValueError(
            f"cannot listen on {host} port {port}: {error.strerror}. Choose another --port or --host."
        ) from None
    return listening


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _names(host: str, further: Sequence[str]) -> frozenset[str]:
    """Return the names of this machine in a browser's address."""
    own = socket.gethostname()
    short = own.partition(".")[0]
    names = ("localhost", host, own, short, f"{short}.local", *further)
    return frozenset(name.lower() for name in names)


def _shown_host(host: str) -> str:
    if host in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "serve",
        __doc__,
        examples=(
            "class --open",
            "class --backup monday.zip",
            "class --course first --host 0.0.0.0 --certificate cert.pem --key key.pem",
        ),
        note="--backup may run beside the server; --restore makes a class from it, on any machine.",
    )
    add = parser.option
    add("folder FOLDER", "folder of the class: its database and records", Path)
    add("--course COURSE", f"course.toml, or one that is shipped: {', '.join(SHIPPED_COURSES)}")
    add("--specimen-class", "specimens without a course; default liver", "liver", choices=CLASSES)
    add_tissue(parser)
    add("--title NAME", "name of the class on its pages", "cutenv")
    add("--language", "language of the pages; default en", ENGLISH, choices=languages())
    add("--host ADDRESS", "address to listen on; default 127.0.0.1: this machine", "127.0.0.1")
    add("--name HOST", "further name of this machine in browsers' addresses", action="append", default=[])
    add("--port N", "port; default 8800, 0 takes a free one", 8800)
    add("--certificate FILE", "certificate (PEM), for https", Path)
    add("--key FILE", "its private key (PEM)", Path)
    add("--database URL", "postgresql+psycopg://...; default SQLite in FOLDER")
    add_watch(parser, "show the teacher a rig's cuts live, from 'cutenv rig run --watch' on this machine")
    add("--lrs URL", "learning record store that gets an xAPI statement of every cut")
    add("--lrs-login FILE", 'file with one line, "key:secret", its login', Path)
    add("--backup ZIP", "write all that is stored to a file, and end", Path)
    add("--restore ZIP", "fill a new FOLDER from such a file, and end", Path)
    add("--open", "open the teacher's page in the browser, signed in")
    add("--shortcut", "put a shortcut with these options on the desktop, and end")
    return parser
