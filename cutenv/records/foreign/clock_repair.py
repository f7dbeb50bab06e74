"""Times of a record as a clock printed them.

Set back, restarted, printed too coarsely, out of order, repeated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.foreign.named_columns import RowNumbers

_DAY, _HALF, _HOUR = 86_400.0, 43_200.0, 3600.0  # [s]
_LATE = 8  # readings by which one may come out of order
_MAX_REPEATED_SHARE = 0.02  # share of repeated times that are repeated readings, not a coarse clock


class ClockStretch(NamedTuple):
    """Rows of one record with strictly increasing times [s]."""

    rows: RowNumbers
    time: Array


def stretches(time: Array, rows: RowNumbers, *, of_day: bool, notes: list[str]) -> tuple[list[ClockStretch], int]:
    """Return records between clock restarts, and the number of repeated readings.

    `time` [s] is of all rows of the file, `rows` are one part of it. Dates and clock times (`of_day`) are set by
    midnight, noon and summer time.
    """
    here = time[rows]
    if of_day:
        here = _unwound(here, notes)
    order, borders = _restarts(here)
    if (order != np.arange(len(order))).any():
        notes.append(f"{np.count_nonzero(np.diff(here) < 0.0)} readings came late; they are sorted by time.")
    rows, here = rows[order], here[order]
    found, repeated = [], 0
    for part in np.split(np.arange(len(rows)), borders):
        kept, fine = _spread(here[part], notes)
        repeated += len(part) - len(kept)
        found.append(ClockStretch(rows[part][kept], fine))
    if len(found) > 1:
        notes.append(f"the clock starts again {len(found) - 1} times: a record each.")
    return found, repeated


def _unwound(time: Array, notes: list[str]) -> Array:
    """Return times of day without jumps: midnight, twelve-hour clock, summer time."""
    steps = np.diff(time)
    usual = float(np.median(np.abs(steps))) if len(steps) else 0.0
    slack = max(5.0 * usual, 0.5)
    added = np.zeros(len(time))
    for k in np.flatnonzero((steps < 0.0) | (np.abs(steps - _HOUR) < slack)).tolist():
        for jump, what in ((_DAY, "midnight"), (_HALF, "noon"), (_HOUR, "summer time"), (-_HOUR, "summer time")):
            if abs(steps[k] + jump) < slack:
                added[k + 1 :] += jump
                notes.append(f"the clock jumps by {-jump / _HOUR:g} h ({what}); the jump is taken out.")
                break
    return np.asarray(time + added)


def _restarts(time: Array) -> tuple[RowNumbers, list[int]]:
    """Return rows in measured order, and the clock's restarts in it."""
    falls = np.flatnonzero(np.diff(time) < 0.0)
    order = np.arange(len(time))
    borders: list[int] = []
    ahead = np.maximum.accumulate(time)
    for k in falls.tolist():
        if time[k] < ahead[k] and not (borders and borders[-1] > k - _LATE):
            continue
        begin = borders[-1] if borders else 0
        highest = float(time[begin : k + 1].max())
        behind = time[k + 1 : k + 1 + _LATE]
        if (behind > highest).any() and (np.diff(np.sort(behind)) > 0.0).all():
            continue
        borders.append(k + 1)
        ahead[k + 1 :] = np.maximum.accumulate(time[k + 1 :])
    for part in np.split(np.arange(len(time)), borders):
        order[part] = part[np.argsort(time[part], kind="stable")]
    return order, borders


def _spread(time: Array, notes: list[str]) -> tuple[RowNumbers, Array]:
    """Return kept readings and increasing times, repeats of coarse clocks spread."""
    every = np.arange(len(time))
    same = np.diff(time) <= 0.0
    if not same.any():
        return every, time
    first = np.concatenate(([True], ~same))
    starts = np.flatnonzero(first)
    n_repeated = np.count_nonzero(~first)
    before_trigger = len(starts) > 1 and n_repeated == starts[1] - 1  # the first time alone repeats
    if n_repeated <= max(_MAX_REPEATED_SHARE * len(time), 1) or len(starts) < 3 or before_trigger:
        return starts, time[starts]
    counts = np.diff(np.append(starts, len(time)))
    ticks = time[starts]
    # Between the first ticks and the last: the last one may be cut off, the first may have begun before the record.
    step = (ticks[-1] - ticks[0]) / (starts[-1] - starts[0])
    even = ticks[0] + step * every
    if np.abs(even[starts] - ticks).max() <= float(np.median(np.diff(ticks))) * 1.01:
        notes.append(
            f"times are printed in steps of {np.median(np.diff(ticks)):.3g} s; {1.0 / step:.4g} readings a second."
        )
        return every, even
    ends = np.append(ticks[1:], ticks[-1] + step * counts[-1])
    fine = np.repeat(ticks, counts) + (every - np.repeat(starts, counts)) * np.repeat((ends - ticks) / counts, counts)
    notes.append(f"times are printed in steps of {np.median(np.diff(ticks)):.3g} s; readings between them are spread.")
    return every, fine
