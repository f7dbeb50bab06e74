"""Validity of a record for scoring: unusable force, a truncated cut, two cuts in one record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.measurement import QualityIssue
from cutenv.measurement.strokes import END_SPEED, END_WINDOW, STANDSTILL_SPEED
from cutenv.trace import Trace

LONGEST_RECORD = 3600.0
"""Longest record that is scored [s]."""
_OPEN = 0.015  # [m] behind the furthest point the crack is open: the tip never lags the blade by that much
_AGAIN = 0.010  # [m] of open crack crossed under force that count as another cut
_LOADED = 0.5  # fraction of the force at the first passage: friction is a fifth, and at most two fifths
_NOTHING = 0.1  # [N], or 0.05 of the range of force: reading of a sensor without contact
_PLACE = 1e-3  # [m], bin width for comparing the forces of two passages
_UNLOADED = 0.25  # fraction of the largest force below which a record without position counts as unloaded
_LOADED_FOR = 0.3  # [s] of load on either side of such a pause
_PAUSE = 1.5  # [s] without force between loads, the same as for dividing long records into cuts


def force_unusable(trace: Trace, quality: Sequence[QualityIssue]) -> str:
    """Return the reason why the force is unusable, among them issues of quality; "" if there is none."""
    if trace.duration > LONGEST_RECORD:
        return f"the record lasts {trace.duration:.3g} s, more than an hour; time is in seconds, and one cut a record"
    said = [flaw.message for flaw in quality if flaw.refuse or flaw.kind == "reversed"]
    return " ".join(said).rstrip(".")


def is_truncated(trace: Trace) -> str:
    """Return the reason why the record is truncated; "" if it is not, or if the metadata name the cut's end."""
    if trace.position is None or trace.metadata.get("end") is not None:
        return ""
    first = min(int(np.searchsorted(trace.time, trace.time[-1] - END_WINDOW)), len(trace) - 2)
    speed = float((trace.position[-1] - trace.position[first]) / (trace.time[-1] - trace.time[first]))
    if abs(speed) < END_SPEED:
        return ""
    return (
        f"the record ends while the blade moves at {1e3 * speed:.2g} mm/s: record until it stands; or, if the cut was "
        'complete, write so in the metadata of a file of cutenv\'s own format: end="finished"'
    )


def holds_two_cuts(trace: Trace) -> str:
    """Return the reason why the record holds more than one cut; "" if it does not, or if there is no position.

    A cut never heals: in the open crack the blade meets only friction.
    """
    if trace.position is None:
        return ""
    x, F = trace.position, trace.force
    furthest = np.maximum.accumulate(x)
    forward = trace.blade_speed > STANDSTILL_SPEED
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


def validity_warnings(trace: Trace, quality: Sequence[QualityIssue]) -> list[str]:
    """Return warnings about a record that can be scored, among them issues of quality."""
    said = [f"record: {flaw.message.rstrip('.')}" for flaw in quality if not flaw.refuse]
    if trace.position is None:
        said += _remarks_on_force(trace)
    return said


def _remarks_on_force(trace: Trace) -> list[str]:
    F, time = trace.force, trace.time
    before, after = float(F[time <= time[0] + END_WINDOW].mean()), float(F[time >= time[-1] - END_WINDOW].mean())
    zero = min(before, after)
    level = zero + _UNLOADED * (float(F.max()) - zero)
    said = []
    if after > level:
        said.append("record: it ends under force; if it was truncated, the cut was longer than this")
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
    """Return the mean force of the chosen instants in each bin of position, shape (n,); NaN where there is none."""
    where = np.digitize(x[chosen], places) - 1
    count = np.bincount(where, minlength=len(places))[: len(places)]
    total = np.bincount(where, weights=F[chosen], minlength=len(places))[: len(places)]
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
