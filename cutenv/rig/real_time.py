"""Ask the operating system to run the rig's threads before others, so that a busy computer stops no cut."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_PRIORITY = 10  # of 1 to 99: before everything ordinary, behind the kernel's own
_SWITCH = 0.0005  # [s] after which Python lets another thread run; 5 ms by default, five readings of the force


def prefer() -> bool:
    """Give this thread, and those that it starts from now on, real-time priority; whether that was allowed.

    Linux allows it to root and to whom ``/etc/security/limits.d`` gives ``rtprio``.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
    except (OSError, ValueError):
        return False
    return True


@contextmanager
def preferred() -> Iterator[bool]:
    """Within the block, run before others, and switch between threads more often; whether the former was allowed.

    What is in memory by then is not searched for garbage any more: with SciPy and Numba loaded such a search holds all
    threads for a tenth of a second and longer, in which no heartbeat gets to a drive and no reading of the force is
    looked at.  Load what a cut needs before.
    """
    switch = sys.getswitchinterval()
    before = (os.sched_getscheduler(0), os.sched_getparam(0)) if hasattr(os, "sched_getscheduler") else None
    allowed = prefer()
    sys.setswitchinterval(_SWITCH)
    gc.collect()
    gc.freeze()
    try:
        yield allowed
    finally:
        gc.unfreeze()
        sys.setswitchinterval(switch)
        if allowed and before is not None:
            os.sched_setscheduler(0, *before)
