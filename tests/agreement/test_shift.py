"""Shifts: their intervals hold what they promise, and both questions are answered at their level."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import ttest_1samp, wilcoxon

from cutenv.sim_to_real import FEWEST_SPECIMENS, holm, mean_shift, signed_rank_shift

TRIALS = 1500


def shares(shift: float, margin: float, n: int = 12) -> tuple[float, float, float]:
    """How often samples about ``shift`` are within and beyond, and the interval holds it, at 5 %."""
    rng = np.random.default_rng(8)
    found = [signed_rank_shift(shift + rng.standard_normal(n), margin) for _ in range(TRIALS)]
    held = np.mean([each.low <= shift <= each.high for each in found])
    return np.mean([each.p_within < 0.05 for each in found]), np.mean([each.p_beyond < 0.05 for each in found]), held


@pytest.mark.parametrize("n", [FEWEST_SPECIMENS, 12, 31])
def test_chances_are_those_of_wilcoxons_test(n: int) -> None:
    d = np.random.default_rng(n).standard_normal(n) + 0.3
    shift = signed_rank_shift(d, 0.5)
    above, below = (
        wilcoxon(d + margin, alternative=way, method="exact").pvalue
        for margin, way in ((0.5, "greater"), (-0.5, "less"))
    )
    assert shift.p_within == pytest.approx(max(above, below), rel=1e-9)
    beyond = [
        wilcoxon(d - margin, alternative=way, method="exact").pvalue
        for margin, way in ((0.5, "greater"), (-0.5, "less"))
    ]
    assert shift.p_beyond == pytest.approx(min(2.0 * min(beyond), 1.0), rel=1e-9)


@pytest.mark.parametrize("n", [FEWEST_SPECIMENS, 9, 20])
def test_the_interval_holds_just_what_the_test_does_not_refuse(n: int) -> None:
    d = np.random.default_rng(n).standard_normal(n)
    shift = signed_rank_shift(d, 1.0)
    for end, inside in ((shift.low, 1e-9), (shift.high, -1e-9)):
        assert wilcoxon(d - end - inside, method="exact").pvalue > 0.05
        assert wilcoxon(d - end + inside, method="exact").pvalue <= 0.05


def test_at_the_margin_each_answer_is_wrong_in_one_of_twenty_and_the_interval_holds() -> None:
    within, beyond, held = shares(1.0, 1.0)
    assert 0.02 < within < 0.065
    assert beyond < 0.065
    assert 0.93 < held < 0.98


def test_far_from_the_margin_the_answer_is_found() -> None:
    assert shares(0.0, 1.5)[0] > 0.95
    assert shares(3.0, 1.0)[1] > 0.95


def test_a_cut_that_went_otherwise_does_not_rule_the_typical_difference() -> None:
    d = np.append(0.1 * np.random.default_rng(1).standard_normal(11), -50.0)
    assert abs(signed_rank_shift(d, 0.5).value) < 0.1
    assert signed_rank_shift(d, 0.5).p_within < 0.05


def test_equal_differences_are_within_or_beyond() -> None:
    assert signed_rank_shift(np.zeros(8), 0.1).p_within < 0.05
    assert signed_rank_shift(np.full(8, 0.2), 0.1).p_beyond < 0.05
    assert signed_rank_shift(np.zeros(8), 0.1).needed == 8


def test_a_means_shift_is_the_t_tests() -> None:
    d = np.random.default_rng(4).standard_normal(10)
    shift = mean_shift(float(d.mean()), float(d.std(ddof=1)) / math.sqrt(10), 9, 0.4, 10)
    told = ttest_1samp(d, 0.0).confidence_interval(0.95)
    assert (shift.low, shift.high) == pytest.approx((told.low, told.high))
    assert shift.p_within == pytest.approx(
        max(ttest_1samp(d, -0.4, alternative="greater").pvalue, ttest_1samp(d, 0.4, alternative="less").pvalue)
    )


def test_so_many_specimens_as_are_said_to_be_needed_decide_four_times_in_five() -> None:
    rng = np.random.default_rng(3)
    needed = np.median([signed_rank_shift(0.5 + rng.standard_normal(12), 1.0).needed or 1000 for _ in range(200)])
    decided = [signed_rank_shift(0.5 + rng.standard_normal(int(needed)), 1.0).p_within < 0.05 for _ in range(300)]
    assert 0.65 < np.mean(decided) < 0.95


def test_holm_is_as_published() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@pytest.mark.parametrize("bad", [[1.0] * (FEWEST_SPECIMENS - 1), [math.nan] * FEWEST_SPECIMENS])
def test_too_few_differences_are_refused_and_so_is_no_number(bad: list[float]) -> None:
    with pytest.raises(ValueError, match="differences"):
        signed_rank_shift(bad, 1.0)
