"""Timing of the control clock over many commands: periods, latencies, overruns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range

QUANTILES = (0.5, 0.99, 0.999)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockKept:
    """Control periods and latencies of all cuts on a rig.

    Parameters
    ----------
    nominal : float
        Requested period [s].
    periods : array_like of shape (n,)
        Time from command to command [s].
    latencies : array_like of shape (m,)
        Time from the newest reading used by a decision to its command on the bus [s].
    overruns : int
        Number of commands more than 2 ms late.
    skipped : float
        Time lost by late commands [s].
    garbled : int
        Number of packets that were no readings.
    """

    nominal: float
    periods: Array
    latencies: Array
    overruns: int = 0
    skipped: float = 0.0
    garbled: int = 0

    def __post_init__(self) -> None:
        in_range("nominal", self.nominal, 1e-3, 1.0, "s", "Give seconds: 20 ms is 0.02.")
        for name in ("periods", "latencies"):
            object.__setattr__(self, name, array_in_range(name, getattr(self, name), -1.0, 3600.0, "s"))

    @classmethod
    def of(cls, nominal: float, parts: Sequence[tuple[ArrayLike, ArrayLike, int, float, int]]) -> ClockKept:
        """Combine cuts, each given as periods, latencies, overruns, skipped and garbled."""
        periods, latencies, overruns, skipped, garbled = zip(*parts, strict=True) if parts else ((), (), (), (), ())
        return cls(
            nominal=nominal,
            periods=np.concatenate([np.zeros(0), *map(np.asarray, periods)]),
            latencies=np.concatenate([np.zeros(0), *map(np.asarray, latencies)]),
            overruns=sum(overruns),
            skipped=float(sum(skipped)),
            garbled=sum(garbled),
        )

    @property
    def jitter(self) -> float:
        """Standard deviation of the periods about the nominal one [s]."""
        return float(np.sqrt(np.mean((self.periods - self.nominal) ** 2))) if len(self.periods) else 0.0

    def spread(self, name: str) -> dict[str, float]:
        """Return the quantiles p50, p99, p99.9 and maximum of "periods" or "latencies" [s]; empty without any."""
        values: Array = getattr(self, name)
        if not len(values):
            return {}
        found = {f"p{100 * q:g}": float(np.quantile(values, q)) for q in QUANTILES}
        return {**found, "max": float(values.max())}

    def to_dict(self) -> dict[str, object]:
        """Return a JSON-serialisable summary, units in the names, without the single values."""
        kept = {key: getattr(self, key) for key in ("overruns", "garbled")}
        return {
            "nominal_period_s": self.nominal,
            "commands": len(self.periods),
            "jitter_sd_s": self.jitter,
            "period_s": self.spread("periods"),
            "latency_s": self.spread("latencies"),
            "skipped_s": self.skipped,
            **kept,
        }
