"""Cut by mouse or gamepad in a window, recorded and scored."""

from __future__ import annotations

import argparse
import secrets
import shlex
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands import options
from cutenv.sim.tissue.drawn_lines import KINDS
from cutenv.task.registry import TASKS

if TYPE_CHECKING:
    from cutenv.people.play.course_progress import CourseProgress
    from cutenv.people.play.shared_cut import SharingAgent

_EXTRA = ("pygame", "pymunk")
_DEFAULT_CLASS = "liver"
_EMULATED, _EMULATED_TARGET = "emulated-inverse3", 0.08  # [m]


@options.reports_errors("play")
def main(argv: Sequence[str]) -> int:
    """Play; return 0, 1 without the extra, 2 on bad input."""
    arguments = _parser().parse_args(argv)
    missing = [name for name in _EXTRA if find_spec(name) is None]
    if missing:
        print(f"cutenv play: {' and '.join(missing)} not installed: pip install 'cutenv[play]'", file=sys.stderr)
        return 1
    from cutenv.display.viewer.window import open_display
    from cutenv.people.play.inverse3 import INVERSE3_URL
    from cutenv.people.play.named_devices import named_device
    from cutenv.people.play.play_session import COUNTDOWN, ListenedSession, Session, SessionPlan
    from cutenv.people.play.play_window import PlayWindow
    from cutenv.people.play.polled_handle import HandleAxes
    from cutenv.records.foreign.lsl import LslOutlet

    course = _course_of(arguments)
    length = options.target_length(arguments)
    by_itself = arguments.scripted or arguments.device == _EMULATED
    if arguments.scripted and arguments.device != "mouse":
        raise ValueError(f"--scripted moves the hand by itself, and --device {arguments.device} has one. Give either.")
    if TASKS[arguments.task].line and arguments.device != "mouse":
        raise ValueError(
            f"--task {arguments.task} is steered by mouse, keys or gamepad: the force of --device {arguments.device} "
            "would have to act in the plane. Leave --device out."
        )
    if arguments.line is not None:
        options.check_line(arguments.line, [arguments.task])
    options.drawn_given(arguments)  # refuses a file that is no tissue
    if arguments.picture is not None:
        options.made_picture("--picture", arguments.picture)
    options.check_place("--out", arguments.out)  # made when everything else is known to be right
    agent = _agent_of(arguments)
    axes = None if arguments.axes is None else HandleAxes.parse(arguments.axes)
    open_display()  # before what takes half a minute where it has to be compiled
    print("preparing the first specimen ...", file=sys.stderr, flush=True)
    target = _EMULATED_TARGET if length is None else length
    url = arguments.device_url or INVERSE3_URL
    with named_device(arguments.device, target=target, url=url, axes=axes, shares=agent is not None) as device:
        session = Session(
            device,
            SessionPlan(
                task=arguments.task if agent is None else "shared",
                line=arguments.line,
                agent=agent,
                specimen_class=arguments.specimen_class or _DEFAULT_CLASS,
                tissue=arguments.tissue,
                target_length=length if arguments.device != _EMULATED else target,
                seed=secrets.randbelow(2**31) if arguments.seed is None else arguments.seed,
                practice=arguments.practice,
                countdown=0.0 if arguments.scripted else COUNTDOWN,
                cuts=1 if by_itself and arguments.cuts is None else arguments.cuts,
            ),
            folder=arguments.out,
            operator=arguments.operator,
            handle=True,
            course=course,
        )
        outlet = None
        if arguments.lsl:
            outlet = LslOutlet("cutenv play", scope=arguments.lsl)
            session.after_advance = ListenedSession(session, outlet)
        window = PlayWindow(session, scripted=arguments.scripted, ends=by_itself)
        try:
            window.run()
        finally:
            if outlet is not None:
                outlet.close()
            for path in session.records:
                print(f"record: {path}")
    if session.card is not None and session.sight().shown.result:
        print(session.card.headline())
        if agent is not None:
            print(session.cut.map_words)
        print(f"in full: cutenv score {shlex.quote(session.records[-1].as_posix())}")
    if course is not None:
        print(f"{course.verdict} {course.ahead()}".strip())
    if arguments.picture is not None:
        window.save(arguments.picture)
    return 0


