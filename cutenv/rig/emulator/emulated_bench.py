"""Base of every emulated rig: tissue, faults, events, and the loop that advances it by a millisecond at a time."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from cutenv._base.validation import one_of
from cutenv.cutting.dtypes import TICK
from cutenv.rig.config.laid import Laid
from cutenv.rig.emulator.emulated_tissue import EmulatedTissue
from cutenv.rig.emulator.faults import InjectedFault
from cutenv.rig.errors import RigError

STALL = 0.005
"""Delay of the loop from which it is counted as a stall [s]."""
_FORGIVEN = 0.25  # [s] of delay that is caught up; more is skipped
_STILL = 1e-4  # [m/s] below which the carriage is at rest
_KEPT_EVENTS = 10_000


class EmulatedBench(ABC):
    """Emulated rig of any kind; :meth:`run` advances the time.

    Parameters
    ----------
    bench : EmulatedTissue
        Tissue under the blade.
    force_limit : float
        True force whose crossing is recorded as an event [N].

    Attributes
    ----------
    stalls, worst_stall : int, float
        Number of delays of the loop beyond :data:`STALL`, and the longest [s].
    real_time : bool
        True if it has priority over other processes.
    stopped : threading.Event
        Set it to end :meth:`run`.
    """

    faults: ClassVar[Mapping[str, InjectedFault]]
    """Faults that it knows, by name."""
    stands_after: ClassVar[int] = 5
    """Milliseconds without motion after which the carriage has come to rest."""
    cross_axes: tuple[str, ...] = ()
    """Names of the axes across the cut, "height" and "side"."""

    def __init__(self, bench: EmulatedTissue, force_limit: float) -> None:
        self.bench = bench
        self.lock = threading.RLock()
        self.stopped = threading.Event()
        self.stalls, self.worst_stall = 0, 0.0
        self.real_time = False
        self.force_limit = force_limit
        self.active: dict[tuple[str, str], dict[str, Any]] = {}
        self._events: deque[dict[str, Any]] = deque(maxlen=_KEPT_EVENTS)
        self._counted = 0
        self._due: float | None = None  # end of the next millisecond; None: time stands still
        self._still = self.stands_after
        self._planned: list[tuple[float, str, dict[str, Any]]] = []

    def now(self) -> float:
        """Return the time of the machine's monotonic clock [s]."""
        return time.monotonic()

    @property
    @abstractmethod
    def position(self) -> float:
        """Position of the carriage from the clamp [m]."""

    @property
    @abstractmethod
    def speed(self) -> float:
        """Speed of the carriage [m/s]."""

    @property
    @abstractmethod
    def angle(self) -> float:
        """Angle of the blade [rad]."""

    @property
    @abstractmethod
    def axis_names(self) -> Sequence[str]:
        """Names of the driven axes."""

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """Return the state of its devices, for JSON: "nodes" and "clients" at least."""

    @abstractmethod
    def truth(self) -> dict[str, Any]:
        """Return more of what only an emulator knows, for JSON."""

    @abstractmethod
    def step(self, due: float) -> None:
        """Advance by one millisecond, that of time ``due`` [s]."""

    @abstractmethod
    def close(self) -> None:
        """Stop listening; may be called twice."""

    # Requests of the control port.

    def mount(self, laid: Laid) -> None:
        """Lay a fresh specimen; see :meth:`EmulatedTissue.mount`."""
        specimen = laid.drawn()
        with self.lock:
            self.bench.mount(specimen, laid, position=self.position, angle=self.angle)

    def inject(self, name: str, given: dict[str, Any]) -> dict[str, Any]:
        """Start a fault now; return its parameters.

        Raises
        ------
        ValueError, TypeError
            For an unknown fault or parameter, or a value out of range.
        """
        fault = self.faults[one_of("fault", name, self.faults)]
        parameters = fault.checked(name, given, list(self.axis_names))
        with self.lock:
            fault.begin(self, parameters)
            self.active[name, parameters.get("axis", "")] = parameters
            self.happened("fault injected", fault=name, **parameters)
        return parameters

    def inject_later(self, name: str, given: dict[str, Any], seconds: float) -> None:
        """Start a fault ``seconds`` after :meth:`run` has begun; see :meth:`inject`."""
        fault = self.faults[one_of("fault", name, self.faults)]
        fault.checked(name, given, list(self.axis_names))
        self._planned.append((seconds, name, given))
        self._planned.sort(key=lambda planned: planned[0])

    def clear(self, name: str | None = None) -> list[str]:
        """End one fault, or all; return their names.

        Raises
        ------
        RigError
            If that fault is not active.
        """
        with self.lock:
            found = [key for key in self.active if name in (None, key[0])]
            if name is not None and not found:
                listed = ", ".join(sorted({key[0] for key in self.active})) or "none"
                raise RigError(f"no fault {name!r} to clear; active: {listed}.")
            for key in found:
                self.faults[key[0]].end(self, self.active.pop(key))
                self.happened("fault cleared", fault=key[0])
            return [key[0] for key in found]

    def happened(self, what: str, *, time: float | None = None, **details: Any) -> None:
        """Record an event, now or at a ``time`` of the monotonic clock [s], with the position of the carriage."""
        moment = self.now() if time is None else time
        with self.lock:
            position = self.position
            self._events.append(
                {"index": self._counted, "time_s": moment, "what": what, "position_m": position, **details}
            )
            self._events[-1].update(self._noted())
            self._counted += 1

    def _noted(self) -> dict[str, Any]:
        """Return more that is recorded with every event."""
        return {}

    def events(self, since: int = 0) -> list[dict[str, Any]]:
        """Return the events from index ``since`` on."""
        with self.lock:
            return [event for event in self._events if event["index"] >= since]

    # Time.

    def run(self) -> None:
        """Advance by a millisecond every millisecond, until :attr:`stopped` is set; late ones are caught up."""
        begun = self.now()
        with self.lock:
            self._due = begun
        while not self.stopped.is_set():
            while self._planned and self.now() - begun >= self._planned[0][0]:
                _, name, given = self._planned.pop(0)
                self.inject(name, given)
            due = self._catch_up(self.now())
            if (left := due - self.now()) > 0.0:
                time.sleep(left)

    def _catch_up(self, now: float) -> float:
        """Advance by all milliseconds that are due, none before :meth:`run`; return the end of the next one [s]."""
        with self.lock:
            if self._due is None:
                return now
            late = now - self._due
            if late > STALL:
                self.stalls += 1
                self.worst_stall = max(self.worst_stall, late)
                self.happened("stall", late_s=late)
                if late > _FORGIVEN:
                    self._due = now
            while self._due <= now:
                self.step(self._due)
                self._due += TICK
            return self._due

    def _watch(self, due: float, before: float, force: float, speed: float) -> None:
        if before < self.force_limit <= force:
            self.happened("force limit crossed", time=due, force_N=force)
        self._still = self._still + 1 if speed < _STILL else 0
        if self._still == self.stands_after:
            self.happened("standstill", time=due - self.stands_after * TICK)
