"""Haptic handle that is polled in a thread of its own.

Newest position in, newest force out, zero when either is stale.

A force reaches the device only while it is fresh: if the session has pushed none for longer than the coupling's period,
or the device has answered with no sound sample for :data:`STALE`, zero is sent until both are well again. A device that
stays silent for :data:`LOST` is an error, which ends the session and keeps its record.

An account of energy is kept here, exchange by exchange, with the force that was sent and the time for which the device
has held it. An exchange that takes longer than the coupling's period, which its stiffness was chosen for, is answered
by no force until the device has received as much energy as it may have returned.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from cutenv._base.validation import in_range, one_of
from cutenv.people.play.devices import INCLINED, LEVEL_REACH, TRAVEL
from cutenv.people.play.haptics import HandEnergy, Stylus, VirtualCoupling
from cutenv.sim.cutting.dtypes import TICK

STALE = 0.020
"""Age of the newest sample beyond which no force is sent [s]."""
LOST = 1.0
"""Age of the newest sample beyond which the device is lost [s]."""
FIRST_SAMPLE = 3.0
"""Time in which a device must send its first sample [s]."""
_LEAN_TRAVEL = 0.02  # [m] of the handle across the cut, from upright to 45 degrees
_REACH = 1.0  # [m] from a desktop device's origin, beyond which a position is none
_UPRIGHT = 0.5 * math.pi


class HandleSample(NamedTuple):
    """Place of a handle [m] in its own axes, and buttons held down."""

    position: tuple[float, float, float]
    buttons: frozenset[str] = frozenset()


class HandleLink(Protocol):
    """Connection to a handle, used by one thread."""

    def open(self) -> None:
        """Connect; raise OSError, with cure, without a ready device."""
        ...

    def exchange(self, force: tuple[float, float, float]) -> HandleSample:
        """Apply a force [N] until the next call; return the newest sample.

        Raises TimeoutError if no answer came in time, ValueError for an answer that is no sample, and OSError if the
        connection has ended.
        """
        ...

    def close(self) -> None:
        """End the connection; the device lets go. Further calls do nothing."""
        ...


@dataclass(frozen=True, kw_only=True)
class HandleAxes:
    """Assignment of a handle's axes, reversed by a minus, all different."""

    along: str = "x"  # leads the blade along the cut
    lean: str = "y"  # 20 mm from where the cut began incline it to 45 degrees
    up: str = "z"  # raises the blade where a depth is wanted

    def __post_init__(self) -> None:
        for name in ("along", "lean", "up"):
            one_of(name, getattr(self, name), ("x", "y", "z", "-x", "-y", "-z"))
        if len({getattr(self, name)[-1] for name in ("along", "lean", "up")}) < 3:
            raise ValueError(f"axes {self.along}, {self.lean}, {self.up} use one twice. Give three different ones.")

    @classmethod
    def parse(cls, text: str) -> HandleAxes:
        """Parse axes such as ``-y,x,z``; ValueError unless three."""
        names = [name.strip() for name in text.split(",")]
        if len(names) != 3:
            raise ValueError(f"axes {text!r} are not three. Write ALONG,LEAN,UP, such as x,y,z.")
        return cls(along=names[0], lean=names[1], up=names[2])

    def moved(self, name: str, sample: HandleSample, origin: HandleSample) -> float:
        """Return a handle's motion along an axis since ``origin`` [m]."""
        axis: str = getattr(self, name)
        k = "xyz".index(axis[-1])
        return (-1.0 if axis.startswith("-") else 1.0) * (sample.position[k] - origin.position[k])

    def force(self, against: float) -> tuple[float, float, float]:
        """Return a force against forward motion [N] in the handle's axes."""
        values = [0.0, 0.0, 0.0]
        values["xyz".index(self.along[-1])] = against if self.along.startswith("-") else -against
        return values[0], values[1], values[2]


def checked_sample(position: tuple[float, float, float], buttons: frozenset[str] = frozenset()) -> HandleSample:
    """Return a sample; ValueError for an impossible position."""
    if not all(-_REACH <= value <= _REACH for value in position):  # also refuses NaN
        raise ValueError(f"position {position} is outside {_REACH:g} m, or no number.")
    return HandleSample(position, buttons)