def _agent_of(arguments: argparse.Namespace) -> SharingAgent | None:
    """Return the agent that shares the cuts, if any.

    Raise ValueError if there is no such policy, it is for another task, or an option does not go with it.
    """
    if arguments.policy is None:
        return None
    if arguments.task != "gentle" or arguments.course is not None:
        given = "--course" if arguments.course is not None else f"--task {arguments.task}"
        raise ValueError(f"--policy {arguments.policy!r} cuts gently to a length, and does not go with {given}.")
    from cutenv.agents.learning.evaluation import contestant
    from cutenv.people.play.shared_cut import SharingAgent

    found = contestant(arguments.policy)
    return SharingAgent(name=arguments.policy, policy=found.policy, arguments=found.arguments)


def _course_of(arguments: argparse.Namespace) -> CourseProgress | None:
    """Return the operator's progress in the course, or None.

    Raise ValueError if the course is not valid or done, there is no code, or an option says what the course says.
    """
    if arguments.course is None:
        return None
    from cutenv.people.play.course import named_course
    from cutenv.people.play.course_progress import CourseProgress

    given = {"--specimen-class": arguments.specimen_class, "--target-length": arguments.target_length}
    given |= {"--seed": arguments.seed, "--practice": arguments.practice or None}
    given |= {"--task": arguments.task if arguments.task != "gentle" else None, "--line": arguments.line}
    twice = [option for option, value in given.items() if value is not None]
    if twice:
        raise ValueError(f"{' and '.join(twice)} cannot be given with --course, which sets it.")
    if arguments.operator is None:
        raise ValueError("--course needs --operator CODE, such as P07: it goes on where that person stopped.")
    progress = CourseProgress(named_course(arguments.course), arguments.operator, arguments.out)
    for reason in progress.unread:
        print(f"note: not counted: {reason}", file=sys.stderr)
    if progress.task is None or progress.waits:
        raise ValueError(f"{progress.ahead()} The records are in {arguments.out}.")
    print(progress.ahead(), file=sys.stderr, flush=True)
    return progress


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "play",
        __doc__,
        examples=(
            "--operator P07",
            "--specimen-class uniform --practice",
            "--cuts 10 --target-length 80mm --out cuts",
            "--task depth --practice",
            "--task path --line excision",
            "--course first --operator P07",
            "--device emulated-inverse3 --cuts 1",
            "--policy ppo-free --operator P07",
        ),
        note="Space begins and goes on, r repeats, c chooses the class, p shows what is hidden, m frees the mouse,\n"
        "F11 fills the screen, esc ends.\n"
        "Training feedback for research; not validated for assessment or credentialing of people.",
    )
    add = parser.option
    options.add_task(parser, "played", "; a blade that also moves up and down is led by the wheel")
    add("--line", "drawn line to cut along; default mixed, which is any of them", choices=(*KINDS, "mixed"))
    add(
        "--policy POLICY",
        "share the cut with an agent, named as for 'cutenv evaluate': it cuts, and you lead while you hold space, "
        "an arrow key, the mouse button, or the first button of a handle or gamepad",
    )
    options.add_specimen_class(parser, _DEFAULT_CLASS)
    parser.set_defaults(specimen_class=None)  # so that it is known whether it was given
    options.add_tissue(parser)
    options.add_target_length(parser, "drawn from 60mm to 100mm")
    add(
        "--course COURSE",
        "file of a course, or the name of one that comes with cutenv (first, force-shown, depth, path): goes on "
        "with the operator's next task, as the records in --out tell",
    )
    add("--operator CODE", "anonymous code in the records, such as P07")
    add("--seed N", "seed of the specimens, for the same ones again; default a new one", int)
    add("--practice", "show what is hidden; the records are marked so")
    add("--cuts N", "number of cuts after which to end; default no end", int)
    add("--out FOLDER", "folder of the records; default cuts", Path("cuts"))
    add(
        "--scripted",
        "let a simple script move the hand (one cut unless --cuts), as fast as it can be drawn; with "
        "SDL_VIDEODRIVER=dummy it needs no display",
    )
    add(
        "--device",
        "device in the hand: mouse or gamepad (the default), a Haply Inverse3, one of Force Dimension, or an "
        "emulated Inverse3 whose hand cuts by itself",
        "mouse",
        choices=("mouse", "inverse3", "force-dimension", _EMULATED),
    )
    add("--device-url URL", "address of Haply's Inverse Service; default ws://localhost:10001")
    add(
        "--axes ALONG,LEAN,UP",
        "axes of a haptic device along the cut, for leaning the blade, and upwards, such as --axes=-y,x,z; a "
        "minus turns one round; default x,y,z, of Force Dimension y,x,z",
    )
    options.add_lsl(parser)
    add("--picture FILE", "PNG of the last picture to write", Path)
    return parser
