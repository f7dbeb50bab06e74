"""Real-time priority for the rig's threads, so that a busy computer stops no cut."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 10
"""Priority from 1 to 99: above every ordinary process, below the kernel's own threads."""
_SWITCH = 0.0005  # [s] after which Python lets another thread run; the default of 5 ms is five force readings


def prefer() -> bool:
    """Give this thread, and those that it starts later, real-time priority; return whether that was allowed.

    Linux allows it to root, and to users with ``rtprio`` in ``/etc/security/limits.d``.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except (OSError, ValueError):
        return False
    return True


def tidy() -> None:
    """Collect garbage, at a moment when a few milliseconds do not matter."""
    gc.collect()
    gc.freeze()  # objects that survive are not searched again


@contextmanager
def preferred() -> Iterator[bool]:
    """Run the block with real-time priority and faster thread switching; yield whether the priority was allowed.

    Garbage collection is off meanwhile: with all that numba and scipy load, or a minute of readings, it takes up to a
    tenth of a second in which no thread runs, and the drives would miss this computer's heartbeat. See :func:`tidy`.
    """
    switch = sys.getswitchinterval()
    before = (os.sched_getscheduler(0), os.sched_getparam(0)) if hasattr(os, "sched_getscheduler") else None
    collecting = gc.isenabled()
    gc.disable()
    tidy()
    allowed = prefer()
    sys.setswitchinterval(_SWITCH)
    try:
        yield allowed
    finally:
        gc.unfreeze()
        if collecting:
            gc.enable()
        sys.setswitchinterval(switch)
        if allowed and before is not None:
            os.sched_setscheduler(0, *before)
