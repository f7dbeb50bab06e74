"""Servo that runs a session at 1 kHz in a thread.

So devices that push do not wait for pictures.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from cutenv.people.play.play_session import Session
from cutenv.sim.cutting.dtypes import TICK


class Servo:
    """Thread that advances a session every millisecond until it is stopped.

    Python's timing is not guaranteed: another thread may delay it by some 5 ms. ``VirtualCoupling(period=0.005)``
    allows for that; the session makes up for the missed milliseconds. After a delay beyond the coupling's period the
    force begins anew from zero.

    Parameters
    ----------
    session : Session
        Session, to be used under ``lock`` only from now on.
    clock : callable
        Clock in seconds.

    Attributes
    ----------
    lock : threading.Lock
        Lock that is held while the session advances.
    longest : float
        Longest time between two advances so far [s]; the coupling's period must cover it.
    late : int
        Number of advances later than the coupling's period, after which the force began anew.
    error : Exception or None
        Error that ended the thread early; :meth:`stop` raises it.
    """

    def __init__(self, session: Session, clock: Callable[[], float] = time.perf_counter) -> None:
        self.lock = threading.Lock()
        self.longest = 0.0
        self.late = 0
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
                    coupling = self._session.device.coupling
                    if coupling is not None and now - last > coupling.period:
                        self.late += 1
                        self._session.forget_force()
                    self._session.advance(now)
                self.longest, last = max(self.longest, now - last), now
        except Exception as error:  # stop() raises it
            self.error = error
        finally:
            self._session.device.push(0.0)  # in any case the force ends

    def stop(self) -> None:
        """Stop and join the thread; raise its error, if any."""
        self._stopped.set()
        self._thread.join()
        if self.error is not None:
            raise self.error
