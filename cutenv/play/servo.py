"""A session at 1 kHz in a thread of its own, for devices that push: pictures must not make them wait."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from cutenv.cutting.records import TICK
from cutenv.play.session import Session


class Servo:
    """Advances a session every millisecond until it is stopped.

    Python keeps no promise of time: another thread may hold it up for some 5 ms. ``VirtualCoupling(period=0.005)``
    counts on that; the session makes up for the milliseconds that were missed.

    Parameters
    ----------
    session : Session
        To be touched under `lock` only, from now on.
    clock : callable
        [s].

    Attributes
    ----------
    lock : threading.Lock
        Held while the session advances.
    longest : float
        Longest time between two advances so far [s]: what the coupling's period must cover.
    error : Exception or None
        What ended it before its time; :meth:`stop` raises it.
    """

    def __init__(self, session: Session, clock: Callable[[], float] = time.perf_counter) -> None:
        self.lock = threading.Lock()
        self.longest = 0.0
        self.error: Exception | None = None
        self._session, self._clock = session, clock
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="cutenv servo", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        last = self._clock()
        try:
            while not self._stopped.wait(TICK):
                now = self._clock()
                with self.lock:
                    self._session.advance(now)
                self.longest, last = max(self.longest, now - last), now
        except Exception as error:  # told where somebody can see it
            self.error = error
        finally:
            self._session.device.push(0.0)  # whatever went wrong, nothing pushes on

    def stop(self) -> None:
        """Stop, and wait until it has; raises what went wrong in the thread, if anything did."""
        self._stopped.set()
        self._thread.join()
        if self.error is not None:
            raise self.error
