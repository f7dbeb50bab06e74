"""Conformance of a driver: what its protocol promises, what is allowed, what was measured, and what is missed."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from cutenv.rig.devices.drivers import ForceSample, MotionSample
from cutenv.rig.devices.host import Clock
from cutenv.rig.errors import RigError

CALL_TIME = 0.005
"""Time that a call may take that has not to wait for an answer [s]: a command, a quick stop."""
CLOSE_TIME = 3.0
"""Time that closing may take [s]."""
THREADS_END = 1.0
"""Time after closing within which a driver's threads have to end [s]."""


class TriedPromise(NamedTuple):
    """One promise of a driver's protocol, and what became of it.

    Attributes
    ----------
    promise : str
        Promise.
    allowed, measured : str
        What is allowed, and what was found; with units.
    kept : bool
        True if it was kept.
    """

    promise: str
    allowed: str
    measured: str
    kept: bool


HEADER = ("promised", "allowed", "measured", "kept")
"""Columns of the table."""


def conformance_rows(findings: list[TriedPromise]) -> list[tuple[str, ...]]:
    """Return the table of findings, as rows of text without the header."""
    return [(each.promise, each.allowed, each.measured, "yes" if each.kept else "NO") for each in findings]


class Listening:
    """Listener that keeps all that a driver reports, for either kind of driver.

    Attributes
    ----------
    motions, forces : list
        Samples.
    beats : list of float
        Times of heartbeats [s].
    troubles : list of str
        Errors, foreign commands, breaks and packets that were no readings.
    """

    def __init__(self) -> None:
        self.motions: list[MotionSample] = []
        self.forces: list[ForceSample] = []
        self.beats: list[float] = []
        self.troubles: list[str] = []

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Keep a sample of an axis."""
        self.motions.append(sample)

    def alive(self, axis: str, time: float) -> None:
        """Keep a heartbeat."""
        self.beats.append(time)

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """Keep an error of the drive."""
        self.troubles.append(f"error 0x{code:04X}, {meaning}")

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Keep a foreign command."""
        self.troubles.append(f"foreign command: {what}")

    def broken(self, axis: str, why: str, time: float) -> None:
        """Keep the break of the line."""
        self.troubles.append(f"broken: {why}")

    def force(self, sample: ForceSample) -> None:
        """Keep a reading."""
        self.forces.append(sample)

    def garbled(self, why: str, time: float) -> None:
        """Keep a packet that was no reading."""
        self.troubles.append(f"no reading: {why}")


def refused(action: Callable[[], Any]) -> str | None:
    """Return the message with which an action is refused; None if it is not."""
    try:
        action()
    except (RigError, TypeError, ValueError) as error:
        return str(error)
    return None


def must_refuse(promise: str, action: Callable[[], Any]) -> TriedPromise:
    """Return whether an action is refused, with a message, as promised."""
    said = refused(action)
    return TriedPromise(promise, "an error", "no error" if said is None else _short(said), said is not None)


def timed(action: Callable[[], Any]) -> float:
    """Return the time that an action takes on the machine's clock [s]."""
    begun = time.monotonic()
    action()
    return time.monotonic() - begun


def time_within(promise: str, seconds: float, allowed: float) -> TriedPromise:
    """Return the finding of a time against what is allowed [s]."""
    return TriedPromise(promise, f"{1e3 * allowed:.3g} ms", f"{1e3 * seconds:.3g} ms", seconds <= allowed)


def closed(driver: Any, listening: Listening, clock: Clock, before: set[threading.Thread]) -> list[TriedPromise]:
    """Close a driver twice, and see that it falls silent and that its threads end."""
    findings = [time_within("close returns", timed(driver.close), CLOSE_TIME)]
    said = refused(driver.close)
    findings.append(TriedPromise("close may be called twice", "no error", said or "no error", said is None))
    clock.sleep_until(clock.now() + 0.05)  # what was under way
    seen = len(listening.motions) + len(listening.forces)
    clock.sleep_until(clock.now() + 0.3)
    late = len(listening.motions) + len(listening.forces) - seen
    findings.append(TriedPromise("after close nothing is reported", "0 reports", f"{late} reports", late == 0))
    ends = time.monotonic() + THREADS_END
    while (left := _left(before)) and time.monotonic() < ends:
        time.sleep(0.02)
    told = ", ".join(sorted(thread.name for thread in left)) or "none is left"
    findings.append(TriedPromise("after close its threads end", "none is left", told, not left))
    return findings


def reopened(driver: Any, clock: Clock) -> TriedPromise:
    """Open a driver again, and see that it reports."""
    listening = Listening()
    said = refused(lambda: driver.open(listening))
    clock.sleep_until(clock.now() + 0.3 + 3.0 / getattr(driver, "rate", math.inf))
    count = len(listening.motions) + len(listening.forces)
    driver.close()
    return TriedPromise("it can be opened again", "reports", _short(said or f"{count} reports"), count > 0)


def _left(before: set[threading.Thread]) -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread not in before}


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
