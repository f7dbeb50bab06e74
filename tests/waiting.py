"""Waiting for what other threads or processes bring."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def until(come: Callable[[], Any], limit: float = 10.0) -> Any:
    """Wait until ``come()`` is true, ``limit`` [s] at most; what it then is."""
    deadline = time.monotonic() + limit
    while not (found := come()):
        assert time.monotonic() < deadline, "it has not come"
        time.sleep(0.005)
    return found
