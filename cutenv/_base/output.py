"""Standard output of a program, whose reader may end first."""

from __future__ import annotations

import select
import sys


def reader_has_gone() -> bool:
    """Return True if standard output is a closed pipe; on Windows never, where such a pipe raises another error."""
    if not hasattr(select, "poll"):
        return False
    watched = select.poll()
    watched.register(sys.stdout.fileno(), 0)
    return bool(watched.poll(0))
