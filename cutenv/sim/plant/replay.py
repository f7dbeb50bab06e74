"""A recorded cut as a plant, which returns its readings to any command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._base.validation import in_range
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.tissue.specimen import N_POINTS, SPACING
from cutenv.sim.trace import Trace, blade_speed

_AT_CLAMP = 0.005  # [m], largest distance from the clamp at which a cut may begin
_MIN_RATE = 20.0  # readings a second; with fewer, what happened between them is unknown
_SAME = 1e-6  # [s], largest offset of a reading from its millisecond at which it is not interpolated
_HIDDEN = ("true_force", "elastic_force", "tip", "jump")


class ReplayPlant:
    """Recorded cut, replayed by the millisecond from its first reading.

    ``trace`` has force in newtons, position, angle and depth, and speed unless that is computed from the position;
    readings are interpolated to milliseconds, those of 1 kHz used unchanged.

    Attributes
    ----------
    depth : ndarray of shape (301,)
        Depth of cut every 0.5 mm from the clamp [m], from the record; elsewhere, its nearest value.
    readings : StructArray
        :data:`cutenv.sim.cutting.dtypes.READING`, shape (n,), time from 1 ms on; hidden fields are NaN.

    Raises
    ------
    ValueError
        If the record lacks a field (named), is normalised, has less than 20 readings a second, or does not begin
        within 5 mm of the clamp.
    """

    def __init__(self, trace: Trace) -> None:
        position, angle, depth = trace.require("position", "angle", "depth", by="a replay")
        force = trace.require_newtons(by="a replay")
        in_range("sample_rate", trace.sample_rate, _MIN_RATE, 1e6, "Hz", "Record the force more often.")
        cure = "A cut begins at the clamp: trim the record to where it does, or measure the position from there."
        in_range("position at the start", position[0], -_AT_CLAMP, _AT_CLAMP, "m", cure)
        since = trace.time - trace.time[0]
        grid = np.arange(int((trace.duration + _SAME) / TICK) + 1) * TICK
        as_it_is = len(grid) == len(since) and bool(np.all(np.abs(grid - since) < _SAME))
        speed = blade_speed(trace.time, position) if trace.speed is None else trace.speed
        self.readings: StructArray = np.zeros(len(grid), READING)
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
        """Milliseconds of the record that are left."""
        return len(self.readings) - self._given

    def advance(self, speed: float, angle: float, ticks: int) -> StructArray:
        """Return the next ``ticks`` readings, whatever ``speed`` and ``angle`` are.

        EOFError if fewer are left; see :attr:`left`.
        """
        if ticks > self.left:
            raise EOFError(f"the record holds {self.left} more milliseconds, not {ticks}.")
        self._given += ticks
        return self.readings[self._given - ticks : self._given]
