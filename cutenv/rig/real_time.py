"""Ask the operating system to run the rig's threads before others, so that a busy computer stops no cut."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 10
"""Of 1 to 99: before everything ordinary, behind the kernel's own."""
_SWITCH = 0.0005  # [s] after which Python lets another thread run; 5 ms by default, five readings of the force


def prefer() -> bool:
    """Give this thread, and those that it starts from now on, real-time priority; whether that was allowed.

    Linux allows it to root and to whom ``/etc/security/limits.d`` gives ``rtprio``.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    except (OSError, ValueError):
        return False
    return True


def tidy() -> None:
    """Search what is new in memory for garbage, at a moment when a few milliseconds do not matter."""
    gc.collect()
    gc.freeze()  # what is left now is not searched again


@contextmanager
def preferred() -> Iterator[bool]:
    """Within the block, run before others, and switch between threads more often; whether the former was allowed.

    Memory is not searched for garbage meanwhile: among all that numba and scipy load, or a minute of readings, that
    takes up to a tenth of a second in which no thread runs, and a drive takes it for the end of this computer.  See
    :func:`tidy`.
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
