"""A sequential comparison errs at most as often as it says, whenever one looks, and finds what is there."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from cutenv.records.scoring.study.sequential import (
    DECISIONS,
    MAX_CORRECTION,
    SequentialQuestion,
    confidence_sequence,
    corrected,
    fixed_design,
    log_wealth,
    planned_pairs,
    sequential_decisions,
    stops,
)
from scripts.validation.scoring import check_sequential

STUDIES, PAIRS = 2000, 200
LOOSE = SequentialQuestion(error=0.2, smallest=0.1)


def swinging(rng, shape):
    """Differences of day after day, better by 0.3 after it was worse by as much: on average at most 0 at any time."""
    return np.where(np.arange(shape[1]) // 20 % 2 == 0, -0.3, 0.3) + rng.uniform(-0.5, 0.5, shape)


HARDEST = {
    "a fair coin": lambda rng, shape: rng.choice((-1.0, 1.0), shape),
    "rarely a disaster": lambda rng, shape: np.where(rng.random(shape) < 0.02, -1.0, 0.02 / 0.98),
    "another mean every day": swinging,
    "a spread that grows when it wins": lambda rng, shape: (
        np.cumprod(rng.choice((1.0, 0.98), shape), axis=1) * rng.choice((-1.0, 1.0), shape)
    ),
}


@pytest.mark.parametrize("name", HARDEST)
def test_equal_policies_are_told_apart_no_more_often_than_said(name):
    found = HARDEST[name](np.random.default_rng(5), (STUDIES, PAIRS))
    _, said = stops(sequential_decisions(found, LOOSE))
    better = np.mean(said == 1)
    assert better <= 0.5 * LOOSE.error + 3.0 * math.sqrt(0.1 * 0.9 / STUDIES)


def test_one_who_stakes_more_than_the_error_allows_is_found_out():
    found = HARDEST["a fair coin"](np.random.default_rng(5), (STUDIES, PAIRS))
    t = np.cumsum(found, axis=1) / np.sqrt(np.arange(1, PAIRS + 1))
    assert np.mean((t[:, 9:] > 1.28).any(axis=1)) > 0.3, "looking again and again at a fixed test errs"


@pytest.mark.parametrize("mean", [-0.4, 0.0, 0.3])
def test_the_interval_holds_the_mean_at_every_time(mean):
    rng = np.random.default_rng(3)
    found = np.where(rng.random((STUDIES, PAIRS)) < 0.5 * (1.0 + mean), 1.0, -1.0)
    above, below = (log_wealth(side * found, side * mean, 1.0).max(axis=1) >= LOOSE.bar for side in (1.0, -1.0))
    assert np.mean(above | below) <= LOOSE.error
    low, high = confidence_sequence(found[0], LOOSE)
    held = (low <= mean) & (mean <= high)
    assert held.all() == (not (above[0] or below[0]))


def test_the_interval_decides_as_the_decisions_do():
    found = np.clip(np.random.default_rng(1).normal(0.15, 0.3, 120), -1.0, 1.0)
    low, high = confidence_sequence(found, LOOSE)
    said = sequential_decisions(found, LOOSE)
    assert ((low > 0.0) == (said == 1)).all()
    assert (said == 1).any()
    equal = np.full(120, 0.01)
    low, high = confidence_sequence(equal, LOOSE)
    within = (low > -0.1) & (high < 0.1) & (low <= 0.0)
    assert (within == (sequential_decisions(equal, LOOSE) == 3)).all()
    assert within.any()


def test_first_and_second_are_treated_alike():
    found = np.clip(np.random.default_rng(2).normal(0.08, 0.3, (50, 80)), -1.0, 1.0)
    at, said = stops(sequential_decisions(found, LOOSE))
    other_at, other = stops(sequential_decisions(-found, LOOSE))
    assert (at == other_at).all()
    assert ((said == 1) == (other == 2)).all()
    assert {DECISIONS[k] for k in said} >= {"better", "undecided"}


def test_a_large_difference_is_found_with_fewer_pairs_than_a_fixed_design_takes():
    question = SequentialQuestion()
    found = np.clip(np.random.default_rng(0).normal(0.1, 0.2, (300, 200)), -1.0, 1.0)
    at, said = stops(sequential_decisions(found, question))
    assert np.mean(said == 1) > 0.98
    assert np.median(at) < 0.6 * fixed_design(0.2, question)


def test_a_good_forecast_saves_pairs_and_a_bad_one_does_no_harm():
    rng = np.random.default_rng(8)
    shape = (300, 400)
    place, coin = rng.normal(0.0, 0.25, shape), rng.choice((-1.0, 1.0), shape)
    found = np.clip(0.05 + coin * place + rng.normal(0.0, 0.1, shape), -1.0, 1.0)
    plain = np.median(stops(sequential_decisions(found, SequentialQuestion()))[0])
    medians = {}
    for name, forecast in {"good": place, "none": 0.0 * place, "wrong": 0.4 + 3.0 * place[::-1]}.items():
        better, room = corrected(found, coin * forecast)
        assert (room <= MAX_CORRECTION).all()
        assert better.mean() == pytest.approx(0.05, abs=0.01), name
        medians[name] = np.median(stops(sequential_decisions(better, SequentialQuestion(), room))[0])
    assert medians["good"] < 0.65 * plain
    assert medians["none"] == plain
    assert medians["wrong"] < 1.15 * plain


def test_the_coefficient_is_of_earlier_pairs_alone():
    rng = np.random.default_rng(4)
    found, covariates = rng.uniform(-1.0, 1.0, (2, 30))
    changed = found.copy()
    changed[20] = -found[20]
    before, after = corrected(found, covariates)[0], corrected(changed, covariates)[0]
    assert (before[:20] == after[:20]).all()
    assert after[20] - changed[20] == before[20] - found[20]
    assert after[21] != before[21]


def test_a_plan_says_what_studies_then_need():
    rng = np.random.default_rng(6)
    pilot = np.clip(rng.normal(0.15, 0.2, 400), -1.0, 1.0)
    plan = planned_pairs(pilot, SequentialQuestion(most=200))
    at, said = stops(
        sequential_decisions(
            np.clip(rng.normal(pilot.mean(), 0.2, (500, 200)), -1.0, 1.0), SequentialQuestion(most=200)
        )
    )
    assert plan.low <= np.median(at) <= plan.high
    assert plan.chances["better"] == pytest.approx(np.mean(said == 1), abs=0.05)
    assert plan.nine_in_ten >= plan.median


@pytest.mark.parametrize(
    ("given", "told"),
    [({"error": 0.0}, "error"), ({"smallest": 1.2}, "smallest"), ({"most": 1}, "most"), ({"reach": -1.0}, "reach")],
)
def test_a_question_without_an_answer_is_refused(given, told):
    with pytest.raises(ValueError, match=told):
        SequentialQuestion(**given)


def test_a_difference_beyond_its_bounds_is_refused():
    with pytest.raises(ValueError, match=r"1\.5 is beyond reach = 1"):
        sequential_decisions(np.array([0.1, 1.5]), LOOSE)


def test_both_stand_beside_each_other_and_a_median_that_was_not_reached_is_left_out() -> None:
    shown = {"here": (0.6, 120.0), "confseq": (0.4, float("inf"))}
    rows = [
        {"kind": "normal", "mean": 0.1, "by": by, "studies": 2000, "shown": share, "median": median}
        for by, (share, median) in shown.items()
    ]
    assert check_sequential.library_table(rows).splitlines()[-1] == "| normal | 0.1 | 60.0 % | 40.0 % | 120 |  |"


def test_a_library_that_is_missing_is_named_with_its_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "confseq", None)
    with pytest.raises(SystemExit, match=r"github\.com/gostevehoward/confseq .* numpy below 2"):
        check_sequential.library_rows(1)
