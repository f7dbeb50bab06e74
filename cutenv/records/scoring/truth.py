"""Hidden state of a simulated cut, in a record's metadata."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range
from cutenv.sim.tissue.grid import N_POINTS

TIP_AT_END = "tip_end_m"  # metadata in which a simulator notes the true crack tip at the end of its record [m]
FLOOR_AT_END = "floor_end_m"
"""Metadata in which a simulator notes the depth of the floor at the end, every 0.5 mm from the clamp to the tip [m]."""
ASIDE_AT_END = "aside_end_m"
"""Metadata in which a simulator notes how far the cut is to the left of its line at the end, every 0.5 mm [m]."""
_MAX_PLACE = 0.5  # [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """Hidden state of a simulated cut, for scoring.

    Parameters
    ----------
    tip : array_like of shape (n,)
        Crack tip at every instant of the trace [m].
    jump : array_like of shape (n,)
        Unstable growth at that instant [m].
    resistance : float
        Mean fracture resistance of the cut tissue, friction's share included [J/m2].
    floor : array_like of shape (m,), optional
        Depth of the floor below the surface every 0.5 mm from the clamp to the tip [m], of a blade that moves up and
        down; without it the floor is expected from the motion.
    aside : array_like of shape (m,), optional
        Distance of the cut to the left of its line every 0.5 mm from the clamp to the tip [m], of a blade that is
        steered; without it the cut is expected from the motion.
    """

    tip: Array
    jump: Array
    resistance: float
    floor: Array | None = None
    aside: Array | None = None

    def __post_init__(self) -> None:
        for name in ("tip", "jump"):
            object.__setattr__(self, name, array_in_range(name, getattr(self, name), -0.05, 0.5, "m", "8 cm is 0.08."))
        in_range("resistance", self.resistance, 1.0, 1e6, "J/m2", "0.211 kJ/m2 is 211.")
        if self.floor is not None:
            object.__setattr__(self, "floor", checked_floor("floor", self.floor))
        if self.aside is not None:
            object.__setattr__(self, "aside", checked_aside("aside", self.aside))


def checked_floor(name: str, depth: Any) -> Array:
    """Return a floor's depth [m], shape (m,), checked."""
    floor = array_in_range(name, depth, 0.0, 0.1, "m", "8 mm is 0.008.")
    if floor.ndim != 1 or not 1 <= len(floor) <= N_POINTS:
        raise ValueError(f"{name} has shape {floor.shape}; give one depth every 0.5 mm, 1 to {N_POINTS} of them.")
    return floor


def checked_aside(name: str, aside: Any) -> Array:
    """Return checked distances to the cut's line [m], shape (m,)."""
    found = array_in_range(name, aside, -0.1, 0.1, "m", "2 mm is 0.002.")
    if found.ndim != 1 or not 1 <= len(found) <= N_POINTS:
        raise ValueError(f"{name} has shape {found.shape}; give one distance every 0.5 mm, 1 to {N_POINTS} of them.")
    return found


def noted_tip(metadata: Mapping[str, Any]) -> float | None:
    """Return the final crack tip noted in metadata [m], or None."""
    noted = metadata.get(TIP_AT_END)
    if isinstance(noted, int | float) and math.isfinite(noted) and 0.0 <= noted <= _MAX_PLACE:
        return float(noted)
    return None
