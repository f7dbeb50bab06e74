"""Last samples of an axis that moves in a straight line: what may be read from them, and from how many."""

from __future__ import annotations

from collections import deque

from cutenv.rig.devices.samples import MotionSample

REST_SPEED = 1e-4
"""Speed below which the blade counts as at rest [m/s]."""
SAMPLES = 3
"""Samples over which acceleration is measured, and standstill decided."""
LONG = 9
"""Samples over which speed is computed from position, whatever speed the drive reports."""
JITTER = 1.2
"""Factor on the limit for such a speed [1]: samples arrive unevenly."""
CREEP = 0.002
"""Greatest speed at which a blade returns from beyond an end of its travel [m/s]."""
FASTER = 2.0
"""Multiple of :data:`CREEP` from which the return is a breach [1]."""
OUTWARD = 2e-4
"""Distance outward from the innermost position reached, from which the return is a breach [m]."""


def rests(samples: deque[MotionSample]) -> bool:
    """Return whether an axis is at rest, as far as its samples show."""
    last = list(samples)[-SAMPLES:]
    return len(last) == SAMPLES and all(abs(sample.speed) < REST_SPEED for sample in last)


def elapsed(samples: deque[MotionSample], count: int, sync: float) -> float:
    """Return the time from the first of the last ``count`` samples to the newest [s].

    A computer that stalled gets several samples at once; they count as one period ``sync`` [s] apart.
    """
    count = min(count, len(samples))
    return max(samples[-1].time - samples[-count].time, (count - 1) * sync, 1e-6)
