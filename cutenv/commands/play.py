"""Cut by mouse or gamepad in a window; every cut is recorded, and scored as an agent's would be."""

from __future__ import annotations

import argparse
import secrets
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from cutenv.commands.options import (
    add_specimen_class,
    add_target_length,
    command_parser,
    made_folder,
    reports_errors,
    target_length,
)

_EXTRA = ("pygame", "pymunk")


@reports_errors("play")
def main(argv: Sequence[str]) -> int:
    """Run the command; return 0, 1 without the extra, or 2 if an option is bad."""
    arguments = _parser().parse_args(argv)
    missing = [name for name in _EXTRA if find_spec(name) is None]
    if missing:
        print(f"cutenv play: {' and '.join(missing)} not installed: pip install 'cutenv[play]'", file=sys.stderr)
        return 1
    from cutenv.play.devices import MouseDevice
    from cutenv.play.play_session import COUNTDOWN, Session
    from cutenv.play.play_window import PlayWindow
    from cutenv.viewer.window import open_display

    length = target_length(arguments)
    open_display()  # before what takes half a minute where it has to be compiled
    print("preparing the first specimen ...", file=sys.stderr, flush=True)
    if arguments.picture is not None:
        made_folder("--picture", arguments.picture.parent)
    session = Session(
        MouseDevice(),
        specimen_class=arguments.specimen_class,
        target_length=length,
        seed=secrets.randbelow(2**31) if arguments.seed is None else arguments.seed,
        folder=arguments.out,
        operator=arguments.operator,
        practice=arguments.practice,
        countdown=0.0 if arguments.scripted else COUNTDOWN,
        cuts=1 if arguments.scripted and arguments.cuts is None else arguments.cuts,
        handle=True,
    )
    window = PlayWindow(session, scripted=arguments.scripted)
    try:
        window.run()
    finally:
        for path in session.records:
            print(f"record: {path}")
    if session.card is not None:
        print(session.card.headline())
    if session.records:
        print(f"in full: cutenv score {session.records[-1]}")
    if arguments.picture is not None:
        window.save(arguments.picture)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "play",
        __doc__,
        examples=("--operator P07", "--specimen-class uniform --practice", "--cuts 10 --target-length 80mm --out cuts"),
        note="Space begins and goes on, r repeats, c chooses the class, p shows what is hidden, m frees the mouse,\n"
        "F11 fills the screen, esc ends.\n"
        "Training feedback for research; not validated for assessment or credentialing of people.",
    )
    add_specimen_class(parser, "liver")
    add_target_length(parser, "drawn from 60mm to 100mm")
    parser.add_argument("--operator", metavar="CODE", help="anonymous code in the records, such as P07")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="seed of the specimens, for the same ones again; default a new one"
    )
    parser.add_argument("--practice", action="store_true", help="show what is hidden; the records are marked so")
    parser.add_argument("--cuts", type=int, metavar="N", help="number of cuts after which to end; default no end")
    parser.add_argument(
        "--out", type=Path, default=Path("cuts"), metavar="FOLDER", help="folder of the records; default cuts"
    )
    parser.add_argument(
        "--scripted",
        action="store_true",
        help="let a simple script move the hand (one cut unless --cuts), as fast as it can be drawn; with "
        "SDL_VIDEODRIVER=dummy it needs no display",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="PNG of the last picture to write")
    return parser
