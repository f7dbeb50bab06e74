"""Doubts about a record.

What it claims and does not show, or what can hardly be true: each doubt is a note on the card.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from cutenv.records.measurement.strokes import END_SPEED, END_WINDOW
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.validity import LURCH_SPEED, Lurches, Unavailable
from cutenv.sim.quantities import TIP_TOLERANCE, tip_error

DOUBT = "doubtful"  # first word of a note on a record that can hardly be true
_SAME_DEPTH = 1e-6  # [m]
_LONG = 0.03  # [m], advance over which a real depth changes
_STILL = 0.03  # [m/s], top speed after sudden falls of the force that one hand in 100 is below
_SLOW, _SLOW_FROM = 1.2, 90.0  # slowness of lurches above nearly every hand's, if read so often [Hz]
_EARLY, _EARLY_FROM = 0.2, 190.0  # share of them before the fall of the force, likewise
_SAME_TIP = 1.5e-3  # [m] within which the return stroke shows where the tip is
_ZERO, _ZERO_SHARE = 0.2, 0.08  # [N], and share of the range, that a force may have where nothing is touched
_DRAWN_BACK, _UNLOADED = 1e-3, 0.4  # [m] from the farthest place, and share of the peak, in which a finished cut ends


def doubts_of(cut: ScoredCut) -> list[str]:
    """Return notes on doubtful or unproven facts in a record.

    They change no points. Of a cut whose hidden state is given, nothing is doubted.
    """
    if cut.truth is not None or cut.twofold:
        return []
    said = []
    for doubt in (_depth, _motion, _end, _tip, _zero):
        said += list(_available(doubt, cut))
    return [f"{DOUBT}: {each}" for each in said]


def _available(doubt: Callable[[ScoredCut], Iterator[str]], cut: ScoredCut) -> Iterator[str]:
    try:
        yield from doubt(cut)
    except Unavailable:
        return


def _depth(cut: ScoredCut) -> Iterator[str]:
    """Doubt a depth that is constant along a real cut."""
    depth, position = cut.trace.depth, cut.trace.position
    simulated = cut.noted_end is not None or cut.trace.metadata.get("specimen_class") == "uniform"
    if depth is None or position is None or simulated:
        return
    advance = float(np.ptp(position))
    if advance < _LONG or np.ptp(depth) > _SAME_DEPTH:
        return
    yield (
        f"the depth of cut is {1e3 * float(depth[0]):.4g} mm at every reading of {100.0 * advance:.1f} cm. "
        "Soft tissue bulges and is never so even: it was set, not measured, and tip, runs and points rest on it. "
        "Give the depth along the cut: by caliper at some places, or from film (cutenv depth)"
    )


def _motion(cut: ScoredCut) -> Iterator[str]:
    """Doubt position or clock when lurches are slow, early or missing."""
    found, rate = cut.lurches, cut.trace.sample_rate
    if rate <= _SLOW_FROM:
        return
    by_hand = bool(cut.trace.metadata.get("operator"))
    lurches = by_hand or found.top > LURCH_SPEED
    if lurches and rate > _EARLY_FROM and found.early is not None and found.early > _EARLY:
        yield (
            f"{found.early:.0%} of a lurch comes before the fall of the force that causes it, as no hand does it: its "
            "position was smoothed, and the blade was faster than it seems"
        )
    elif lurches and found.slowness is not None and found.slowness > _SLOW:
        yield (
            f"the blade follows sudden falls of the force {found.slowness:.1f} times as slowly as a hand does: if its "
            "position was smoothed, or the clock runs fast, it was faster than it seems"
        )
    elif by_hand and found.drops and found.top < _STILL:
        yield (
            f"the blade hardly lurches at {_falls(found)} of the force, as it does in a person's hand: if no machine "
            "held it, its position was smoothed, and how fast it was is not known"
        )


def taken_for_a_drive(cut: ScoredCut) -> str:
    """Return a note on an anonymous record without human motion, or ""."""
    if cut.truth is not None or cut.twofold or cut.trace.metadata.get("operator"):
        return ""
    try:
        found = cut.lurches
    except Unavailable:
        return ""
    if not found.drops or found.top >= _STILL:
        return ""
    return (
        f"nobody is named, so the blade is taken to be on a drive: in a hand it would lurch at {_falls(found)} of the "
        "force; name the person by a code (operator) for a hand's score"
    )


def _falls(found: Lurches) -> str:
    return f"{found.drops} sudden fall{'s' * (found.drops > 1)}"


def _end(cut: ScoredCut) -> Iterator[str]:
    """Doubt a cut that is noted as finished without evidence."""
    if cut.trace.metadata.get("end") != "finished":
        return
    x, F = cut.position, cut.newtons
    last = cut.time >= cut.time[-1] - END_WINDOW
    left = float(x.max() - x[-1]) < _DRAWN_BACK and float(np.ptp(x[last])) > END_SPEED * END_WINDOW
    if left or float(F[last].mean()) > max(_ZERO, _UNLOADED * float(F.max())):
        yield "the cut is noted as finished, and the record ends before the blade rests or is drawn back, without load"


def _tip(cut: ScoredCut) -> Iterator[str]:
    """Doubt a noted tip that the return stroke contradicts."""
    noted, ended = cut.noted_end, cut.trace.metadata.get("end", "finished") == "finished"
    if noted is None or not ended or cut.tip_source != "return stroke" or tip_error(noted, cut.length) > TIP_TOLERANCE:
        return
    shown = cut.shown_end
    if tip_error(shown, cut.length) > TIP_TOLERANCE and abs(shown - noted) > _SAME_TIP:
        yield (
            f"the tip is noted at {1e3 * noted:.0f} mm, near the target; the force of the return stroke shows it at "
            f"{1e3 * shown:.0f} mm, where the target is missed"
        )


def _zero(cut: ScoredCut) -> Iterator[str]:
    """Doubt the zero of a force nonzero at the start."""
    F = cut.newtons
    _ = cut.position  # a record of force alone is not scored by newtons
    first = float(F[cut.time <= cut.time[0] + END_WINDOW].mean())
    if abs(first) > max(_ZERO, _ZERO_SHARE * float(np.ptp(F))):
        yield (
            f"the force is {first:.2g} N at the start, before anything is touched: all forces are off by as much. Set "
            "the sensor to zero before the cut, and start the record before the blade touches"
        )
