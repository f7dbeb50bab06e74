"""Lurches of a blade where the force falls suddenly, and what they tell about a record's position and clock."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.scoring.validity import RATE, even_instants
from cutenv.trace import Trace

LURCH_SPEED = 0.02
"""Speed beyond the usual that a blade on a drive never has where the force falls suddenly, and in a hand has [m/s]."""
_SUDDEN, _SUDDEN_SHARE = 0.1, 0.1  # [N], and share of the range, by which a force falls within 20 ms
_BEFORE, _AFTER, _AFTERWARDS = 5, 20, 40  # samples at 100 Hz around such a fall: of the lurch, and until it is over
_EARLIER = 30  # samples at 100 Hz before it, of which those up to 10 before are without a lurch
_WAY = 0.8e-3  # [m] of a lurch
_SHARPEST_SMOOTHED = 10.0  # [1/s], sharpness of lurches below which they are no hand's: honest ones have 17 and more
_FINE = 1000  # samples a second at which a lurch is looked at closely
_FALL, _SPEED = 4, 5  # such samples over which the force falls, and over which the largest speed is taken
_USUAL, _STARTS, _LASTS = 150, 50, 200  # such samples: from when to when before the fall it is usual; of a lurch
_FEWEST = 3  # lurches by whose median it is told what comes first
QUICKNESS = 1.67
"""Largest speed of a lurch over the root of fall and way [1/kg^0.5], of a hand as ``cutenv play`` has it, median."""


class Lurches(NamedTuple):
    """Motion of a blade where the force falls suddenly: in a hand it lurches there, on a stiff drive it does not."""

    drops: int
    """Sudden falls of the force."""
    top: float
    """Largest speed after them, less that around them [m/s]."""
    sharpness: float | None
    """Largest speed of a lurch over its way [1/s], mean of all by their ways; None without any of 0.8 mm."""
    slowness: float | None
    """Factor by which a hand's blade follows the falls of the force more quickly; None without a lurch.

    What a fall of the force does over the way of a lurch moves the mass of hand and blade, whatever the tissue: by
    a clock at twice its speed the mass seems to be four times as large.
    """
    early: float | None
    """Share of a lurch that comes before the fall of the force that causes it, median; None of fewer than three."""


def lurches_of(trace: Trace, position: Array, even: Array) -> Lurches:
    """Return how a blade moves where the force falls suddenly.

    Parameters
    ----------
    trace : Trace
        The record, with position.
    position, even : array of shape (m,)
        Position of the blade [m] and means of the force over 10 ms [N], both at 100 Hz.
    """
    speed = RATE * np.diff(position, append=position[-1])
    fall = np.zeros(len(even))
    fall[1:-1] = even[:-2] - even[2:]
    sudden = np.flatnonzero(fall > max(_SUDDEN, _SUDDEN_SHARE * float(np.ptp(even))))
    drops, top, ways, peaks, falls = 0, 0.0, [], [], []
    for group in np.split(sudden, np.flatnonzero(np.diff(sudden) > _BEFORE - 1) + 1) if len(sudden) else ():
        t = int(group[np.argmax(fall[group])])
        if t < _EARLIER or t + _AFTERWARDS >= len(even):
            continue
        quiet = speed[t - _EARLIER : t - 2 * _BEFORE], speed[t + _AFTER + _BEFORE : t + _AFTERWARDS]
        usual = max(0.0, *(float(np.median(each)) for each in quiet))
        way = float(position[t + _AFTER] - position[t - _BEFORE]) - (_BEFORE + _AFTER) / RATE * usual
        peak = float(speed[t - _BEFORE : t + _AFTER].max()) - usual
        drops, top = drops + 1, max(top, peak)
        falls.append((t + 0.5) / RATE)
        if way > _WAY:
            ways.append(way)
            peaks.append(peak)
    sharpness = float(np.dot(peaks, ways) / np.dot(ways, ways)) if ways else None
    close = np.array(list(_closely(trace, falls))).reshape(-1, 3)
    if not len(close):
        return Lurches(drops, top, sharpness, None, None)
    slowness = QUICKNESS / float(np.average(close[:, 0], weights=close[:, 2]))
    early = float(np.median(close[:, 1])) if len(close) >= _FEWEST else None
    return Lurches(drops, top, sharpness, slowness, early)


def _closely(trace: Trace, falls: list[float]) -> Iterator[tuple[float, float, float]]:
    """Yield quickness [1/kg^0.5], share before the fall and way [m] of lurches near ``falls`` [s after the start]."""
    assert trace.position is not None
    instants = even_instants(trace.time, _FINE)
    x, F = (np.interp(instants, trace.time, each) for each in (trace.position, trace.force))
    drop = F - np.append(F[_FALL:], np.full(_FALL, F[-1]))
    for fall in falls:
        near = round(_FINE * fall)
        start = near - 30 + int(np.argmax(drop[near - 30 : near + 30]))
        if start + _LASTS + _STARTS >= len(x):
            continue
        usual = max(float(x[start - _STARTS] - x[start - _USUAL]) * _FINE / (_USUAL - _STARTS), 0.0)
        way = float(x[start + _LASTS] - x[start]) - usual * _LASTS / _FINE
        if way < _WAY:
            continue
        lurch = x[start - _STARTS : start + _LASTS + _STARTS]
        speed = float((lurch[_SPEED:] - lurch[:-_SPEED]).max()) * _FINE / _SPEED - usual
        fallen = float(F[start - 9 : start + 1].mean() - F[start + _FALL : start + _FALL + 20].min())
        early = float(x[start] - x[start - _STARTS]) - usual * _STARTS / _FINE
        yield speed / float(np.sqrt(max(fallen, 1e-3) * way)), early / way, way


def smoothed_motion(lurches: Lurches) -> str:
    """Return the reason why position or clock cannot be a hand's, by its lurches; "" if they can."""
    sharp = lurches.sharpness
    if sharp is None or sharp >= _SHARPEST_SMOOTHED or lurches.top < LURCH_SPEED:
        return ""
    return (
        f"where the force falls suddenly the blade takes some {1e3 / sharp:.0f} ms for a lurch, and a hand less than "
        f"{1e3 / _SHARPEST_SMOOTHED:.0f}: the position was smoothed, or the clock runs fast. Record both as they are"
    )
