"""Stops the blade when the program itself ends badly: an exception, Ctrl-C, SIGTERM, or the death of its parent."""

from __future__ import annotations

import _thread
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from cutenv.rig.causes import Cause
from cutenv.rig.clock import Clock
from cutenv.rig.supervisor import Supervisor

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
_PARENT_EVERY = 0.002  # [s] between looks at who the parent is


@contextmanager
def guarded(supervisor: Supervisor, clock: Clock) -> Iterator[None]:
    """Within the block, whatever ends it badly stops the blade first.

    The first signal while the rig is released stops the blade, from a thread of its own: a handler interrupts whatever
    runs, perhaps in the middle of a frame.  The program then meets :class:`~cutenv.rig.causes.RigStopped` at its next
    command.  A signal while nothing may move raises :class:`KeyboardInterrupt` at once.  Signals can be handled in the
    main thread only; elsewhere they are left as they are.  After ``kill -9`` the drive stops by itself, for our
    heartbeat is missing.
    """

    def interrupted(number: int, frame: FrameType | None) -> None:
        if supervisor.phase != "ready":
            raise KeyboardInterrupt(signal.Signals(number).name)

        def stop() -> None:
            supervisor.trip(Cause.INTERRUPTED, signal.Signals(number).name)
            if supervisor.phase != "stopped":  # locked this very moment: the program would meet no stop
                _thread.interrupt_main(signal.Signals(number))

        threading.Thread(target=stop, name="rig stop", daemon=True).start()

    parent = os.getppid()

    def orphaned(now: float) -> None:
        if os.getppid() != parent:
            supervisor.trip(Cause.ORPHANED, f"the parent process {parent} has ended", now)

    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in _SIGNALS:
            if (number := getattr(signal, name, None)) is not None:  # Windows has two of them
                handlers[number] = signal.signal(number, interrupted)
    watching = clock.every(_PARENT_EVERY, orphaned, "rig parent watch")
    try:
        yield
    except KeyboardInterrupt:
        supervisor.trip(Cause.INTERRUPTED, "interrupted from the keyboard")
        raise
    except BaseException as error:
        supervisor.trip(Cause.EXCEPTION, f"{type(error).__name__}: {error}")
        raise
    finally:
        watching.stop()
        for number, handler in handlers.items():
            signal.signal(number, handler)
