"""A rig's environment at work, and the actions handed to it: neither may keep the blade from stopping."""

from __future__ import annotations

import reprlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Work:
    """A reset or step that is going on: a signal's handler that closes the rig in its midst does so after it.

    A handler runs in the middle of whatever its thread does, perhaps under a lock that closing needs.

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
        """Within the block :meth:`postpones` does, in this thread."""
        self._worker = threading.get_ident()
        try:
            yield
        finally:
            self._worker = None
            if self._leaving:
                self._leaving = False
                self._leave()

    def postpones(self) -> bool:
        """True if the rig cannot be closed here and now; it is when the work ends."""
        if self._worker != threading.get_ident():
            return False
        self._leaving = True
        return True


def numbers(action: Any) -> NDArray[np.float64] | None:
    """The two numbers of an action; None of whatever else a policy may return."""
    try:
        command = np.array(action, np.float64)
    except Exception:  # an object's own conversion may raise anything, and the blade has to be stopped first
        return None
    return command if command.shape == (2,) and np.isfinite(command).all() else None


def shown(action: Any) -> str:
    """An action for a message, in short."""
    try:
        return reprlib.repr(action)
    except Exception:  # an object's own may raise anything
        return f"a {type(action).__name__}"
