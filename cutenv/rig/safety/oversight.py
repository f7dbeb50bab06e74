"""Oversight of a rig's safety by all that is not safety itself.

Procedures, policies and people who watch ask it. It also stops the blade when the program ends: by an exception,
Ctrl-C or SIGTERM, or without closing the rig.
"""

from __future__ import annotations

import _thread
import atexit
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Protocol

from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.devices.loop import Owner
from cutenv.rig.devices.protocols import ForceSample, MotionSample, Phase
from cutenv.rig.safety.stop_causes import Cause, StopReport


class Oversight(Protocol):
    """Safety of a rig, in this process or in the spine's. See :class:`cutenv.rig.safety.supervisor.Supervisor`."""

    limited: int  # number of commands that were reduced to a limit since :meth:`release`
    settings: RigSettings  # settings of the rig, with the limits that are in force
    limits: SafetyLimits  # limits that are in force

    @property
    def phase(self) -> Phase:
        """State of the rig, which decides whether it may move."""
        ...

    @property
    def report(self) -> StopReport | None:
        """Report of the last stop; None before the first.

        It is completed when the blade is at rest.
        """
        ...

    def drive(self, speed: float, angle: float, hold: float, **across: float) -> float:
        """Send a command that is valid for ``hold`` [s], with speeds in m/s; return the angle to turn to [rad]."""
        ...

    def turn(self, rate: float) -> None:
        """Send a turning speed [rad/s] to the angle's axis, if the rig is released."""
        ...

    def trip(self, cause: Cause, detail: str) -> None:
        """Stop the blade of a released rig, from any thread; return once the quick stops are on their way."""
        ...

    def await_quick_stops(self) -> None:
        """Wait until the quick stops of a stop under way are sent."""
        ...

    def release(self, *, returning: bool = False) -> None:
        """Allow commands; raises RigError if a signal is missing or beyond its limits."""
        ...

    def lock(self) -> None:
        """Command zero speed on every axis, and refuse motion until the next release."""
        ...

    def lower(self, limits: SafetyLimits) -> None:
        """Adopt each limit that is stricter than the present one."""
        ...

    def reset(self, agreed: bool) -> None:
        """Clear what is :attr:`latched`, if the operator has ``agreed``."""
        ...

    @property
    def latched(self) -> str | None:
        """Reason for which a reset has to precede any motion, or None."""
        ...

    @property
    def newest_force(self) -> ForceSample | None:
        """Last force reading; None before the first."""
        ...

    @property
    def blade(self) -> MotionSample | None:
        """Last sample of the blade's axis; None before the first."""
        ...

    def axis(self, name: str) -> MotionSample | None:
        """Return the last sample of an axis; None before the first."""
        ...

    @property
    def beyond(self) -> str | None:
        """Position of a blade beyond an end of its travel, as a text; None if it is inside."""
        ...

    @property
    def pressed(self) -> str | None:
        """Vertical force of a blade that presses on the tissue beyond its limit, as a text; None if it is within."""
        ...

    @property
    def relieving(self) -> bool:
        """True while a blade that presses on the tissue is raised, and nothing else may move."""
        ...

    @property
    def standing(self) -> bool:
        """True if the blade is at rest, as far as its samples show."""
        ...


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

    While the rig is released, the stop runs in a thread of its own. Raise KeyboardInterrupt if nothing may move, so
    that the program ends.
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
