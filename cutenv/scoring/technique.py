"""Feedback on technique: sentences about measured faults of a cut, with position and advice."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutenv.scoring.cut_metrics import HASTE_RATE, moving_between
from cutenv.scoring.scored_cut import RUNS_EVERY, ScoredCut
from cutenv.scoring.validity import Unavailable, even_instants
from cutenv.task_quantities import (
    ANGLE_TOLERANCE,
    CLOSE,
    DECELERATION,
    FORCE_LIMIT_PER_DEPTH,
    TIP_TOLERANCE,
    force_per_depth,
)

LURCH = TIP_TOLERANCE
"""Smallest run of the crack that is reported [m]."""
HASTY = math.sqrt(2.0 * DECELERATION * CLOSE)
"""Speed of the blade from which on it is reported [m/s]: it needs all the length near a target to stop."""
HOLD_BACK = "press less before the tissue gives way, and hold the blade firmly: then it does not shoot forward"
"""Advice for a blade that was too fast."""
_MOST = 3  # number of lurches that are reported
_PAUSE = 0.5  # [s], shortest pause that is reported


@dataclass(frozen=True, kw_only=True)
class TechniqueFault:
    """One fault of a cut.

    Attributes
    ----------
    kind : str
        "lurch", "haste", "force", "overshoot", "short", "wedge", "pause" or "reversal".
    time : float
        Time of the fault [s].
    position : float or None
        Position of the blade [m].
    says : str
        Description of the fault.
    try_next : str
        Advice for the next cut.
    """

    kind: str
    time: float
    position: float | None
    says: str
    try_next: str


def technique_faults(cut: ScoredCut) -> list[TechniqueFault]:
    """Find the faults of a cut, in order of time; those that the record cannot show are left out."""
    found: list[TechniqueFault] = []
    for look in (_lurches, _haste, _force, _end, _wedge, _pauses):
        try:
            found += look(cut)
        except Unavailable:
            continue
    return sorted(found, key=lambda fault: fault.time)


def _lurches(cut: ScoredCut) -> list[TechniqueFault]:
    jumps = cut.jumps
    n = len(jumps)
    times = cut.time if n == len(cut.time) else float(cut.time[0]) + RUNS_EVERY * np.arange(n)
    worst = [int(i) for i in np.argsort(jumps)[::-1][:_MOST] if jumps[i] >= LURCH]
    positions = np.interp(times, cut.time, cut.position)
    return [
        TechniqueFault(
            kind="lurch",
            time=float(times[i]),
            position=float(positions[i]),
            says=f"lurched {1e3 * jumps[i]:.0f} mm at {100 * positions[i]:.1f} cm",
            try_next="lean the blade more while you advance: an inclined edge starts the crack at less force, and it "
            "runs less far",
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
    where = f"{100.0 * speed[i]:.0f} cm/s at {100.0 * places[i]:.1f} cm"
    return [
        TechniqueFault(
            kind="haste",
            time=float(even[i]),
            position=float(places[i]),
            says=f"the blade moved at {where}, too fast to stop within {1e3 * CLOSE:.0f} mm",
            try_next=HOLD_BACK,
        )
    ]


def _force(cut: ScoredCut) -> list[TechniqueFault]:
    per_depth = force_per_depth(cut.newtons, cut.depth)
    i = int(np.argmax(per_depth))
    if per_depth[i] <= FORCE_LIMIT_PER_DEPTH:
        return []
    place = "" if cut.trace.position is None else f" at {100 * cut.position[i]:.1f} cm"
    return [
        TechniqueFault(
            kind="force",
            time=float(cut.time[i]),
            position=None if cut.trace.position is None else float(cut.position[i]),
            says=f"pressed with {per_depth[i]:.0f} N per metre of depth{place}, more than {FORCE_LIMIT_PER_DEPTH:.0f}",
            try_next="slow down where the force climbs, and lean the blade",
        )
    ]


def _end(cut: ScoredCut) -> list[TechniqueFault]:
    off = float(cut.tip[cut.end]) - cut.length
    beyond = float(cut.tip.max()) - cut.length
    farthest = int(np.argmax(cut.position))  # the end of the cut; any retreat comes after it
    at = float(cut.time[farthest]), float(cut.position[farthest])
    if beyond > TIP_TOLERANCE:
        says, cure = f"cut {1e3 * beyond:.0f} mm too far", "slow down earlier: the last run carries the tip on"
        return [TechniqueFault(kind="overshoot", time=at[0], position=at[1], says=says, try_next=cure)]
    if off < -TIP_TOLERANCE:
        says = f"ended {-1e3 * off:.0f} mm short of the target"
        cure = "lead the blade farther: the tip is behind it by as much as the force pulls"
        return [TechniqueFault(kind="short", time=at[0], position=at[1], says=says, try_next=cure)]
    return []


def _wedge(cut: ScoredCut) -> list[TechniqueFault]:
    angle = float(cut.angle[cut.end])
    if abs(0.5 * math.pi - angle) <= ANGLE_TOLERANCE:
        return []
    return [
        TechniqueFault(
            kind="wedge",
            time=float(cut.time[-1]),
            position=None if cut.trace.position is None else float(cut.position[-1]),
            says=f"ended with the blade at {math.degrees(angle):.0f} degrees: a wedge stays uncut",
            try_next="turn the blade upright before the end",
        )
    ]


def _pauses(cut: ScoredCut) -> list[TechniqueFault]:
    first, last, moving = moving_between(cut)
    stands = ~moving[first : last + 1]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], stands.astype(int), [0])))) + first
    found = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        length = float(cut.time[min(stop, last)] - cut.time[start])
        if length >= _PAUSE and float(cut.position[start]) < float(cut.position.max()) - 1e-3:
            found.append(
                TechniqueFault(
                    kind="pause",
                    time=float(cut.time[start]),
                    position=float(cut.position[start]),
                    says=f"stood for {length:.1f} s at {100 * cut.position[start]:.1f} cm",
                    try_next="keep a slow, even feed: a blade that starts again loads the tissue again",
                )
            )
    return found
