"""An operator whose answers are known beforehand."""

from __future__ import annotations

from collections.abc import Sequence


class ScriptedOperator:
    """Operator with answers given beforehand.

    Each of ``answers`` is a part of a question's text, and True, False or the typed text, in the order asked.
    """

    def __init__(self, answers: Sequence[tuple[str, bool | str]] = ()) -> None:
        self.messages: list[str] = []
        self.unasked = list(answers)

    def tell(self, message: str) -> None:
        self.messages.append(message)

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        answer = self._next(question)
        if isinstance(answer, bool):
            return answer
        return answer == expected if expected is not None else answer.lower() in ("y", "yes")

    def ask_ready(self, what: str) -> bool:
        answer = self._next(what)
        return answer if isinstance(answer, bool) else not answer

    def _next(self, question: str) -> bool | str:
        if not self.unasked:
            raise LookupError(f"no question was expected, but this was asked: {question!r}.")
        if self.unasked[0][0] not in question:
            raise LookupError(f"a question with {self.unasked[0][0]!r} was expected, but this was asked: {question!r}.")
        return self.unasked.pop(0)[1]
