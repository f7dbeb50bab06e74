"""Interquartile means and their intervals: closed forms, SciPy, and what they must hold in 19 of 20 cases."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.agents.learning.statistics import Interval, interquartile_mean, mean, stratified


def test_of_eight_numbers_the_middle_four_count():
    assert interquartile_mean(np.array([1e9, 4.0, -1e9, 2.0, 3.0, 1.0, 1e8, -1e8])) == pytest.approx(2.5)


def test_the_interval_of_a_mean_of_one_run_is_that_of_theory():
    values = np.random.default_rng(1).normal(size=(1, 400))
    found = stratified([values], mean)
    half = 1.96 * values.std() / 20.0
    assert found.value == pytest.approx(values.mean())
    assert (found.high - found.low) / 2.0 == pytest.approx(half, rel=0.06)


def test_the_interval_of_an_interquartile_mean_covers_in_19_of_20_cases():
    rng, covered = np.random.default_rng(2), 0
    for trial in range(200):
        covered += stratified([rng.normal(size=(1, 60))], resamples=400, seed=trial).holds(0.0)
    assert 0.88 < covered / 200 < 0.99


def coverage(of_runs: float, runs: int = 5) -> float:
    """Share of intervals that hold the mean, of scores whose runs differ by so much beside specimens and the rest."""
    rng, held = np.random.default_rng(7), 0
    for trial in range(200):
        parts = of_runs * rng.normal(size=(runs, 1)), rng.normal(size=(1, 100)), 1.3 * rng.normal(size=(runs, 100))
        held += stratified([sum(parts)], mean, resamples=200, seed=trial).holds(0.0)
    return held / 200


def test_runs_crossed_with_specimens_cover_unless_few_runs_differ_more_than_all_else():
    assert 0.92 < coverage(of_runs=0.03) <= 1.0  # as of PPO beside the script
    assert 0.78 < coverage(of_runs=1.0) < 0.92  # as without force: five runs are few, and the leaderboard says so


def test_runs_that_differ_widen_the_interval_and_more_specimens_do_not_narrow_it_away():
    rng = np.random.default_rng(3)
    alike = rng.normal(size=(3, 2000))
    unlike = alike + np.array([[-1.0], [0.0], [1.0]])
    wide, narrow = (stratified([values], mean) for values in (unlike, alike))
    assert wide.high - wide.low > 10.0 * (narrow.high - narrow.low)


def test_each_stratum_keeps_its_share():
    """Two classes that differ, and nothing else does: resampled within, the mean cannot waver."""
    strata = [np.zeros((2, 30)), np.ones((2, 30))]
    found = stratified(strata, mean)
    assert (found.low, found.value, found.high) == (0.5, 0.5, 0.5)
    pooled = stratified([np.concatenate(strata, axis=1)], mean)
    assert pooled.high - pooled.low > 0.1


def test_a_run_is_one_agent_in_all_strata():
    """What a run is better or worse by, it is so everywhere: more strata do not average it away."""
    offsets, one = np.array([[-1.0], [0.0], [1.0]]), np.zeros((3, 20))
    pooled, apart = (stratified(strata, mean) for strata in ([one + offsets], [one + offsets] * 4))
    assert apart.high - apart.low == pytest.approx(pooled.high - pooled.low, rel=0.02)
    assert apart.high - apart.low > 1.5


def test_specimens_that_belong_together_are_drawn_together():
    values = np.random.default_rng(6).normal(size=(1, 400))
    pooled = stratified([values], mean)
    together, apart = (stratified([values] * 4, mean, same_specimens=same) for same in (True, False))
    assert together.high - together.low == pytest.approx(pooled.high - pooled.low, rel=0.02)
    assert apart.high - apart.low == pytest.approx((pooled.high - pooled.low) / 2.0, rel=0.1)


def test_strata_of_different_runs_are_refused():
    with pytest.raises(ValueError, match="same training runs in each"):
        stratified([np.zeros((3, 5)), np.zeros((1, 5))])
    with pytest.raises(ValueError, match="and the same specimens"):
        stratified([np.zeros((3, 5)), np.zeros((3, 6))], same_specimens=True)


@pytest.mark.parametrize("bad", [[], [np.zeros(3)], [np.zeros((0, 3))], [np.array([[np.nan]])]])
def test_what_tells_nothing_is_refused(bad):
    with pytest.raises(ValueError, match="strata"):
        stratified(bad)


def test_intervals_meet_where_they_have_a_number_in_common():
    assert Interval(0.5, 0.4, 0.6).meets(Interval(0.7, 0.6, 0.8))
    assert not Interval(0.5, 0.4, 0.6).meets(Interval(0.7, 0.61, 0.8))
