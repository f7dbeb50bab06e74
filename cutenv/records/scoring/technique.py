"""Sentences about measured faults of a cut, with position and advice."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutenv.records.scoring.cut_metrics import HASTE_RATE, moving_between
from cutenv.records.scoring.scored_cut import RUNS_EVERY, ScoredCut
from cutenv.records.scoring.validity import Unavailable, even_instants
from cutenv.sim.quantities import (
    ANGLE_TOLERANCE,
    CLOSE,
    DECELERATION,
    FORCE_LIMIT_PER_DEPTH,
    TIP_TOLERANCE,
    force_per_depth,
)

LURCH = TIP_TOLERANCE  # smallest run of the crack that is reported [m]
HASTY = math.sqrt(2.0 * DECELERATION * CLOSE)
"""Speed of the blade from which on it is reported [m/s]: it needs all the length near a target to stop."""
HOLD_BACK = "press less before the tissue gives way, and hold the blade firmly: then it does not shoot forward"
"""Advice for a blade that was too fast."""
EASE_OFF = "ease off where the tissue resists more, and lean the blade there instead of pressing"
"""Advice for one who pressed too much."""
SLOW_DOWN = "go slowly over the last centimetre, and ease off as the tissue parts: it tears on a little ahead of you"
"""Advice for one who cut too far."""
KEEP_DEPTH = "hold the blade at the wanted depth before the cut gets there, and go slowly where it changes"
"""Advice for a cut of another depth than the wanted one."""
LEAD_OUTSIDE = (
    "lead the blade a little outside of a bend, and go slowly there: the cut trails the blade, and cuts corners"
)
"""Advice for a cut beside its line."""
_MAX_REPORTED = 3  # number of lurches that are reported
_PAUSE = 0.5  # [s], shortest pause that is reported


@dataclass(frozen=True, kw_only=True)
class TechniqueFault:
    """One fault of a cut.

    Attributes
    ----------
    kind : str
        "lurch", "haste", "force", "overshoot", "short", "layer", "line", "wedge" or "pause".
    """

    kind: str
    time: float
    position: float | None
    says: str
    try_next: str


def technique_faults(cut: ScoredCut) -> list[TechniqueFault]:
    """Find a cut's visible technique faults, in order of time."""
    found: list[TechniqueFault] = []
    for look in (_lurches, _haste, _force, _end, _stop, _wedge, _pauses):
        try:
            found += look(cut)
        except Unavailable:
            continue
    return sorted(found, key=lambda fault: fault.time)


def _lurches(cut: ScoredCut) -> list[TechniqueFault]:
    jumps = cut.jumps
    n = len(jumps)
    times = cut.time if n == len(cut.time) else float(cut.time[0]) + RUNS_EVERY * np.arange(n)
    worst = [int(i) for i in np.argsort(jumps)[::-1][:_MAX_REPORTED] if jumps[i] >= LURCH]
    positions = np.interp(times, cut.time, cut.position)
    return [
        TechniqueFault(
            kind="lurch",
            time=float(times[i]),
            position=float(positions[i]),
            says=f"the tissue tore on by {1e3 * jumps[i]:.0f} mm {_where(cut, times[i], positions[i])}",
            try_next="lean the blade more as you advance: a slicing edge cuts with less force, and the tissue tears on "
            "less far",
        )
        for i in worst
    ]


def _haste(cut: ScoredCut) -> list[TechniqueFault]:
    even = even_instants(cut.time, HASTE_RATE)
    places = np.interp(even, cut.time, cut.position)
    speed = np.diff(places) * HASTE_RATE
    if not len(speed) or float(speed.max()) < HASTY:
        return []
    i = int(np.argmax(speed))
    return [
        TechniqueFault(
            kind="haste",
            time=float(even[i]),
            position=float(places[i]),
            says=f"the blade shot forward at {100.0 * speed[i]:.0f} cm/s {_where(cut, even[i], places[i])}, too fast "
            f"to stop within {1e3 * CLOSE:.0f} mm",
            try_next=HOLD_BACK,
        )
    ]


def _force(cut: ScoredCut) -> list[TechniqueFault]:
    depth = cut.depth
    per_depth = force_per_depth(cut.newtons, depth)
    i = int(np.argmax(per_depth))
    if per_depth[i] <= FORCE_LIMIT_PER_DEPTH or _told_end(cut) == "force_limit":
        return []
    says = (
        f"pressed with {cut.newtons[i]:.1f} N {_where(cut, *_instant(cut, i))}: "
        f"a cut {1e3 * depth[i]:.0f} mm deep allows {FORCE_LIMIT_PER_DEPTH * depth[i]:.1f} N"
    )
    return [_seen(cut, "force", i, says, EASE_OFF)]


