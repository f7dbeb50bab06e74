"""Time as an argument: the machine's own clock with threads, or one that tests move by hand without any."""

from __future__ import annotations

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from typing import Protocol

_FINE = 0.0005  # [s] before the moment, from which waiting is done in short steps
_STEP = 0.001  # [s] by which a clock is moved that waits for something


class Repeating(Protocol):
    """Something that is done every so often."""

    def stop(self) -> None:
        """Not again; returns when it is no longer running, may be called twice and from itself."""
        ...


class Clock(Protocol):
    """Tells the time, waits, and does things every so often."""

    def now(self) -> float:
        """Seconds from some beginning; never goes back."""
        ...

    def sleep_until(self, moment: float) -> float:
        """Wait for ``moment`` [s]; return the time it has become, which may be later."""
        ...

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Wait at most ``limit`` [s] for what another thread brings, who notifies ``changed``; whether it has come."""
        ...

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action(now)`` every ``period`` [s] from one period on; what is late is not made up for."""
        ...


class SystemClock:
    """The machine's monotonic clock, the same in all its processes."""

    def now(self) -> float:
        """Seconds since the machine was started."""
        return time.monotonic()

    def sleep_until(self, moment: float) -> float:
        """Wait; the last half millisecond in short steps, for an operating system likes to oversleep."""
        while (left := moment - time.monotonic()) > 0.0:
            time.sleep(left - _FINE if left > 2 * _FINE else min(left, 5e-5))
        return time.monotonic()

    def wait_for(self, come: Callable[[], bool], limit: float, changed: threading.Condition) -> bool:
        """Wait until it has come, or the time is up."""
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
    """Time that passes only while somebody waits: what is due then is done in order, in the waiting thread."""

    def __init__(self, start: float = 100.0) -> None:
        self._now = start
        self._due: list[tuple[float, int, _Turn]] = []
        self._order = itertools.count()

    def now(self) -> float:
        """Seconds, as far as it has been moved."""
        return self._now

    def sleep_until(self, moment: float) -> float:
        """Move on to ``moment`` [s], and do on the way what is due."""
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
        """Move on until it has come; what brings it is done on the way, as there is no other thread."""
        ends = self._now + limit
        while not come() and self._now < ends:
            self.sleep_until(min(self._now + _STEP, ends))
        return come()

    def every(self, period: float, action: Callable[[float], None], name: str) -> Repeating:
        """Call ``action`` while somebody waits."""
        turn = _Turn(period, action)
        heapq.heappush(self._due, (self._now + period, next(self._order), turn))
        return turn


class PacedClock(FakeClock):
    """A fake clock whose time passes no faster than the machine's: for a person who watches."""

    def sleep_until(self, moment: float) -> float:
        """Really wait for so long, then do what is due."""
        time.sleep(max(moment - self.now(), 0.0))
        return super().sleep_until(moment)


class _Turn:
    def __init__(self, period: float, action: Callable[[float], None]) -> None:
        self.period, self.action, self.stopped = period, action, False

    def stop(self) -> None:
        self.stopped = True
