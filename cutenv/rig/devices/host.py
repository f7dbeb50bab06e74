"""Computer of a rig: its clock, as an argument, and the process that owns the rig, with real-time priority.

The clock is the machine's own, with threads, or a fake one that tests move by hand, without threads.  A fork of the
process inherits memory and sockets, and must not use them.  With the priority a busy computer stops no cut.
"""

from __future__ import annotations

import gc
import heapq
import itertools
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from cutenv.rig.errors import RigError

_FINE = 0.0005  # [s] before the end, from which waiting goes on in short steps
_STEP = 0.001  # [s] step by which a fake clock moves while it waits


class Repeating(Protocol):
    """Handle of an action that is repeated at a fixed period."""

    def stop(self) -> None:
        """End the repetition; return once the action no longer runs. May be called twice, and by the action itself."""
        ...


class Clock(Protocol):
    """Source of time that can wait, and repeat actions."""

    def now(self) -> float:
        """Return the time since some origin [s]; it never goes back."""
        ...

    def sleep_until(self, moment: float) -> float:
        """Wait until ``moment`` [s]; return the time reached, which may be later."""
        ...

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Wait at most ``limit`` [s] until ``come()`` is true, which ``changed`` notifies; return whether it is."""
        ...

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action(now)`` every ``period`` [s], first after one period; missed calls are not made up."""
        ...


class SystemClock:
    """The machine's monotonic clock, the same in all its processes."""

    def now(self) -> float:
        """Return the time since the machine was started [s]."""
        return time.monotonic()

    def sleep_until(self, moment: float) -> float:
        """Wait until ``moment`` [s], the last half millisecond in short steps: operating systems oversleep."""
        while (left := moment - time.monotonic()) > 0.0:
            time.sleep(left - _FINE if left > 2 * _FINE else min(left, 5e-5))
        return time.monotonic()

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Wait until ``come()`` is true, or ``limit`` [s] has passed."""
        with changed:
            return changed.wait_for(come, timeout=limit)

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action`` from a thread of its own, which ends with the process."""
        return _Thread(self, period, action, name)


class _Thread:
    def __init__(self, clock: SystemClock, period: float, action: Callable[[float], None], name: str) -> None:
        self._stopped = threading.Event()
        self._clock, self._period, self._action = clock, period, action
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = self._clock.now() + self._period
        while not self._stopped.wait(max(due - self._clock.now(), 0.0)):
            self._action(self._clock.now())
            due = max(due + self._period, self._clock.now())

    def stop(self) -> None:
        self._stopped.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=1.0)


class FakeClock:
    """Clock that moves only while somebody waits: due actions then run in order, in the waiting thread."""

    def __init__(self, start: float = 100.0) -> None:
        self._now = start
        self._due: list[tuple[float, int, _Turn]] = []
        self._order = itertools.count()

    def now(self) -> float:
        """Return the time to which it has been moved [s]."""
        return self._now

    def sleep_until(self, moment: float) -> float:
        """Move on to ``moment`` [s], running due actions on the way."""
        while self._due and self._due[0][0] <= moment:
            due, _, turn = heapq.heappop(self._due)
            if turn.stopped:
                continue
            self._now = max(self._now, due)
            heapq.heappush(self._due, (due + turn.period, next(self._order), turn))
            turn.action(self._now)
        self._now = max(self._now, moment)
        return self._now

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Move on until ``come()`` is true or ``limit`` [s] has passed; due actions run on the way, in this thread."""
        ends = self._now + limit
        while not come() and self._now < ends:
            self.sleep_until(min(self._now + _STEP, ends))
        return come()

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action`` every ``period`` [s] while somebody waits."""
        turn = _Turn(period, action)
        heapq.heappush(self._due, (self._now + period, next(self._order), turn))
        return turn


class PacedClock(FakeClock):
    """Fake clock that runs no faster than the machine's, for a person who watches."""

    def sleep_until(self, moment: float) -> float:
        """Wait for that time on the machine's clock, then run due actions."""
        time.sleep(max(moment - self.now(), 0.0))
        return super().sleep_until(moment)


class _Turn:
    def __init__(self, period: float, action: Callable[[float], None]) -> None:
        self.period, self.action, self.stopped = period, action, False

    def stop(self) -> None:
        self.stopped = True


class Owner:
    """Process in which this object is made."""

    def __init__(self) -> None:
        self._process = os.getpid()

    @property
    def here(self) -> bool:
        """True in that process, False in a fork of it."""
        return os.getpid() == self._process

    def check(self) -> None:
        """Raise an error in a fork.

        Raises
        ------
        RigError
            If this is another process.
        """
        if not self.here:
            raise RigError(
                f"this process is a fork of the one that has the rig ({self._process}), which alone may use it. "
                "Start the policy's workers before the rig is opened, and let them decide, not move."
            )


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
