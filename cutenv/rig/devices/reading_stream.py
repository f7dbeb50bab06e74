"""Readings of a force sensor by their regular numbers.

Packets arrive with jitter; the numbers give their order, mean and time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

from cutenv._base.validation import in_range
from cutenv.rig.errors import RigError

SEQUENCES = 1 << 32  # numbers of readings, which are counted modulo this
LEAK = 1e-3  # rate at which the least delay may grow [s/s]: ten times the drift between two quartz clocks
FAR = 100  # number of readings by which an old one may come late; beyond it, the sensor has restarted
_AHEAD = 1.0  # [s] by which a number may come early and still belong to the same stream


class SampleClock:
    """Estimator of the even time grid on which readings were sampled.

    A reading ``n`` cannot arrive before it was sampled, and some arrive with almost no delay. The least delay seen
    (over ``n / rate``) is therefore taken as the transport delay; anything above it is lateness. The least delay grows
    at ``leak``, so that it follows a sensor whose clock runs slower than this computer's; it follows a faster one by
    itself. An added constant delay shows at once in full, and is forgotten at that same rate: 10 ms of it in 10 s.
    ``rate`` [Hz] is as the sensor reports it; ``leak`` [s/s] is above its relative error. Raise ValueError if the rate
    is not above zero.
    """

    def __init__(self, rate: float, leak: float = LEAK) -> None:
        self._period = 1.0 / in_range("rate", rate, 1e-3, 1e6, "Hz", "Give the readings a second of the sensor.")
        self._leak = leak
        self._sequence = -1  # of the last reading; -1: none so far
        self._elapsed = 0.0  # [s] by the sensor's numbers, since the first
        self._least = 0.0  # [s] of the clock at which reading zero would have arrived, had it come without delay
        self._arrival = 0.0
        self._time = 0.0

    def sensed(self, sequence: int, arrival: float) -> tuple[float, float]:
        """Return a reading's sampling time, and its extra delay.

        ``sequence`` is its number, modulo 2**32; missing ones in between do not matter. The time [s] is up to the least
        transport delay, which cannot be known; never after ``arrival`` [s], and never before that of an earlier call.
        The delay [s] is that beyond the least one, 0 or more.
        """
        if self._sequence < 0:
            return self._begin(sequence, arrival)
        step = (sequence - self._sequence) % SEQUENCES
        if step >= SEQUENCES // 2:
            step -= SEQUENCES  # an earlier one
        elapsed = self._elapsed + step * self._period
        delay = arrival - elapsed
        # A restarted sensor counts from the beginning again, or from anywhere.
        if step < -FAR or delay < self._least - _AHEAD:
            return self._begin(sequence, arrival)
        self._least = min(self._least + self._leak * max(arrival - self._arrival, 0.0), delay)
        self._sequence, self._elapsed, self._arrival = sequence, elapsed, arrival
        self._time = max(self._time, self._least + elapsed)
        return self._time, delay - self._least

    def _begin(self, sequence: int, arrival: float) -> tuple[float, float]:
        self._sequence, self._elapsed = sequence, 0.0
        self._least = self._arrival = self._time = arrival
        return arrival, 0.0


STEADY_FORCE = 0.1  # greatest difference between the means of a tare's ten parts, for each force [N]: more is not rest
_PARTS = 10  # of a tare

Zero = tuple[float, float, float, float, float, float]  # six counts, of forces and torques


class CountedReading(Protocol):
    """Reading with six counts and status."""

    @property
    def counts(self) -> tuple[int, int, int, int, int, int]:
        """Counts of forces and torques."""
        ...

    @property
    def status(self) -> int:
        """Status of the sensor; 0 is healthy."""
        ...


class ReadingStream:
    """Classifier of sequence numbers.

    A number that does not fit is accepted only when the next one follows it: one broken record does not disturb the
    stream, and a restarted sensor is accepted with its second record.
    """

    OLD = -1
    STRANGE = -2

    def __init__(self, rate: float) -> None:
        self.last = -1
        self._rate, self._arrival = rate, 0.0
        self._stranger = -1

    def place(self, sequence: int, now: float) -> int:
        """Return the records lost before it, or OLD or STRANGE.

        OLD: drop it; STRANGE: drop it, and wait for the next.
        """
        if self.last < 0:
            lost = 0
        else:
            step = (sequence - self.last) % SEQUENCES
            if step == 0 or step >= SEQUENCES - FAR:
                return self.OLD
            # No more can be missing than were sent since the last arrival, at twice the rate to be generous.
            if step > FAR + 2.0 * self._rate * (now - self._arrival):
                if self._stranger < 0 or not 0 < (sequence - self._stranger) % SEQUENCES <= FAR:
                    self._stranger = sequence
                    return self.STRANGE
                step = 1  # losses over a restart are unknown
            lost = step - 1
        self.last, self._arrival, self._stranger = sequence, now, -1
        return lost


class ReadingMean:
    """Mean of so many readings, and of its ten parts.

    Updated by the loop, awaited by another thread.
    """

    def __init__(self, samples: float) -> None:
        cure = "A fifth of a second is usual: 200 at 1 kHz."
        samples = round(in_range("samples", samples, _PARTS, 1e6, "1", cure))
        self.samples, self.taken, self.status = samples, 0, 0
        self.done = threading.Event()
        self._parts = [[0] * 7 for _ in range(_PARTS)]  # sums of the six components, and how many

    def add(self, record: CountedReading) -> None:
        """Take a reading; more than are needed do not count."""
        if self.done.is_set():
            return
        part = self._parts[self.taken * _PARTS // self.samples]
        for axis in range(6):
            part[axis] += record.counts[axis]
        part[6] += 1
        self.taken += 1
        self.status |= record.status
        if self.status or self.taken == self.samples:
            self.done.set()

    def awaited(self, rate: float, newtons_per_count: float, meaning: Callable[[int], str]) -> Zero:
        """Wait until it is complete, and return it, in counts.

        ``rate`` [Hz] is that of the readings; ``meaning`` returns the text of a status. Raise RigError if readings
        stop, report an error, or vary by more than :data:`STEADY_FORCE`.
        """
        done = self.done.wait(1.0 + 3.0 * self.samples / rate)
        if self.status:
            raise RigError(f"The force sensor reports {meaning(self.status)}: no zero can be taken from it.")
        if not done:
            raise RigError(
                f"Only {self.taken} of {self.samples} readings of the force sensor came: is it still streaming?"
            )
        moved = self.spread() * abs(newtons_per_count)
        if moved > STEADY_FORCE:
            raise RigError(
                f"The force moved by {moved:.2f} N while its mean was taken, more than {STEADY_FORCE:g} N: wait until "
                "the blade rests and touches nothing."
            )
        return self.value()

    def value(self) -> Zero:
        """Return the mean [counts]."""
        fx, fy, fz, tx, ty, tz = (sum(part[axis] for part in self._parts) / self.samples for axis in range(6))
        return fx, fy, fz, tx, ty, tz

    def spread(self) -> float:
        """Return the largest difference of partial means, any force [counts]."""
        means = [[part[axis] / part[6] for part in self._parts] for axis in range(3)]
        return max(max(axis) - min(axis) for axis in means)
