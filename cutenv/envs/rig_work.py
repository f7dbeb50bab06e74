"""Work of a rig's environment, and the actions it is given: neither may delay a stop of the blade."""

from __future__ import annotations

import reprlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Work:
    """Reset or step in progress: a signal handler that wants to close the rig in its midst has to wait for its end.

    A handler interrupts its thread anywhere, perhaps under a lock that closing needs.

    Parameters
    ----------
    leave : callable
        Closes the rig.
    """

    def __init__(self, leave: Callable[[], None]) -> None:
        self._leave = leave
        self._worker: int | None = None
        self._leaving = False

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Mark the block as work of this thread, and close the rig at its end if :meth:`postpones` was asked."""
        self._worker = threading.get_ident()
        try:
            yield
        finally:
            self._worker = None
            if self._leaving:
                self._leaving = False
                self._leave()

    def postpones(self) -> bool:
        """Return True if the rig cannot be closed here and now; it is then closed when the work ends."""
        if self._worker != threading.get_ident():
            return False
        self._leaving = True
        return True


def numbers(action: Any) -> NDArray[np.float64] | None:
    """Return the two numbers of an action; None for anything else that a policy may return."""
    try:
        command = np.array(action, np.float64)
    except Exception:  # the conversion of any object may raise anything, and the blade has to be stopped first
        return None
    return command if command.shape == (2,) and np.isfinite(command).all() else None


def action_text(action: Any) -> str:
    """Return an action in short, for a message."""
    try:
        return reprlib.repr(action)
    except Exception:  # the object's own method may raise anything
        return f"a {type(action).__name__}"
