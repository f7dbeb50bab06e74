"""Clock and loop of a rig, and the priority of its process.

The clock is the machine's own, with threads, or a fake one that tests move by hand, without threads.  A fork of the
process inherits memory and sockets, and must not use them.  With the priority a busy computer stops no cut.
"""

from __future__ import annotations

import gc
import heapq
import itertools
import logging
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

_FINE = 0.0005  # [s] before the end, from which waiting goes on in short steps
_SLEPT = 0.1  # [s] at a time, at most: a clock that jumps holds nobody up for longer
_STEP = 0.001  # [s] step by which a fake clock moves while it waits
READ_EVERY = 0.0005  # period at which the loop reads what has arrived from bus and sensor [s]
AT_ONCE = 64  # reports that it reads from one device at a time, at most: others have to be judged as well


class Repeating(Protocol):
    """Handle of an action that is repeated at a fixed period."""

    def stop(self) -> None:
        """End the repetition; return once the action has ended.

        May be called twice, and by the action itself.
        """
        ...


class Clock(Protocol):
    """Source of time that can wait, and repeat actions."""

    failed: Callable[[str], None]
    """Called with name and error of a repeated action that raised, where nobody waits for it."""

    def now(self) -> float:
        """Return the time since some origin [s]; it never goes back."""
        ...

    def sleep_until(self, moment: float) -> float:
        """Wait until ``moment`` [s]; return the time reached."""
        ...

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Wait up to ``limit`` [s] for ``come()``, notified by ``changed``; return its truth."""
        ...

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action(now)`` every ``period`` [s], first within one; skip missed calls."""
        ...


class SystemClock:
    """The machine's monotonic clock, the same in all its processes.

    All repeated actions run in one thread, one after the other: whatever holds it up also holds up this computer's
    heartbeat, and a drive that misses it stops by itself.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards what is below
        self._due = _Due()
        self._thread: threading.Thread | None = None
        self._running: _Turn | None = None
        self.failed: Callable[[str], None] = lambda why: None
        """Called with name and error of a repeated action that raised."""

    def now(self) -> float:
        """Return the time since the machine was started [s]."""
        return time.monotonic()

    def sleep_until(self, moment: float) -> float:
        """Wait until ``moment`` [s], finally in short steps: systems oversleep."""
        while (left := moment - time.monotonic()) > 0.0:
            time.sleep(min(left - _FINE, _SLEPT) if left > 2 * _FINE else min(left, 5e-5))
        return time.monotonic()

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Wait until ``come()`` is true, or ``limit`` [s] has passed."""
        with changed:
            return changed.wait_for(come, timeout=limit)

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action`` from the loop's thread.

        It begins with the first action and ends with the last. An action that raises is logged and reported to
        :attr:`failed`, and called again when it is due: the others have to go on.
        """
        turn = _Turn(period, action, name, self._left)
        with self._changed:
            self._due.add(next_due(self.now(), period), turn)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="rig loop", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        return turn

    def _run(self) -> None:
        while True:
            with self._changed:
                due = self._due.first()
                if due is None:
                    self._thread = None
                    return
                if (left := due - self.now()) > 0.0:
                    self._changed.wait(left)
                    continue
                turn = self._due.take()
                self._running = turn
            try:
                turn.action(self.now())
            except Exception as error:
                with suppress(Exception):  # the others go on
                    _log.exception("%s failed", turn.name)
                    self.failed(f"{turn.name} failed: {type(error).__name__}: {error}")
            with self._changed:
                self._running = None
                self._due.add(next_due(self.now(), turn.period), turn)
                self._changed.notify_all()

    def _left(self, turn: _Turn) -> None:
        """Return once a stopped action no longer runs, within a second."""
        with self._changed:
            if threading.current_thread() is not self._thread:
                self._changed.wait_for(lambda: self._running is not turn, timeout=1.0)
            self._changed.notify_all()


def next_due(moment: float, period: float) -> float:
    """Return the first multiple of a period after a moment [s]: actions that are due together cost one waking."""
    return (math.floor(moment / period + 1e-3) + 1) * period


class _Turn:
    """Action that is repeated, until it is stopped."""

    def __init__(
        self, period: float, action: Callable[[float], None], name: str, left: Callable[[_Turn], None]
    ) -> None:
        self.period, self.action, self.name, self.stopped = period, action, name, False
        self._left = left

    def stop(self) -> None:
        self.stopped = True
        self._left(self)


class _Due:
    """Repeated actions in the order in which they are due."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, _Turn]] = []
        self._order = itertools.count()

    def add(self, moment: float, turn: _Turn) -> None:
        """Add an action that is due at ``moment`` [s]."""
        heapq.heappush(self._heap, (moment, next(self._order), turn))

    def first(self) -> float | None:
        """Return when the first action is due [s], or None; drop stopped ones."""
        while self._heap and self._heap[0][2].stopped:
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else None

    def postpone(self) -> _Turn:
        """Postpone the first action by its period; return it."""
        moment, _, turn = self._heap[0]
        heapq.heapreplace(self._heap, (moment + turn.period, next(self._order), turn))
        return turn

    def take(self) -> _Turn:
        """Remove the first action, and return it."""
        return heapq.heappop(self._heap)[2]