class PolledHandle:
    """Haptic device, polled a thousand times a second.

    A thread of its own talks to its link. The coupling's period is the longest time that a force is held. Counted are
    exchanges in which zero was sent for a ``stale`` sample, ``unsound`` or late answers, and exchanges that took
    ``overlong``, beyond that period; ``longest`` is the longest time so far for which the device has held a force [s].
    """

    def __init__(
        self,
        link: HandleLink,
        coupling: VirtualCoupling,
        axes: HandleAxes | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._link, self.coupling, self._clock = link, coupling, clock
        self._axes = axes or HandleAxes()
        self.stale = self.unsound = self.overlong = 0
        self.longest = 0.0
        self._account = HandEnergy(coupling)
        self._sent, self._sent_at = 0.0, -math.inf  # force that the device holds [N], since when [s]
        self._pushed: tuple[float, float] = (0.0, -math.inf)  # force [N], when [s]
        self._newest: tuple[HandleSample, float] | None = None
        self._origin: HandleSample | None = None
        self._error: Exception | None = None
        self._stop = threading.Event()
        self._first = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Connect at first, and set the clamp; OSError without samples."""
        if self._thread is None:
            self._link.open()
            self._thread = threading.Thread(target=self._run, name="cutenv handle", daemon=True)
            self._thread.start()
            if not self._first.wait(FIRST_SAMPLE) and self._error is None:
                self.close()
                raise OSError(f"the haptic device sent no sample within {FIRST_SAMPLE:g} s. Start it again.")
        self._origin = self._sample()

    def read(self) -> Stylus:
        """Return the newest sample, without waiting; OSError if the device is lost."""
        sample, origin = self._sample(), self._origin
        if origin is None:
            raise OSError("the haptic device is not open.")
        along = self._axes.moved("along", sample, origin)
        lean = min(max(self._axes.moved("lean", sample, origin) / _LEAN_TRAVEL, 0.0), 1.0)
        level = self._axes.moved("up", sample, origin)
        return Stylus(
            min(max(along, 0.0), TRAVEL),
            _UPRIGHT - lean * (_UPRIGHT - INCLINED),
            sample.buttons,
            min(max(level, -LEVEL_REACH), LEVEL_REACH),
        )

    def push(self, force: float) -> None:
        """Apply a force against forward motion [N], one period at most."""
        limit = self.coupling.force_limit
        self._pushed = (in_range("force", force, -limit, limit, "N", "The coupling limits it."), self._clock())

    def close(self) -> None:
        """End the force and the connection; further calls do nothing."""
        self._stop.set()
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(LOST)
        self._link.close()

    def _sample(self) -> HandleSample:
        if self._error is not None:
            raise OSError(f"the haptic device is lost: {self._error}") from self._error
        if self._newest is None or self._clock() - self._newest[1] > LOST:
            raise OSError(f"the haptic device has sent nothing sound for {LOST:g} s. Check its cable and its service.")
        return self._newest[0]

    def _wanted(self) -> float:
        """Return the force to send [N], zero when stale."""
        force, since = self._pushed
        now = self._clock()
        if self._newest is None or now - self._newest[1] > STALE:
            self.stale += force != 0.0
            return 0.0
        if now - since > self.coupling.period:
            return 0.0
        allowed = self._account.allowed
        return min(max(force, -allowed), allowed)

    def _enter(self, moved: float, now: float) -> None:
        """Enter the device's motion [m] under the held force until ``now`` [s]."""
        held = now - self._sent_at
        if not held <= self.coupling.period:  # what its friction took in that time is unknown, and so is the energy
            self._account.energy = min(self._account.energy + self._sent * moved, 0.0)
            self.overlong += math.isfinite(held)
        elif held > 0.0:
            self._account.held(self._sent, moved, held)
        if math.isfinite(held):
            self.longest = max(self.longest, held)

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                due = self._clock() + TICK
                self._exchange(self._wanted())
                time.sleep(max(due - self._clock(), 0.0))
            self._exchange(0.0)
        except Exception as error:  # read() raises it
            self._error = error
            self._first.set()
        finally:
            self._link.close()

    def _exchange(self, force: float) -> None:
        last, began = self._newest, self._clock()
        try:
            sample = self._link.exchange(self._axes.force(force))
        except (TimeoutError, ValueError):
            self.unsound += 1
            sample = None
        now = self._clock()
        if sample is not None and last is not None:
            self._enter(self._axes.moved("along", sample, last[0]), now)
        # Until the next exchange has ended, the device may hold either force: the one that could return more counts.
        self._sent = max(force, self._sent, key=abs) if sample is None else force
        self._sent_at = began if sample is None else now
        if sample is None:
            return
        self._newest = (sample, now)
        self._first.set()
