"""Raters: correlations against SciPy's, agreement of raters, and intervals that draw people."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import pearsonr, spearmanr

from cutenv.records.scoring.study import rater_agreement, rater_correlation
from cutenv.records.scoring.study.reliability import _correlation, _ranks, mean_mark

PEOPLE = [f"P{i // 4}" for i in range(80)]


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def rated(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    drawn = np.random.default_rng(seed)
    values = drawn.normal(size=80)
    return values, np.round(values + drawn.normal(size=80))  # marks have ties


def test_correlations_are_those_of_scipy() -> None:
    values, marks = rated()
    found = rater_correlation(values, marks, PEOPLE, better="higher", rng=rng())
    assert found.rank.value == pytest.approx(spearmanr(values, marks).statistic)
    assert found.linear.value == pytest.approx(pearsonr(values, marks).statistic)
    assert (found.cuts, found.people) == (80, 20)
    for each in (found.rank, found.linear):
        assert each.low is not None
        assert each.high is not None
        assert each.low < each.value < each.high


def test_the_scale_of_the_marks_does_not_matter_but_its_best_end_does() -> None:
    values, marks = rated()
    one = rater_correlation(values, marks, PEOPLE, better="higher", rng=rng())
    for better, best, sign in (("lower", "highest", -1), ("higher", "lowest", -1), ("lower", "lowest", 1)):
        other = rater_correlation(values, 100.0 - 7.0 * marks, PEOPLE, better=better, best_mark=best, rng=rng())
        assert other.rank.value == pytest.approx(-sign * one.rank.value)
        assert other.linear.value == pytest.approx(-sign * one.linear.value)


def test_a_weighted_row_is_the_sample_with_repeats() -> None:
    weights, x, y = np.array([[2.0, 0, 1, 3, 1]]), np.array([1.0, 5, 2, 2, 9]), np.array([3.0, 5, 1, 2, 2])
    again = np.repeat(np.arange(5), weights[0].astype(int))
    found = _correlation(weights, _ranks(weights, x), _ranks(weights, y))
    assert found[0] == pytest.approx(spearmanr(x[again], y[again]).statistic)


def test_cuts_of_one_person_that_are_alike_widen_the_interval() -> None:
    drawn = np.random.default_rng(5)
    values = np.repeat(drawn.normal(size=20), 4)
    marks = np.repeat(values[::4] + drawn.normal(size=20), 4)
    width = {}
    for name, people in (("people", PEOPLE), ("cuts", [str(i) for i in range(80)])):
        rank = rater_correlation(values, marks, people, better="higher", rng=rng()).rank
        assert rank.low is not None
        assert rank.high is not None
        width[name] = rank.high - rank.low
    assert width["people"] > 1.5 * width["cuts"]


def test_few_people_have_a_correlation_without_an_interval() -> None:
    values, marks = rated()
    found = rater_correlation(values[:16], marks[:16], PEOPLE[:16], better="higher", rng=rng())
    assert found.rank.low is None
    assert "it takes 5 people, here 4" in found.rank.note


def test_raters_of_any_scale_have_a_mean_mark() -> None:
    table = np.array([[1.0, 10.0, 3.0], [2.0, 20.0, 3.0], [3.0, np.nan, 3.0], [np.nan, np.nan, 3.0]])
    mean = mean_mark(table)
    assert mean[:2] == pytest.approx([-(np.sqrt(1.5) + 1) / 2, 0.5])
    assert mean[2] == pytest.approx(np.sqrt(1.5))
    assert np.isnan(mean[3])  # only a rater who gave every cut the same mark rated it


def test_a_severe_rater_disagrees_and_is_consistent() -> None:
    _, marks = rated()
    found = rater_agreement(np.column_stack([marks, marks - 1.5]), PEOPLE, rng=rng())
    assert found.consistency.value == pytest.approx(1.0)
    assert found.agreement.value < 0.8
    assert found.rank.value == pytest.approx(1.0)
    assert (found.raters, found.cuts, found.people) == (2, 80, 20)


@pytest.mark.parametrize(
    ("marks", "message"),
    [
        (np.ones(80), "all 80 marks are alike"),
        (np.where(np.arange(80) < 3, np.arange(80.0), np.nan), r"fewer than 4 cuts have a value and a mark \(3\)"),
    ],
)
def test_marks_that_say_nothing_are_told_to(marks: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rater_correlation(rated()[0], marks, PEOPLE, better="higher", rng=rng())


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (np.arange(80.0)[:, None], "two raters or more"),
        (np.full((80, 2), np.nan), "fewer than 4 cuts were marked by all raters"),
        (np.column_stack([np.arange(80.0), np.ones(80)]), "a rater gave every cut the same mark"),
    ],
)
def test_raters_who_cannot_be_compared_are_told_why(table: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rater_agreement(table, PEOPLE, rng=rng())
