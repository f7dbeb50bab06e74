"""Cut by mouse or gamepad in a window; every cut is recorded, and scored as an agent's would be."""

from __future__ import annotations

import argparse
import secrets
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from cutenv.tissue.specimen import CLASSES

_EXTRA = ("pygame", "pymunk")


def main(argv: Sequence[str]) -> int:
    """Run the command; return 0, 1 without the extra, or 2 if an option is bad."""
    arguments = _parser().parse_args(argv)
    missing = [name for name in _EXTRA if find_spec(name) is None]
    if missing:
        print(f"cutenv play: {' and '.join(missing)} not installed: pip install 'cutenv[play]'", file=sys.stderr)
        return 1
    try:
        _play(arguments)
    except (OSError, ValueError) as error:
        print(f"cutenv play: {error}", file=sys.stderr)
        return 2
    return 0


def _play(arguments: argparse.Namespace) -> None:
    from cutenv.play.devices import MouseDevice
    from cutenv.play.session import COUNTDOWN, Session
    from cutenv.play.window import PlayWindow

    if arguments.picture is not None and not arguments.picture.absolute().parent.is_dir():
        raise FileNotFoundError(f"--picture {arguments.picture}: no such folder; make it first.")
    session = Session(
        MouseDevice(),
        specimen_class=arguments.specimen_class,
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="cutenv play",
        description=__doc__,
        epilog="Space begins and goes on, r repeats, c chooses the class, p shows what is hidden, esc ends. "
        "Training feedback for research; not validated for assessment or credentialing of people.",
    )
    parser.add_argument("--class", dest="specimen_class", choices=CLASSES, default="liver", help="default liver")
    parser.add_argument("--operator", metavar="CODE", help="anonymous code for the records, such as P07")
    parser.add_argument("--seed", type=int, help="of the specimens; default: another every time, and recorded")
    parser.add_argument("--practice", action="store_true", help="show what is hidden; the records say so")
    parser.add_argument("--cuts", type=int, metavar="N", help="end after so many; default when you like")
    parser.add_argument("--out", type=Path, default=Path("cuts"), metavar="FOLDER", help="for records; default cuts/")
    parser.add_argument(
        "--scripted",
        action="store_true",
        help="a simple hand cuts (one cut unless --cuts), as fast as it can be drawn: for demonstrations and tests; "
        "with SDL_VIDEODRIVER=dummy it needs no display",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="PNG of the last picture")
    return parser
