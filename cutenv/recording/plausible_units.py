"""Units of columns whose file is silent: the one in which a cut lasts seconds, goes millimetres, and is sampled so."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array
from cutenv.recording.cell_values import CellValues
from cutenv.recording.schema import UNITS

LEAST_RATE, GREATEST_RATE = 1.0, 1e5
"""Readings a second of a record [Hz], beyond which its unit of time must be wrong."""
_USUAL_RATE = (4.0, 5e4)  # [Hz]
_USUAL_TIME = (0.2, 3.6e4)  # [s]
_USUAL_WAY = (2e-3, 0.25)  # [m]
_CUT_WAY = (5e-3, 0.15)  # [m] of most cuts
_TIMES = ("s", "ms", "us", "ns", "d", "min", "h")
_WAYS = ("mm", "m", "cm", "um", "in")
_EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # of times since 1970, within a factor of three
_FEWEST = 20  # readings that show a unit


def usual_step(time: Array) -> float:
    """Return the mean step of a column of times, in its unit; repeated and missing readings count."""
    known = time[np.isfinite(time)]
    rising = np.diff(known)
    rising = rising[rising > 0.0]
    if not len(rising):
        return 0.0
    typical = float(np.median(rising))
    tied = len(known) / (1 + np.count_nonzero(np.diff(known) > 0.0))
    return typical / tied if tied > 1.5 else typical


def time_units(cells: CellValues) -> tuple[str, ...]:
    """Return the units in which a column may be the time of a record, the likeliest first; empty if in none."""
    if cells.unit:
        return ("s",)
    known = cells.values[np.isfinite(cells.values)]
    step, length = usual_step(known), float(np.ptp(known)) if len(known) else 0.0
    if len(known) < _FEWEST:
        return ("s",)
    if not step:
        return ()
    size = {unit: UNITS["time"][unit] for unit in _TIMES}
    good = [
        unit
        for unit in _TIMES
        if _USUAL_RATE[0] <= 1.0 / (step * size[unit]) <= _USUAL_RATE[1]
        and _USUAL_TIME[0] <= length * size[unit] <= _USUAL_TIME[1]
    ]
    since = cells.origin + float(known[0])
    epochs = [unit for unit in good if unit in _EPOCHS and _EPOCHS[unit] / 3.0 < since < 3.0 * _EPOCHS[unit]]
    if epochs:
        return tuple(epochs)
    if good and good[0] in ("s", "ms", "us", "ns"):
        return tuple(unit for unit in good if unit in ("s", "ms", "us", "ns"))
    return tuple(good)


def way_units(values: Array) -> tuple[str, ...]:
    """Return the units in which a column may be the way of a blade, the likeliest first; empty if in none."""
    known = values[np.isfinite(values)]
    way = float(np.ptp(known)) if len(known) else 0.0
    if len(known) < _FEWEST:
        return ("m",)
    good = [unit for unit in _WAYS if _USUAL_WAY[0] <= way * UNITS["position"][unit] <= _USUAL_WAY[1]]
    good.sort(key=lambda unit: not _CUT_WAY[0] <= way * UNITS["position"][unit] <= _CUT_WAY[1])
    return tuple(good)
