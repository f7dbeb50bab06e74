"""Move the blade while an arrow key is held: right away from the clamp, left back, up and down turn it, q ends.

On a rig with a height axis u raises and d lowers it, with an axis to the side l moves it left and r right, while held.
A terminal reports a held key by repeating it: within 0.2 s after the last repeat the blade is commanded to rest (0.4 mm
at 2 mm/s). A tap moves it for that long; a held key moves it once, pauses, then follows the terminal's repeats.
Any other key stops it at once. A software stop is not a safety function: keep the stop button in reach.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import date

from cutenv.commands.options import RIG, command_parser, reports_errors
from cutenv.commands.rig.terminal_keys import check_terminal, terminal_keys
from cutenv.rig.connection import connected, operator_of
from cutenv.rig.devices.clock import PacedClock
from cutenv.rig.errors import RigError
from cutenv.rig.operation.jogging import SPEED, TOP_SPEED, Jog, jog
from cutenv.rig.operation.preflight import prepare
from cutenv.rig.safety.stop_causes import RigStopped

_CLEAR_LINE = "\r\x1b[K"


@reports_errors("rig jog")
def main(argv: Sequence[str]) -> int:
    """Jog until q; return 0, 1 if the rig refuses or stopped the blade, or 2 if an option or the file is bad."""
    arguments = _parser().parse_args(argv)
    try:
        controls = Jog(1e-3 * arguments.speed)
        check_terminal()
        with connected(arguments.rig, clock=PacedClock()) as rig:
            prepare(rig.plant, operator_of(rig.settings), today=date.today())
            lifts, sideways = (axis is not None for axis in (rig.settings.height, rig.settings.side))
            controls = Jog(controls.speed, turns=rig.settings.angle is not None, lifts=lifts, sideways=sideways)
            across = "u, d: raise, lower; " * lifts + "l, r: to the left, to the right; " * sideways
            print(f"left, right: {1e3 * controls.speed:g} mm/s; up, down: turn; {across}q ends; any other key stops")
            with terminal_keys() as keyboard:
                try:
                    jog(rig.plant, keyboard, controls, _show)
                finally:
                    print()
    except RigError as error:
        print(f"cutenv rig jog: {'stopped: ' * isinstance(error, RigStopped)}{error}", file=sys.stderr)
        return 1
    return 0


def _show(line: str) -> None:
    print(f"{_CLEAR_LINE}{line}", end="", flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("rig jog", __doc__, examples=("my_rig.toml", "my_rig.toml --speed 1"))
    parser.add_argument("rig", metavar="RIG", help=RIG)
    parser.add_argument(
        "--speed",
        type=float,
        default=1e3 * SPEED,
        metavar="MM_S",
        help=f"speed while a key is held [mm/s], up to {1e3 * TOP_SPEED:g}; default {1e3 * SPEED:g}",
    )
    return parser
