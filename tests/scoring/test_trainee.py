"""Feedback to a trainee: where the points went, what to try next, and how often cuts succeeded."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from made_up_study import sawing

from cutenv.scoring import ScoreCard, score
from cutenv.scoring.points import ScorePoints
from cutenv.scoring.study.trainee import mean_points, next_tries, outcome_counts
from cutenv.scoring.technique import TechniqueFault

BEST = {"limits": 5.0, "way": 25.0, "accuracy": 10.0, "success": 20.0, "tissue": 25.0, "steadiness": 10.0, "time": 5.0}


@pytest.fixture(scope="module")
def card() -> ScoreCard:
    """Any card, to be filled."""
    return score(sawing(0.3, np.random.default_rng(1)))


def filled(card: ScoreCard, faults: dict[str, str], **points: float) -> ScoreCard:
    """The card of a cut with these points, the best of all others, and faults with their advice."""
    parts = tuple(
        ScorePoints(part=part, points=points.get(part, best), most=best, reason="made up")
        for part, best in BEST.items()
    )
    found = tuple(
        TechniqueFault(kind=kind, time=1.0, position=None, says=f"{kind} seen", try_next=advice)
        for kind, advice in faults.items()
    )
    total = sum(each.points for each in parts)
    outcome = "success, 1.0 mm short of the target" if not faults else "5.0 mm short of the target"
    return dataclasses.replace(card, points=parts, overall_score=total, no_score="", outcome=outcome, faults=found)


def test_the_costliest_part_comes_first_with_the_advice_of_its_fault(card: ScoreCard) -> None:
    missed = filled(card, {"short": "lead on", "lurch": "lean"}, accuracy=0.0, success=0.0, tissue=5.0)
    tries = next_tries([filled(card, {}), missed, missed, filled(card, {"lurch": "lean"}, tissue=5.0)])
    assert [(each.part, each.advice, each.cuts) for each in tries] == [("target", "lead on", 2), ("tissue", "lean", 3)]
    assert (tries[0].points, tries[0].most) == (pytest.approx(40.0), 60.0)
    assert tries[1].seen == "lurch seen"


def test_only_the_last_cuts_count_and_a_good_one_needs_no_advice(card: ScoreCard) -> None:
    bad = filled(card, {"short": "lead on"}, success=0.0)
    assert next_tries([bad, *[filled(card, {})] * 3]) == ()
    assert next_tries([]) == ()


def test_a_loss_without_a_fault_has_its_own_advice(card: ScoreCard) -> None:
    (one,) = next_tries([filled(card, {}, steadiness=2.0)])
    assert (one.part, one.seen, one.cuts) == ("steadiness", "", 0)
    assert one.advice


def test_a_cut_beyond_a_limit_has_no_points_but_for_the_way(card: ScoreCard) -> None:
    beyond = dataclasses.replace(
        filled(card, {"force": "slow down"}),
        points=(ScorePoints(part="way", points=3.0, most=25.0, reason="too much force"),),
        outcome="the force exceeded the limit",
    )
    cards = [filled(card, {}), beyond]
    assert mean_points(cards)["tissue"] == (12.5, 25.0)
    assert next_tries(cards)[0].advice == "slow down"
    assert outcome_counts(cards) == {"success": 1, "missed": 0, "beyond a limit": 1}
    assert outcome_counts([card]) == {}
