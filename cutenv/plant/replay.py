"""A recorded cut as a plant: whatever is commanded, it gives back what was felt and where the blade was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv.cutting.records import READING, TICK, Records
from cutenv.measurement.strokes import blade_speed
from cutenv.tissue.specimen import N_POINTS, SPACING
from cutenv.trace import Trace
from cutenv.validation import in_range

_AT_CLAMP = 0.005  # [m] within which a cut begins
_FEWEST = 20.0  # readings a second, below which nothing can be said about what happened between them
_SAME = 1e-6  # [s] by which a reading may miss its millisecond and is taken as it is
_HIDDEN = ("true_force", "elastic_force", "tip", "jump")


class ReplayPlant:
    """A record, given back a millisecond after the other, from its first reading on.

    Parameters
    ----------
    trace : Trace
        With force in newtons, position, angle and depth; its speed is worked out from the position if it holds none.
        Readings are interpolated to milliseconds; those of 1 kHz are taken as they are.

    Attributes
    ----------
    depth : ndarray of shape (301,)
        Depth of cut every 0.5 mm from the clamp [m], as the record holds it; beyond where the blade was, its nearest.
    readings : Records
        :data:`cutenv.cutting.records.READING`, shape (n,), time from 1 ms on; hidden fields are NaN.

    Raises
    ------
    ValueError
        If the record lacks a field (named), is normalised, has less than 20 readings a second, or does not begin
        within 5 mm of the clamp.
    """

    def __init__(self, trace: Trace) -> None:
        position, angle, depth = trace.require("position", "angle", "depth", by="a replay")
        force = trace.require_newtons(by="a replay")
        in_range("sample_rate", trace.sample_rate, _FEWEST, 1e6, "Hz", "Record the force more often.")
        cure = "A cut begins at the clamp: cut the record to where it does, or count the position from there."
        in_range("position at the start", position[0], -_AT_CLAMP, _AT_CLAMP, "m", cure)
        since = trace.time - trace.time[0]
        grid = np.arange(int((trace.duration + _SAME) / TICK) + 1) * TICK
        as_it_is = len(grid) == len(since) and bool(np.all(np.abs(grid - since) < _SAME))
        speed = blade_speed(trace.time, position) if trace.speed is None else trace.speed
        self.readings: Records = np.zeros(len(grid), READING)
        self.readings["time"] = grid + TICK
        for name, values in {"force": force, "position": position, "speed": speed, "angle": angle}.items():
            self.readings[name] = values if as_it_is else np.interp(grid, since, values)
        for name in _HIDDEN:
            self.readings[name] = np.nan
        places, first = np.unique(position, return_index=True)
        self.depth: NDArray[np.float64] = np.interp(np.arange(N_POINTS) * SPACING, places, depth[first])
        self._given = 0

    @property
    def left(self) -> int:
        """Milliseconds that are still to be given."""
        return len(self.readings) - self._given

    def advance(self, speed: float, angle: float, ticks: int) -> Records:
        """The next ``ticks`` readings, whatever ``speed`` and ``angle`` are.

        Raises
        ------
        EOFError
            If the record holds no more; see :attr:`left`.
        """
        if ticks > self.left:
            raise EOFError(f"the record holds {self.left} more milliseconds, not {ticks}.")
        self._given += ticks
        return self.readings[self._given - ticks : self._given]
