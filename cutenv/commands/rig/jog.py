"""Move the blade while an arrow key is held: right away from the clamp, q ends.

Left moves it back, up and down turn it. On a rig with a height axis u raises and d lowers it, with an axis to the side
l moves it left and r right, while held. A terminal reports a held key by repeating it: within 0.2 s after the last
repeat the blade is commanded to rest (0.4 mm at 2 mm/s). A tap moves it for that long; a held key moves it once,
pauses, then follows the terminal's repeats.
Any other key stops it at once. A software stop is not a safety function: keep the stop button in reach.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import date
from typing import TextIO

from cutenv.commands.options import RIG, command_parser
from cutenv.commands.rig import reports_rig_errors
from cutenv.commands.rig.connection import connected
from cutenv.rig.devices.loop import PacedClock
from cutenv.rig.errors import RigError
from cutenv.rig.operation.jogging import SPEED, TOP_SPEED, Jog, JogKey, KeyDecoder, jog
from cutenv.rig.operation.operator import operator_of
from cutenv.rig.operation.preflight import prepare


class TerminalKeys:
    """:class:`cutenv.rig.operation.jogging.Keyboard` that reads a terminal in cbreak mode.

    See :func:`terminal_keys`.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._decoder = KeyDecoder()

    def read(self) -> list[JogKey]:
        """Return keys pressed since the last call; quit after hang-up."""
        import select

        keys: list[JogKey] = []
        while select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                data = os.read(self._descriptor, 1024)
            except OSError:  # hung up
                data = b""
            if not data:
                return [*keys, JogKey.QUIT]
            keys += self._decoder.feed(data)
        return keys


@contextmanager
def terminal_keys(source: TextIO | None = None) -> Iterator[TerminalKeys]:
    """Read keys of a terminal; restore its mode at the end.

    Standard input by default. Text typed before is discarded. Raise RigError if it is not a terminal, or the system has
    none that can be read key by key.
    """
    check_terminal(source)
    import termios
    import tty

    descriptor = (source or sys.stdin).fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor, termios.TCSAFLUSH)  # Ctrl-C stays a signal, which stops the blade
        yield TerminalKeys(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSAFLUSH, before)


def check_terminal(source: TextIO | None = None) -> None:
    """Raise RigError unless keys can be read there."""
    if os.name == "nt":
        raise RigError("keys can be read one by one on Linux and macOS only. Run the rig from there.")
    if not (source or sys.stdin).isatty():
        raise RigError("jogging needs a terminal, and standard input is none. Run the command without a pipe.")


_CLEAR_LINE = "\r\x1b[K"


@reports_rig_errors("jog")
def main(argv: Sequence[str]) -> int:
    """Jog until q; return 0, 1 (refused, stopped), 2 (bad input), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
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
    return 0


def _show(line: str) -> None:
    print(f"{_CLEAR_LINE}{line}", end="", flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("rig jog", __doc__, examples=("my_rig.toml", "my_rig.toml --speed 1"))
    add = parser.option
    add("rig RIG", RIG)
    add(
        "--speed MM_S",
        f"speed while a key is held [mm/s], up to {1e3 * TOP_SPEED:g}; default {1e3 * SPEED:g}",
        float,
        default=1e3 * SPEED,
    )
    return parser
