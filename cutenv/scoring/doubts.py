"""Why a record cannot be scored as one whole cut: what its sensor did, where it was cut off, that it holds two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv.measurement import flaws
from cutenv.measurement.strokes import STANDSTILL, blade_speed
from cutenv.trace import Trace

Array = NDArray[np.float64]

LONGEST = 3600.0
"""Of a record that is scored [s]: an hour is no cut."""
_LAST, _MOVES = 0.1, 0.8e-3  # [s], [m/s]: the slowest cut of the thesis is led at 1 mm/s
_OPEN = 0.015  # [m] behind the furthest point the crack is open: the tip is never so far behind the blade
_AGAIN = 0.010  # [m] of such ground under force, from which on it is another cut
_LOADED = 0.5  # of the force of the first time there: friction is a fifth, and no more than two fifths
_NOTHING = 0.1  # [N], or the share 0.05 of the range of force, that a sensor shows without contact
_PLACE = 1e-3  # [m] by which forces of two passages are compared
_UNLOADED = 0.25  # of the largest force, below which a record without position is without load
_LOADED_FOR = 0.3  # [s] on either side of such a pause
_PAUSE = 1.5  # [s] without force between loads, as the reading of long records parts cuts


def spoiled(trace: Trace) -> str:
    """Why no number that rests on the force would be right; "" if nothing speaks against it."""
    if trace.duration > LONGEST:
        return f"the record lasts {trace.duration:.3g} s, more than an hour; time is in seconds, and one cut a record"
    said = [flaw.message for flaw in flaws(trace) if flaw.refuse or flaw.kind == "reversed"]
    return " ".join(said).rstrip(".")


def cut_off(trace: Trace) -> str:
    """Why the last instant is not the end of the cut; "" if it is, or if the metadata say how the cut ended."""
    if trace.position is None or trace.metadata.get("end") is not None:
        return ""
    first = min(int(np.searchsorted(trace.time, trace.time[-1] - _LAST)), len(trace) - 2)
    speed = float((trace.position[-1] - trace.position[first]) / (trace.time[-1] - trace.time[first]))
    if abs(speed) < _MOVES:
        return ""
    return (
        f"the record ends while the blade moves with {1e3 * speed:.2g} mm/s: record until it stands, or say in the "
        'metadata how the cut ended (end="force_limit", say)'
    )


def two_cuts(trace: Trace) -> str:
    """Why the record holds more than one cut; "" if it does not, or if there is no position to tell by.

    A cut never heals: through the open crack the blade meets friction alone.
    """
    if trace.position is None:
        return ""
    x, F = trace.position, trace.force
    furthest = np.maximum.accumulate(x)
    forward = blade_speed(trace.time, x) > STANDSTILL
    again = forward & (x < furthest - _OPEN)
    first = forward & (x >= furthest - 1e-4)
    if not again.any() or not first.any():
        return ""
    places = np.arange(float(x.min()), float(x.max()) + _PLACE, _PLACE)
    before, after = _by_place(x, F, first, places), _by_place(x, F, again, places)
    known = np.isfinite(before) & np.isfinite(after)
    nothing = _NOTHING if trace.force_unit == "N" else 0.05 * float(np.ptp(F))
    loaded = known & (np.nan_to_num(after) > np.maximum(_LOADED * np.nan_to_num(before), nothing))
    if np.count_nonzero(loaded) * _PLACE < _AGAIN:
        return ""
    place = float(places[np.flatnonzero(loaded)[0]])
    return (
        f"the blade cuts again at {100 * place:.1f} cm, where it had cut before: two cuts in one record. Save each in "
        "a file of its own, or number their rows in a column 'cut'"
    )


def remarks(trace: Trace) -> list[str]:
    """What is worth a look, though the record can be scored."""
    said = [f"record: {flaw.message.rstrip('.')}" for flaw in flaws(trace) if not flaw.refuse]
    if trace.position is None:
        said += _remarks_on_force(trace)
    return said


def _remarks_on_force(trace: Trace) -> list[str]:
    F, time = trace.force, trace.time
    before, after = float(F[time <= time[0] + _LAST].mean()), float(F[time >= time[-1] - _LAST].mean())
    zero = min(before, after)
    level = zero + _UNLOADED * (float(F.max()) - zero)
    said = []
    if after > level:
        said.append("record: it ends under force; if it was cut off, the cut was longer than this")
    loaded = np.flatnonzero(level < F)
    if len(loaded) > 1:
        pauses = np.diff(time[loaded])
        i = int(np.argmax(pauses))
        if pauses[i] > _PAUSE and min(i + 1, len(loaded) - i - 1) >= _LOADED_FOR * trace.sample_rate:
            said.append(
                f"record: no force for {pauses[i]:.1f} s between loads; if these are two cuts, score each alone"
            )
    return said


def _by_place(x: Array, F: Array, chosen: NDArray[np.bool_], places: Array) -> Array:
    """Mean force of the chosen instants at each place, shape (n,); NaN where there is none."""
    where = np.digitize(x[chosen], places) - 1
    count = np.bincount(where, minlength=len(places))[: len(places)]
    total = np.bincount(where, weights=F[chosen], minlength=len(places))[: len(places)]
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
