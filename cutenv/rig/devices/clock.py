"""Clock as an argument: the machine's own, with threads, or a fake one that tests move by hand, without threads."""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from typing import Protocol

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
