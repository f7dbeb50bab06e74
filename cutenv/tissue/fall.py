"""Fall of the local effective modulus with speed: linear, or piecewise linear between measured speeds."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range

Falls = tuple[tuple[float, float, float], ...]
"""Steps of a fall: share of the whole [1], and the two speeds [m/s] between which it is linear."""

MOST = 3
"""Largest number of steps that the cutting law has fields for."""


def checked_falls(name: str, given: Iterable[Iterable[float]]) -> Falls:
    """Return the steps as a tuple, also from lists read from a file; raise ValueError, naming the field, if invalid."""
    shape = f"{name}: give up to {MOST} steps (share, from [m/s], to [m/s]) whose shares sum to 1, or () for a line."
    try:
        falls = tuple((float(share), float(start), float(end)) for share, start, end in given)
    except (TypeError, ValueError):
        raise ValueError(f"{shape} Found {given!r}.") from None
    if len(falls) > MOST or (falls and abs(sum(share for share, *_ in falls) - 1.0) > 1e-6):
        raise ValueError(f"{shape} Found {falls!r}.")
    for share, start, end in falls:
        in_range(f"{name}, share", share, 0.0, 1.0, "1", "0.4 is 40 % of the fall.")
        in_range(f"{name}, from", start, 0.0, 0.5, "m/s", "1.27 cm/s is 0.0127.")
        in_range(f"{name}, to", end, start + 1e-6, 0.5, "m/s", "A step ends at a greater speed than it begins.")
    return falls


def end_of_fall(falls: Falls) -> float:
    """Return the speed [m/s] at which the last step ends; a line of the same mean slope has fallen as far there."""
    return max(end for *_, end in falls)


def speed_on_line(speed: ArrayLike, falls: Falls) -> Array:
    """Return the speed [m/s] at which a line of the same mean slope has fallen as far; ``speed`` if no steps."""
    v = np.asarray(speed, np.float64)
    if not falls:
        return v
    fallen = sum(share * np.clip((v - start) / (end - start), 0.0, 1.0) for share, start, end in falls)
    return np.asarray(end_of_fall(falls) * fallen)
