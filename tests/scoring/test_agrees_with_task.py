"""The overall score agrees with the task; scripts/check_score.py does the same over 500 specimens of each class."""

from __future__ import annotations

import check_score
import pytest

SPECIMENS = 24
PLAYERS = ("return stroke", "fast then slow", "force feedback", "ppo-free", check_score.FEED, "random")


@pytest.fixture(scope="module")
def rows():
    return check_score.measure(PLAYERS, SPECIMENS, "mixed")


def test_every_success_has_more_than_any_failure_on_the_same_specimen(rows):
    found = check_score.agreement(rows)
    assert found.success_pairs > 100
    assert found.success_wrong == 0


def test_where_returns_differ_the_score_agrees(rows):
    found = check_score.agreement(rows)
    assert found.pairs > 100
    assert found.agreeing >= 0.95
    assert found.rank_correlation > 0.8


def test_a_score_turned_round_would_be_noticed(rows):
    turned = [row | {"score": 100.0 - row["score"]} for row in rows]
    found = check_score.agreement(turned)
    assert found.success_wrong == found.success_pairs
    assert found.agreeing < 0.1


def test_script_feed_and_giving_up_stand_in_this_order(rows):
    means = check_score.mean_scores(rows)
    in_order = [means[name] for name in check_score.ORDER if name in means]
    assert len(in_order) == 3
    assert in_order == sorted(in_order, reverse=True)


def test_the_report_tells_the_agreement(rows):
    table = check_score.report(rows)
    assert f"{SPECIMENS} held-out specimens" in table
    assert f"| 0 of {check_score.agreement(rows).success_pairs} |" in table
