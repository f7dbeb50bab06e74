"""Whether an axis's samples come once with every SYNC, or more often: doubled on the bus, or asked for by another."""

from __future__ import annotations

import math

SURPLUS = 4.0
"""Samples more than there were SYNCs, from which they are no jitter."""
_STALLED = 0.25  # [s] of samples that may come at once, after a computer has stalled
_MEMORY = 20.0  # SYNCs after which a surplus or a lack is forgotten


class Cadence:
    """Counts the samples of one axis against the time.

    Parameters
    ----------
    sync : float
        Between samples [s].
    """

    def __init__(self, sync: float) -> None:
        self._sync = sync
        self._last: float | None = None
        self.surplus = 0.0

        """Samples more than SYNCs; negative after some were lost or are late."""

    def count(self, time: float) -> None:
        """Take a sample at ``time`` [s]."""
        last, self._last = self._last, time
        if last is not None:
            syncs = max(time - last, 0.0) / self._sync
            surplus = self.surplus * math.exp(-syncs / _MEMORY) + 1.0 - syncs
            self.surplus = min(max(surplus, -_STALLED / self._sync), 1.5 * SURPLUS)
