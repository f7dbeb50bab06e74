"""How well the control clock of a rig is kept."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Timing:
    """How well the control clock was kept since the last :meth:`cutenv.rig.plant.RigPlant.begin`."""

    periods: list[float] = field(default_factory=list)
    """From command to command [s]."""
    latencies: list[float] = field(default_factory=list)
    """From the newest reading that a decision knew to its command on the bus [s]."""
    lateness: list[float] = field(default_factory=list)
    """Of commands, behind their due time [s]."""
    overruns: int = 0
    """Commands that came more than 2 ms late."""
    skipped: float = 0.0
    """Time that late commands have cost, beyond whole periods [s]."""
    garbled: int = 0
    """Packets that were no readings."""