class Attempt:
    """Call in a thread of its own, as drivers may hang.

    Where no thread can be started, as when the interpreter ends, it runs in the caller's.
    """

    def __init__(self, call: Callable[[], None], name: str) -> None:
        self.error: str | None = None  # text of what the call raised; None while it runs, and after it has returned
        self._call, self._done = call, threading.Event()
        try:
            thread = None if sys.is_finalizing() else threading.Thread(target=self._run, name=name, daemon=True)
            if thread is not None:
                thread.start()
        except RuntimeError:  # Python 3.12 says so instead of waiting for ever
            thread = None
        if thread is None:
            self._run()

    def _run(self) -> None:
        try:
            self._call()
        except Exception as error:
            self.error = str(error) or repr(error)
        finally:
            self._done.set()

    @property
    def under_way(self) -> bool:
        """True until the call has returned, or raised."""
        return not self._done.is_set()

    def ends(self, within: float) -> bool:
        """Wait ``within`` [s]; return whether the call has ended."""
        return self._done.wait(within)


class FakeClock:
    """Clock that moves only while somebody waits.

    Due actions then run in order, in the waiting thread.
    """

    def __init__(self, start: float = 100.0) -> None:
        self._now = start
        self._due = _Due()
        self.failed: Callable[[str], None] = lambda why: None  # unused: errors are raised to those who wait

    def now(self) -> float:
        """Return the time to which it has been moved [s]."""
        return self._now

    def sleep_until(self, moment: float) -> float:
        """Move on to ``moment`` [s], running due actions on the way."""
        while (first := self._due.first()) is not None and first <= moment:
            self._now = max(self._now, first)
            self._due.postpone().action(self._now)
        self._now = max(self._now, moment)
        return self._now

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Move on until ``come()`` or ``limit`` [s], running due actions in this thread."""
        ends = self._now + limit
        while not come() and self._now < ends:
            self.sleep_until(min(self._now + _STEP, ends))
        return come()

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action`` every ``period`` [s] while somebody waits."""
        turn = _Turn(period, action, name, lambda turn: None)
        self._due.add(self._now + period, turn)
        return turn


class PacedClock(FakeClock):
    """Fake clock no faster than the machine's, for watching people."""

    def sleep_until(self, moment: float) -> float:
        """Wait for a time on the machine's clock; run due actions."""
        time.sleep(max(moment - self.now(), 0.0))
        return super().sleep_until(moment)


class Owner:
    """Process in which this object is made."""

    def __init__(self) -> None:
        self._process = os.getpid()

    @property
    def here(self) -> bool:
        """True in that process, False in a fork of it."""
        return os.getpid() == self._process

    def check(self) -> None:
        """Raise an error in a fork; raise RigError if this is another process."""
        if not self.here:
            raise RigError(
                f"this process is a fork of the one that has the rig ({self._process}), which alone may use it. "
                "Start the policy's workers before the rig is opened, and let them decide, not move."
            )


PRIORITY = 10  # priority from 1 to 99: above every ordinary process, below the kernel's own threads
NICENESS = -10  # niceness of the thread that decides, from -20, the least considerate, to 19
SWITCH = 0.0005  # time after which Python lets another thread run [s]; the default of 5 ms is five force readings


def prefer(*, first_in: bool = False) -> bool:
    """Give this thread, and those that it starts later, real-time priority.

    Return whether that was allowed.

    Linux allows it to root, and to users with ``rtprio`` in ``/etc/security/limits.d``. A thread that is ``first_in``
    runs until it waits; others of the same priority take turns.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO if first_in else os.SCHED_RR, os.sched_param(PRIORITY))
    except (OSError, ValueError):
        return False
    return True


@contextmanager
def undisturbed() -> Iterator[None]:
    """Spare the block garbage collection of loaded objects, and slow thread switches.

    With NumPy, SciPy and Numba a search for garbage takes up to a tenth of a second, and the next command would be
    late. The thread gets a greater share of a busy computer than others, where the system lets it, and waits less for
    them.
    """
    switch, niceness = sys.getswitchinterval(), None
    if hasattr(os, "setpriority"):
        niceness = os.getpriority(os.PRIO_PROCESS, 0)
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, min(niceness, NICENESS))
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH)
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(switch)
        if niceness is not None:
            os.setpriority(os.PRIO_PROCESS, 0, niceness)


@contextmanager
def preferred() -> Iterator[bool]:
    """Run the block :func:`undisturbed` and with real-time priority.

    Yield whether the priority was allowed.

    It is for a process that holds a rig's threads itself. A policy's program must not have it: one that computes
    without end would use up what the system grants all real-time threads together, and its spine would stand still.
    """
    before = (os.sched_getscheduler(0), os.sched_getparam(0)) if hasattr(os, "sched_getscheduler") else None
    allowed = prefer()
    try:
        with undisturbed():
            yield allowed
    finally:
        if allowed and before is not None:
            os.sched_setscheduler(0, *before)
