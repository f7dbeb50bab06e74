"""Person beside the rig, who is asked before anything moves."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import Protocol, TextIO

from cutenv._base.validation import in_range
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.errors import RigError

_YES = ("y", "yes")


class Operator(Protocol):
    """Person who answers for the rig; no answer in time means no."""

    def tell(self, message: str) -> None:
        """Show a message."""
        ...

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Ask a question; return whether yes or ``expected`` was answered."""
        ...

    def ask_ready(self, what: str) -> bool:
        """Ask for manual work, such as "hands off"; return whether it is done."""
        ...


class TerminalOperator:
    """Operator at a terminal.

    Text typed before a question appears does not answer it. Ctrl-C, the end of the input (Ctrl-D) and silence mean no.
    ``patience`` [s], 1 to 3600, is allowed for an answer. Raise RigError if the source is not a terminal: then nobody
    is there to answer; ValueError if the patience is out of range.
    """

    def __init__(self, *, patience: float = 120.0, source: TextIO | None = None, sink: TextIO | None = None) -> None:
        self.patience = in_range("patience", patience, 1.0, 3600.0, "s", "Answers take seconds to minutes.")
        self._source = sys.stdin if source is None else source
        self._sink = sys.stdout if sink is None else sink
        if os.name == "nt":
            raise RigError("a terminal can be read with a time limit on Linux and macOS only. Run the rig from there.")
        if not self._source.isatty():
            raise RigError(
                "questions to the operator need a terminal, and standard input is none. Run the command in a terminal, "
                "without a pipe; only an emulated rig (emulated = true) runs without an operator."
            )

    def tell(self, message: str) -> None:
        """Print a message."""
        print(message, file=self._sink, flush=True)

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Ask for yes, or for an exactly typed text."""
        if expected is None:
            return self._asked(f"{question} [y/N] ", lambda typed: typed.strip().lower() in _YES)
        return self._asked(f'{question}\nType "{expected}" to confirm: ', lambda typed: typed == expected)

    def ask_ready(self, what: str) -> bool:
        """Ask for Enter; any other input means no."""
        return self._asked(f"{what}: press Enter when ready, anything else stops. ", lambda typed: not typed.strip())

    def _asked(self, prompt: str, accepted: Callable[[str], bool]) -> bool:
        try:
            typed = self._line(prompt)
        except KeyboardInterrupt:
            self.tell("\ninterrupted: no.")
            raise
        if typed is None:
            return False
        if not accepted(typed):
            self.tell("no.")
            return False
        return True

    def _line(self, prompt: str) -> str | None:
        """Return the typed line, None without one in time."""
        import select
        import termios

        source = self._source.fileno()
        termios.tcflush(source, termios.TCIFLUSH)
        print(prompt, end="", file=self._sink, flush=True)
        typed = b""
        deadline = time.monotonic() + self.patience
        while not typed.endswith(b"\n"):
            left = deadline - time.monotonic()
            if left <= 0.0 or not select.select([source], [], [], left)[0]:
                self.tell(f"\nno answer within {self.patience:g} s: no.")
                return None
            more = os.read(source, 4096)
            if not more:
                self.tell("\nend of input: no.")
                return None
            typed += more
        return typed[:-1].decode(errors="replace")


class AutomaticOperator:
    """Operator that answers yes to everything; for emulated rigs only."""

    def __init__(self, settings: RigSettings) -> None:
        if not settings.emulated:
            raise ValueError(
                f"rig {settings.name!r} is not emulated: it moves beside people, so a person has to confirm. Run it "
                "from a terminal."
            )
        self.asked: list[str] = []  # questions and messages so far, in order
        self.messages: list[str] = []

    def tell(self, message: str) -> None:
        """Store the message."""
        self.messages.append(message)

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Store the question and return True."""
        self.asked.append(question)
        return True

    def ask_ready(self, what: str) -> bool:
        """Store the request and return True."""
        self.asked.append(what)
        return True


def operator_of(settings: RigSettings) -> Operator:
    """Return the operator of a rig: a person at the terminal.

    An emulated or fake rig has an automatic one. Raise RigError if there is no terminal.
    """
    return AutomaticOperator(settings) if settings.emulated else TerminalOperator()
