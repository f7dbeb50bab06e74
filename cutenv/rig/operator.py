"""The person beside the rig: asked before anything moves, at a terminal, with a time limit."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Protocol, TextIO

from cutenv.rig.drivers import RigError
from cutenv.rig.settings import RigSettings
from cutenv.validation import in_range

_YES = ("y", "yes")


class Operator(Protocol):
    """Whoever answers for the rig.  No answer in time is a no."""

    def tell(self, message: str) -> None:
        """Say what happens."""
        ...

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Ask; whether the answer is yes, or just `expected`, letter for letter."""
        ...

    def ask_ready(self, what: str) -> bool:
        """Ask for something to be done by hand, such as "specimen clamped, hands off"; whether it is done."""
        ...


class TerminalOperator:
    """A person at a terminal.

    What was typed before a question was asked is no answer to it.  Ctrl-C, the end of the input (Ctrl-D) and silence
    are a no.

    Parameters
    ----------
    patience : float
        How long an answer may take [s], 1 to 3600.
    source, sink : text file, optional
        A terminal to read from, and where to write; standard input and output by default.

    Raises
    ------
    RigError
        If the source is no terminal: then nobody is there to answer.
    ValueError
        If the patience is out of range.
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
                "without a pipe; only an emulated rig (emulated = true) does without an operator."
            )

    def tell(self, message: str) -> None:
        """Print."""
        print(message, file=self._sink, flush=True)

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Ask for yes, or for a text that must be typed exactly."""
        if expected is None:
            return self._asked(f"{question} [y/N] ", lambda typed: typed.strip().lower() in _YES)
        return self._asked(f'{question}\nType "{expected}" to confirm: ', lambda typed: typed == expected)

    def ask_ready(self, what: str) -> bool:
        """Ask for Enter; anything else is a no."""
        return self._asked(f"{what}: press Enter when ready, anything else stops. ", lambda typed: not typed.strip())

    def _asked(self, prompt: str, accepted: Callable[[str], bool]) -> bool:
        try:
            typed = self._line(prompt)
        except KeyboardInterrupt:
            self.tell("\ninterrupted: no.")
            return False
        if typed is None:
            return False
        if not accepted(typed):
            self.tell("no.")
            return False
        return True

    def _line(self, prompt: str) -> str | None:
        """What is typed after the prompt, without the end of its line; None if nothing is in time, or at the end."""
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
    """Says yes to everything: for emulated rigs, and for nothing else.

    Attributes
    ----------
    asked, told : list of str
        Questions and messages, in order.

    Raises
    ------
    ValueError
        If the rig is not emulated.
    """

    def __init__(self, settings: RigSettings) -> None:
        if not settings.emulated:
            raise ValueError(
                f"rig {settings.name!r} is not emulated: it moves beside people, and one of them must answer. Run it "
                "from a terminal."
            )
        self.asked: list[str] = []
        self.told: list[str] = []

    def tell(self, message: str) -> None:
        """Keep it."""
        self.told.append(message)

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Yes."""
        self.asked.append(question)
        return True

    def ask_ready(self, what: str) -> bool:
        """Yes."""
        self.asked.append(what)
        return True


class ScriptedOperator:
    """Answers known beforehand, for tests.

    Parameters
    ----------
    answers : sequence of (question, answer)
        In the order of the questions: a part of the text that is asked, and yes or no, or what is typed.

    Attributes
    ----------
    told : list of str
        Messages.
    unasked : list of (question, answer)
        What has not been asked yet.
    """

    def __init__(self, answers: Sequence[tuple[str, bool | str]] = ()) -> None:
        self.told: list[str] = []
        self.unasked = list(answers)

    def tell(self, message: str) -> None:
        """Keep it."""
        self.told.append(message)

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        """Answer as scripted; raises LookupError for another question than the next one."""
        answer = self._next(question)
        if isinstance(answer, bool):
            return answer
        return answer == expected if expected is not None else answer.lower() in _YES

    def ask_ready(self, what: str) -> bool:
        """Answer as scripted; raises LookupError for another question than the next one."""
        answer = self._next(what)
        return answer if isinstance(answer, bool) else not answer

    def _next(self, question: str) -> bool | str:
        if not self.unasked:
            raise LookupError(f"no question was expected, but this was asked: {question!r}.")
        if self.unasked[0][0] not in question:
            raise LookupError(f"a question with {self.unasked[0][0]!r} was expected, but this was asked: {question!r}.")
        return self.unasked.pop(0)[1]
