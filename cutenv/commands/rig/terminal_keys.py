"""Keys of a terminal as they are pressed: without Enter or echo, and with its mode restored afterwards."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from cutenv.rig.errors import RigError
from cutenv.rig.operation.jogging import JogKey, KeyDecoder


class TerminalKeys:
    """:class:`cutenv.rig.operation.jogging.Keyboard` that reads a terminal in cbreak mode.

    See :func:`terminal_keys`.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._decoder = KeyDecoder()

    def read(self) -> list[JogKey]:
        """Return the keys pressed since the last call; a terminal that is gone yields quit."""
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
    """Read keys of a terminal, standard input by default; its mode is restored in any case.

    Text typed before is discarded.

    Raises
    ------
    RigError
        If it is not a terminal, or the system has none that can be read key by key.
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
