"""Timing of a rig's control clock."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Timing:
    """Timing of the control clock since the last :meth:`cutenv.rig.plant.RigPlant.begin`."""

    periods: list[float] = field(default_factory=list)
    """Times from command to command [s]."""
    latencies: list[float] = field(default_factory=list)
    """Times from the newest reading that a decision used to its command on the bus [s]."""
    lateness: list[float] = field(default_factory=list)
    """Delays of commands behind their due time [s]."""
    overruns: int = 0
    """Number of commands more than 2 ms late."""
    skipped: float = 0.0
    """Time lost to late commands, beyond whole periods [s]."""
    garbled: int = 0
    """Number of packets that were not readings."""
