"""Advice on what a person can try next: the parts of the score that cost most lately, each with advice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cutenv.scoring.score_card import ScoreCard
from cutenv.scoring.technique import HOLD_BACK, KEEP_DEPTH, LEAD_OUTSIDE

RECENT = 3
"""Number of last cuts by which advice is given."""
_MOST = 3  # pieces of advice
_LITTLE = 0.1  # fraction of a part's points whose loss needs no advice
_CAUSES = {
    "target": (("limits", "way", "accuracy", "success"), ("short", "overshoot", "wedge", "force")),
    "control": (("control",), ("haste",)),
    "tissue": (("tissue",), ("lurch", "force")),
    "time": (("time",), ("pause",)),
    "depth": (("depth",), ("layer",)),
    "path": (("path",), ("line",)),
}
"""Parts of the score that go together, and the kinds of faults that cost their points."""
_ADVICE = {
    "target": "at the target, set the blade upright and draw back until nothing pulls: while you feel a pull, the cut "
    "ends behind the blade",
    "control": HOLD_BACK,
    "tissue": "advance more slowly and lean the blade: it presses less, and the tissue tears on less far",
    "time": "advance faster where the tissue hardly resists, and do not rest",
    "depth": KEEP_DEPTH,
    "path": LEAD_OUTSIDE,
}
_STEADY = "keep the pull steady: advance evenly, without jerks"
"""Advice for a record of force alone, whose parts are metrics of steadiness."""


@dataclass(frozen=True, kw_only=True)
class NextTry:
    """One thing to try next.

    Attributes
    ----------
    part : str
        Part of the overall score that costs points, or "target" for those that the target gives.
    points, most : float
        Mean points of the last cuts, and points of the best cut.
    seen : str
        What was seen, in the last cut with that fault; "" if no single fault explains the loss.
    cuts : int
        Number of the last cuts in which it was seen.
    advice : str
        What to try.
    """

    part: str
    points: float
    most: float
    seen: str
    cuts: int
    advice: str


def mean_points(cards: Sequence[ScoreCard]) -> dict[str, tuple[float, float]]:
    """Return mean points and most points by part, over the cuts with an overall score."""
    scored = [card for card in cards if card.overall_score is not None]
    most = {each.part: each.most for card in scored for each in card.points}
    return {
        part: (sum(each.points for card in scored for each in card.points if each.part == part) / len(scored), best)
        for part, best in most.items()
    }


def next_tries(cards: Sequence[ScoreCard]) -> tuple[NextTry, ...]:
    """Return what to try next, by the parts that cost most points in a person's last cuts; the costliest first.

    Parameters
    ----------
    cards : sequence of ScoreCard
        Cards of the person's cuts, in their order.

    Returns
    -------
    tuple of NextTry
        Up to three, each advice once.
    """
    last = [card for card in cards if card.overall_score is not None][-RECENT:]
    by_part = mean_points(last)
    groups = {name: [by_part.pop(part) for part in parts if part in by_part] for name, (parts, _) in _CAUSES.items()}
    groups |= {part: [points] for part, points in by_part.items()}
    sums = [(name, sum(p for p, _ in own), sum(most for _, most in own)) for name, own in groups.items() if own]
    tries: list[NextTry] = []
    for name, points, most in sorted(sums, key=lambda row: row[1] - row[2]):
        if most - points < _LITTLE * most or len(tries) == _MOST:
            continue
        kinds = _CAUSES[name][1] if name in _CAUSES else ()
        faults = [(k, fault) for k, card in enumerate(last) for fault in card.faults if fault.kind in kinds]
        seen, cuts, advice = "", 0, _ADVICE.get(name, _STEADY)
        if faults:
            latest = faults[-1][1]
            cuts = len({k for k, fault in faults if fault.kind == latest.kind})
            seen, advice = latest.says, latest.try_next
        if advice not in {each.advice for each in tries}:
            tries.append(NextTry(part=name, points=points, most=most, seen=seen, cuts=cuts, advice=advice))
    return tuple(tries)


def outcome_counts(cards: Sequence[ScoreCard]) -> dict[str, int]:
    """Return how many cuts were a success, missed the target, or went beyond a limit; empty if no outcome is known."""
    known = [card for card in cards if card.outcome]
    success = sum(card.outcome.startswith("success") for card in known)
    beyond = sum(each.part == "limits" and each.points == 0.0 for card in known for each in card.points)
    return {"success": success, "missed": len(known) - success - beyond, "beyond a limit": beyond} if known else {}