def _end(cut: ScoredCut) -> list[TechniqueFault]:
    if _told_end(cut) in ("overshoot", "deadline", "given up"):  # told as a stop
        return []
    off = float(cut.tip[cut.end]) - cut.length
    beyond = float(cut.tip.max()) - cut.length
    farthest = int(np.argmax(cut.position))  # the end of the cut; any retreat comes after it
    if beyond > TIP_TOLERANCE:
        says = f"cut {1e3 * beyond:.0f} mm too far"
        return [_seen(cut, "overshoot", farthest, says, SLOW_DOWN)]
    if off < -TIP_TOLERANCE:
        says = f"ended {-1e3 * off:.0f} mm short of the target"
        cure = "lead the blade farther: the tissue stretches, and while you feel a pull the cut ends behind the blade"
        return [_seen(cut, "short", farthest, says, cure)]
    return []


_STOPS = {
    "force_limit": ("force", "stopped for too much force", EASE_OFF),
    "overshoot": ("overshoot", "stopped for a cut too far beyond the target", SLOW_DOWN),
    "deadline": (
        "short",
        "stopped when the time was up",
        "advance faster where the tissue hardly resists, and do not rest",
    ),
    "given up": ("short", "given up", "go on slowly as far as the target: a cut that is given up counts as missed"),
    "layer": ("layer", "stopped because the layer below was opened", KEEP_DEPTH),
    "off_line": ("line", "stopped because the cut was too far from the line", LEAD_OUTSIDE),
}
"""Kind of fault, what happened, and advice, by the way in which a cut ended before it was finished."""


def _stop(cut: ScoredCut) -> list[TechniqueFault]:
    told = _STOPS.get(_told_end(cut))
    if told is None:
        return []
    kind, happened, advice = told
    return [_seen(cut, kind, -1, f"{happened}, {_where(cut, *_instant(cut, -1))}{_rest_of(cut)}", advice)]


def _rest_of(cut: ScoredCut) -> str:
    """Return in words how much was left or overcut, or ""."""
    try:
        off = 1e3 * (float(cut.tip[cut.end]) - cut.length)
    except Unavailable:
        return ""
    if abs(off) <= 1e3 * TIP_TOLERANCE:
        return ""
    return f": {abs(off):.0f} mm {'before' if off < 0.0 else 'beyond'} the target"


def _told_end(cut: ScoredCut) -> str:
    return str(cut.trace.metadata.get("end", ""))


def _seen(cut: ScoredCut, kind: str, i: int, says: str, try_next: str) -> TechniqueFault:
    """Return a fault at a reading."""
    time, position = _instant(cut, i)
    return TechniqueFault(kind=kind, time=time, position=position, says=says, try_next=try_next)


def _instant(cut: ScoredCut, i: int) -> tuple[float, float | None]:
    """Return time [s] and position [m] of a reading."""
    return float(cut.time[i]), None if cut.trace.position is None else float(cut.position[i])


def _where(cut: ScoredCut, time: float, position: float | None) -> str:
    """Return place and time in words, from the record's start."""
    place = "" if position is None else f"at {100.0 * position:.1f} cm, "
    return f"{place}after {time - float(cut.time[0]):.1f} s"


def _wedge(cut: ScoredCut) -> list[TechniqueFault]:
    angle = float(cut.angle[cut.end])
    if abs(0.5 * math.pi - angle) <= ANGLE_TOLERANCE:
        return []
    says = f"ended with the blade at {math.degrees(angle):.0f} degrees: a wedge of tissue stays uncut"
    return [_seen(cut, "wedge", -1, says, "set the blade upright before you stop")]


def _pauses(cut: ScoredCut) -> list[TechniqueFault]:
    first, last, moving = moving_between(cut)
    stands = ~moving[first : last + 1]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], stands.astype(int), [0])))) + first
    found = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        length = float(cut.time[min(stop, last)] - cut.time[start])
        if length >= _PAUSE and float(cut.position[start]) < float(cut.position.max()) - 1e-3:
            cure = "keep going, slowly and evenly: each new start stretches the tissue again"
            says = f"rested for {length:.1f} s {_where(cut, *_instant(cut, start))}"
            found.append(_seen(cut, "pause", start, says, cure))
    return found
