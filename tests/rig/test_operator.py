"""Nothing but a timely and exact answer of a person at a terminal is a yes."""

from __future__ import annotations

import io
import os
import pty
import signal
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import AutomaticOperator, TerminalOperator


class Person:
    """At the other end of a terminal: types once a prompt is shown."""

    def __init__(self, keyboard: int, terminal: int) -> None:
        self.keyboard = keyboard
        self.screen = io.StringIO()
        self.source = os.fdopen(terminal, "r", closefd=False)

    def operator(self, patience: float = 20.0) -> TerminalOperator:
        return TerminalOperator(patience=patience, source=self.source, sink=self.screen)

    def answers(self, asked: Callable[[], bool], *, types: bytes) -> bool:
        """What a question comes to while this is typed as soon as it is on the screen."""

        def type_when_asked() -> None:
            while not self.screen.getvalue():
                time.sleep(0.001)
            os.write(self.keyboard, types)

        typing = threading.Thread(target=type_when_asked, daemon=True)
        typing.start()
        answer = asked()
        typing.join(10.0)
        return answer


@pytest.fixture
def person() -> Iterator[Person]:
    keyboard, terminal = pty.openpty()
    yield Person(keyboard, terminal)
    os.close(keyboard)
    os.close(terminal)


@pytest.mark.parametrize(
    ("expected", "typed", "answer"),
    [
        *((None, typed, True) for typed in (b"y\n", b" Yes \n", b"ye\x04s\n")),  # Ctrl-D hands over what stands there
        *((None, typed, False) for typed in (b"n\n", b"\n", b"yep\n", b"\x04")),
        ("bench 2", b"bench 2\n", True),
        *(("bench 2", typed, False) for typed in (b"Bench 2\n", b"bench 2 \n", b"yes\n", b"\n")),
    ],
)
def test_only_yes_is_a_yes_and_a_typed_confirmation_counts_letter_for_letter(
    person: Person, expected: str | None, typed: bytes, answer: bool
) -> None:
    operator = person.operator()
    assert person.answers(lambda: operator.confirm("Arm the rig?", expected=expected), types=typed) is answer
    shown = person.screen.getvalue()
    assert shown.startswith("Arm the rig? [y/N] " if expected is None else 'Arm the rig?\nType "bench 2" to confirm')
    assert ("end of input" in shown) is (typed == b"\x04")


@pytest.mark.parametrize(("typed", "answer"), [(b"\n", True), (b"wait\n", False)])
def test_ready_is_enter(person: Person, typed: bytes, answer: bool) -> None:
    operator = person.operator()
    assert person.answers(lambda: operator.ask_ready("specimen clamped, hands off"), types=typed) is answer


def test_what_was_typed_before_the_question_is_no_answer(person: Person) -> None:
    os.write(person.keyboard, b"y\ny\n")
    time.sleep(0.05)  # through the terminal
    assert person.answers(lambda: person.operator().confirm("Go?"), types=b"n\n") is False


def test_silence_is_a_no_after_the_time_limit(person: Person) -> None:
    start = time.monotonic()
    assert person.operator(patience=1.0).confirm("Go?") is False
    assert 1.0 <= time.monotonic() - start < 10.0
    assert "no answer within 1 s" in person.screen.getvalue()


def test_half_a_line_is_no_answer(person: Person) -> None:
    operator = person.operator(patience=1.0)
    assert person.answers(lambda: operator.confirm("Go?"), types=b"y") is False


def test_an_interruption_is_a_no(person: Person) -> None:
    operator, asking = person.operator(), threading.main_thread().ident
    assert asking is not None

    def interrupt() -> None:
        while not person.screen.getvalue():
            time.sleep(0.001)
        signal.pthread_kill(asking, signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):  # the command ends, with its one status
        operator.confirm("Go?")
    assert "interrupted: no" in person.screen.getvalue()


def test_without_a_terminal_questions_are_refused_at_the_door() -> None:
    with pytest.raises(RigError, match=r"need a terminal.*Run the command in a terminal"):
        TerminalOperator(source=io.StringIO("yes\n"))


@pytest.mark.parametrize("patience", [0.0, float("inf"), float("nan")])
def test_nobody_is_waited_for_forever(person: Person, patience: float) -> None:
    with pytest.raises(ValueError, match="patience"):
        person.operator(patience)


def test_an_emulated_rig_is_answered_yes_and_what_was_asked_is_kept() -> None:
    operator = AutomaticOperator(RigSettings(emulated=True))
    assert operator.confirm("Arm?", expected="rig")
    assert operator.ask_ready("clamped")
    operator.tell("moving")
    assert (operator.asked, operator.messages) == (["Arm?", "clamped"], ["moving"])


def test_hardware_is_never_answered_automatically() -> None:
    with pytest.raises(ValueError, match=r"rig 'bench 2' is not emulated.*a person has to confirm"):
        AutomaticOperator(RigSettings(name="bench 2"))
