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
from cutenv.rig.owner import Owner
from cutenv.rig.supervisor import Supervisor

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
_PARENT_EVERY = 0.002  # [s] between looks at who the parent is


@contextmanager
def guarded(supervisor: Supervisor, clock: Clock) -> Iterator[None]:
    """Within the block, whatever ends it badly stops the blade first.

    Left by another thread, which may not set handlers, it leaves its own in place; they do then, and in a forked child,
    what those before would have done.

    The first signal while the rig is released stops the blade, from a thread of its own: a handler interrupts whatever
    runs, perhaps in the middle of a frame.  The program then meets :class:`~cutenv.rig.causes.RigStopped` at its next
    command.  A signal while nothing may move raises :class:`KeyboardInterrupt` at once.  Signals can be handled in the
    main thread only; elsewhere they are left as they are.  After ``kill -9`` the drive stops by itself, for our
    heartbeat is missing.
    """

    def interrupted(number: int, frame: FrameType | None) -> None:
        if left or not owner.here:
            return _pass_on(handlers.get(number), number, frame)
        interrupt(supervisor, Cause.INTERRUPTED, signal.Signals(number).name, number)

    left, owner = False, Owner()
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
        left = True
        watching.stop()
        if threading.current_thread() is threading.main_thread():
            for number, handler in handlers.items():
                signal.signal(number, handler)


def interrupt(supervisor: Supervisor, cause: Cause, detail: str, number: int = signal.SIGINT) -> None:
    """Stop the blade for a handler of a signal, which has interrupted whatever ran, perhaps under a lock.

    While the rig is released it is stopped from a thread of its own.

    Raises
    ------
    KeyboardInterrupt
        If nothing may move: the program ends what it does.
    """
    if supervisor.phase != "ready":
        raise KeyboardInterrupt(detail)

    def stop() -> None:
        supervisor.trip(cause, detail)
        if supervisor.phase != "stopped":  # locked this very moment: the program would meet no stop
            _thread.interrupt_main(signal.Signals(number))

    threading.Thread(target=stop, name="rig stop", daemon=True).start()


def _pass_on(handler: Any, number: int, frame: FrameType | None) -> None:
    """Do what an earlier handler of a signal would have done."""
    if callable(handler):
        handler(number, frame)
    elif handler == signal.SIG_DFL:
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
