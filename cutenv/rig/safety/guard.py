"""Stop of the blade when the program ends: by an exception, Ctrl-C or SIGTERM, or without closing the rig."""

from __future__ import annotations

import _thread
import atexit
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from cutenv.rig.devices.host import Owner
from cutenv.rig.safety.oversight import Oversight
from cutenv.rig.safety.stop_causes import Cause

SIGNALS = tuple(
    int(getattr(signal, name)) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)
)
"""Signals that end a program; Windows has two of them."""


@contextmanager
def guarded(supervisor: Oversight) -> Iterator[None]:
    """Stop the blade if the block is ended by an exception or a signal, or not before the program is.

    If the block is left in another thread, which may not set signal handlers, the handlers stay installed; they then
    do, as in a forked child, what the earlier handlers would have done.

    The first signal while the rig is released stops the blade, from a separate thread: a handler may interrupt any
    code, even in the middle of a frame. The program then gets :class:`~cutenv.rig.safety.stop_causes.RigStopped` at
    its next command. A signal while nothing may move raises :class:`KeyboardInterrupt` at once. Signals can be handled
    in the main thread only; elsewhere they are left as they are. After ``kill -9`` the drive stops by itself, because
    our heartbeat is missing.
    """

    def interrupted(number: int, frame: FrameType | None) -> None:
        if left or not owner.here:
            return _pass_on(handlers.get(number), number, frame)
        interrupt(supervisor, Cause.INTERRUPTED, signal.Signals(number).name, number)

    def ended() -> None:
        """Stop while threads still run: of what is collected after them nothing may start one."""
        if owner.here:
            supervisor.trip(Cause.EXCEPTION, "the program ended without closing the rig")

    left, owner = False, Owner()
    atexit.register(ended)
    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in SIGNALS:
            handlers[number] = signal.signal(number, interrupted)
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
        atexit.unregister(ended)
        if threading.current_thread() is threading.main_thread():
            for number, handler in handlers.items():
                signal.signal(number, handler)


def interrupt(supervisor: Oversight, cause: Cause, detail: str, number: int = signal.SIGINT) -> None:
    """Stop the blade from a signal handler, which may have interrupted any code, even under a lock.

    While the rig is released, the stop runs in a thread of its own.

    Raises
    ------
    KeyboardInterrupt
        If nothing may move, so that the program ends.
    """
    if supervisor.phase != "ready":
        raise KeyboardInterrupt(detail)

    def stop() -> None:
        supervisor.trip(cause, detail)
        if supervisor.phase != "stopped":  # locked at this moment: no command would raise the stop
            _thread.interrupt_main(signal.Signals(number))

    threading.Thread(target=stop, name="rig stop", daemon=True).start()


def _pass_on(handler: Any, number: int, frame: FrameType | None) -> None:
    """Do what an earlier handler of a signal would have done."""
    if callable(handler):
        handler(number, frame)
    elif handler == signal.SIG_DFL:
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
