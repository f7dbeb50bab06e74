"""Notes on a score card: what its numbers rest on, and what is doubtful."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np

from cutenv.measurement.depth import depth_sd
from cutenv.scoring.metric import FORCE_WEIGHTS
from cutenv.scoring.points import ScorePoints
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.truth import ASIDE_AT_END, FLOOR_AT_END
from cutenv.scoring.unavailable import Unavailable
from cutenv.scoring.validity import validity_warnings

DOUBT = "doubtful"
"""First word of a note on a record that can hardly be true."""
EXPECTED_FLOOR = (
    "floor of the cut: that of mean tissue under a blade that moved so, by an assumed edge; the surface as recorded"
)
"""Note on a record whose floor is not known but expected."""
EXPECTED_CUT = "cut beside the line: that of mean tissue behind a blade that moved so, by the estimated tip"
"""Note on a record whose cut is not known but expected."""
_SAME_DEPTH = 1e-6  # [m]
_LONG = 0.03  # [m], advance over which a real depth changes


def score_notes(cut: ScoredCut, points: Sequence[ScorePoints], outcome: str) -> list[str]:
    """Return what a card rests on: where tip, floor and cut are from, what is not counted, what is doubtful."""
    notes = [
        {
            "truth": "tip: the simulator's own",
            "return stroke": "tip: from the return stroke, after which it is known to about 0.3 mm; estimated before",
            "estimated": "tip: estimated, by the cut's own loading; median error 1 to 2 mm, one in ten above 5 mm",
            "guessed": "tip: estimated with the stiffness of mean tissue; median error 2 mm, one in twenty above 7 mm",
            "unknown": "tip: unknown; force alone is judged",
        }["guessed" if cut.tip_source == "estimated" and cut.own_modulus is None else cut.tip_source]
    ]
    if cut.truth is None and cut.noted_end is not None:
        notes.append("where the tip ended is the simulator's own")
    if cut.trace.height is not None and cut.trace.depth is not None:
        known = FLOOR_AT_END in cut.trace.metadata or (cut.truth is not None and cut.truth.floor is not None)
        notes.append("floor of the cut: the simulator's own" if known else EXPECTED_FLOOR)
    if cut.line is not None and _is_known(cut):
        known = ASIDE_AT_END in cut.trace.metadata or (cut.truth is not None and cut.truth.aside is not None)
        notes.append("cut beside the line: the simulator's own" if known else EXPECTED_CUT)
    if not points:
        notes.append("metrics, and no claim of skill")
    counted = {each.part for each in points}
    left = [] if outcome or not points else sorted(set(FORCE_WEIGHTS) - counted)
    if left:
        notes.append(f"not counted, without a value or a reference: {', '.join(left)}")
    sd = depth_sd(cut.trace)
    if sd is not None:
        notes.append(f"record: depth of cut measured to {1e3 * sd:.2f} mm (standard deviation)")
    return notes + validity_warnings(cut.trace, cut.quality)


def doubted_depth(cut: ScoredCut) -> list[str]:
    """Return a note if the depth never changes along a real cut: tissue is not so even, so nobody measured it."""
    depth, position = cut.trace.depth, cut.trace.position
    simulated = (
        cut.truth is not None or cut.noted_end is not None or cut.trace.metadata.get("specimen_class") == "uniform"
    )
    if depth is None or position is None or simulated:
        return []
    advance = float(np.ptp(position))
    if advance < _LONG or np.ptp(depth) > _SAME_DEPTH:
        return []
    return [
        f"{DOUBT}: the depth of cut is {1e3 * float(depth[0]):.4g} mm at every reading of {100.0 * advance:.1f} cm. "
        "Soft tissue bulges and is never so even: it was set, not measured, and tip, runs and points rest on it. "
        "Give the depth along the cut: by caliper at some places, or from film (cutenv depth)"
    ]


def _is_known(cut: ScoredCut) -> bool:
    """Return True if the cut beside the line is known or expected."""
    with contextlib.suppress(Unavailable):
        return len(cut.path_map.aside) > 0
    return False
