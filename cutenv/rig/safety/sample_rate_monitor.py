"""Check that an axis's samples come once with every SYNC, not doubled by the bus or requested by another master."""

from __future__ import annotations

import math

SURPLUS = 4.0
"""Surplus of samples over SYNCs from which it is no jitter."""
_STALLED = 0.25  # [s] of samples that may come at once, after this computer has stalled
_MEMORY = 20.0  # SYNCs after which a surplus or a lack is forgotten


class SampleRateMonitor:
    """Counter of the samples of one axis against the time.

    Parameters
    ----------
    sync : float
        Time between samples [s].
    """

    def __init__(self, sync: float) -> None:
        self._sync = sync
        self._last: float | None = None
        self.surplus = 0.0

        """Surplus of samples over SYNCs; negative if some were lost or are late."""

    def count(self, time: float) -> None:
        """Count a sample at ``time`` [s]."""
        last, self._last = self._last, time
        if last is not None:
            syncs = max(time - last, 0.0) / self._sync
            surplus = self.surplus * math.exp(-syncs / _MEMORY) + 1.0 - syncs
            self.surplus = min(max(surplus, -_STALLED / self._sync), 1.5 * SURPLUS)
