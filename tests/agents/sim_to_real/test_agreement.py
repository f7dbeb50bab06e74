"""Agreement of two benches that cut the same: shifts and their intervals."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from compared_cuts import made_up_agreement, made_up_cut
from scipy.stats import ttest_1samp, wilcoxon

from cutenv.agents.sim_to_real import (
    FEWEST_SPECIMENS,
    MEASURES,
    Agreement,
    ClockKept,
    equivalence,
    force_over_position,
    force_rmse,
    holm,
    mean_shift,
    position_rmse,
    signed_rank_shift,
)
from cutenv.agents.sim_to_real.comparison_report import in_margins
from cutenv.agents.sim_to_real.measures import force_offset
from cutenv.records.scoring import METRICS
from cutenv.sim.trace import Trace


def test_every_metric_of_a_score_is_compared() -> None:
    assert set(METRICS) < set(MEASURES)
    assert {"return", "success", "end_agreement", "force_rmse", "position_rmse"} < set(MEASURES)
    assert all(each.least_margin >= 0.0 for each in MEASURES.values())


def test_another_draw_of_noise_agrees() -> None:
    verdict = made_up_agreement().verdict
    assert verdict.answer == "agree", str(verdict)


def check_it_is_found(name: str, **of_rig: object) -> None:
    agreement = made_up_agreement(**of_rig)
    assert agreement.verdict.answer == "differ"
    assert name in agreement.verdict.differ


def test_a_force_that_is_too_large_is_found() -> None:
    check_it_is_found("force_offset", offset=0.2)
    check_it_is_found("mean_force_per_depth", offset=0.2)


def test_a_force_that_comes_late_is_found() -> None:
    check_it_is_found("force_rmse", delay=0.08)


def test_cuts_that_end_otherwise_are_found() -> None:
    check_it_is_found("end_agreement", end="overshoot", success=False)
    check_it_is_found("success", end="overshoot", success=False)


def test_few_specimens_leave_it_open_and_say_how_many_would_do() -> None:
    verdict = made_up_agreement(specimens=6, offset=0.045).verdict
    assert verdict.answer == "undecided"
    assert "specimens would do" in str(verdict)


def test_chance_alone_says_differ_in_one_of_twenty_evaluations_at_most() -> None:
    """All measures at once, each at its margin: only Holm's correction keeps the family's level."""
    rng = np.random.default_rng(2)
    wrong = [
        min(holm([signed_rank_shift(1.0 + rng.standard_normal(16), 1.0).p_beyond for _ in range(28)])) < 0.05
        for _ in range(200)
    ]
    assert np.mean(wrong) < 0.08


def test_unpaired_sides_need_nothing_in_common_and_compare_nothing_cut_by_cut() -> None:
    agreement = made_up_agreement(paired=False)
    names = {each.measure.name for each in agreement.findings}
    assert "peak_force" in names
    assert not {"force_rmse", "end_agreement", "position_rmse"} & names
    paired = {each.measure.name: each for each in made_up_agreement().findings}
    of = {each.measure.name: each for each in agreement.findings}
    width = of["peak_force"].shift.high - of["peak_force"].shift.low
    assert width > 5.0 * (paired["peak_force"].shift.high - paired["peak_force"].shift.low)


def test_too_few_specimens_are_refused_with_a_cure() -> None:
    with pytest.raises(ValueError, match="give 6 or more of each, and the same ones"):
        made_up_agreement(specimens=5)
    cuts = [made_up_cut(k, 0) for k in range(6)]
    with pytest.raises(ValueError, match="fewer than 2 simulated cuts"):
        Agreement(cuts, [[each] for each in cuts])


def ramp(*, start: float = 0.0, back: bool = False) -> Trace:
    """Force is 100 N a metre of the blade's way, from ``start`` [m] on; with a retreat of 5 mm half-way."""
    position = start + np.linspace(0.0, 0.04, 400)
    if back:
        position = np.concatenate([position[:200], position[150:200][::-1], position[150:]])
    return Trace(time=0.01 * np.arange(len(position)), force=100.0 * position, position=position)


def test_the_force_of_equal_cuts_differs_by_nothing_and_of_displaced_ones_by_its_slope() -> None:
    assert force_rmse(ramp(), ramp()) == pytest.approx(0.0, abs=1e-12)
    assert force_rmse(ramp(), ramp(), displaced=0.001) == pytest.approx(0.1, rel=1e-6)
    assert force_offset(ramp(), ramp()) == pytest.approx(0.0, abs=1e-12)


def test_after_a_retreat_nothing_is_compared() -> None:
    at, force = force_over_position(ramp(back=True))
    assert at[-1] == pytest.approx(0.02, abs=2e-4)
    assert force == pytest.approx(100.0 * at, abs=1e-9)


def test_cuts_without_way_in_common_have_no_difference() -> None:
    assert force_rmse(ramp(), ramp(start=0.036)) is None


def test_positions_are_compared_at_equal_times() -> None:
    late = made_up_cut(0, 0).trace
    moved = Trace(time=late.time, force=late.force, position=late.position + 0.001)
    assert position_rmse(late, moved) == pytest.approx(0.001)


def test_the_clocks_jitter_and_quantiles_are_those_of_its_periods() -> None:
    periods = np.full(1000, 0.020)
    periods[::2] += 0.001
    periods[1::2] -= 0.001
    clock = ClockKept.of(0.020, [(periods[:500], [0.002] * 500, 1, 0.0, 0), (periods[500:], [0.003] * 500, 2, 0.5, 4)])
    assert clock.jitter == pytest.approx(0.001)
    assert clock.spread("periods")["max"] == pytest.approx(0.021)
    assert clock.spread("latencies")["p99"] == pytest.approx(0.003)
    assert (clock.overruns, clock.skipped, clock.garbled) == (3, 0.5, 4)


def test_a_clock_without_periods_has_no_quantiles() -> None:
    assert ClockKept.of(0.020, []).spread("periods") == {}


def test_a_clock_in_milliseconds_is_refused() -> None:
    with pytest.raises(ValueError, match=r"20 ms is 0\.02"):
        ClockKept.of(20.0, [])


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


def test_a_measure_of_zeros_whose_margin_is_zero_is_drawn() -> None:
    assert [in_margins(end, 0.0) for end in (0.0, 1.0, -1.0)] == [0.0, 4.0, -4.0]
    assert in_margins(0.5, 0.25) == 2.0


@pytest.mark.parametrize("paired", [True, False])
def test_what_is_nothing_in_every_cut_is_no_open_question(paired: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = dataclasses.replace(MEASURES["return"], value=lambda cut, simulated: 0.0, least_margin=0.0)
    monkeypatch.setattr(equivalence, "measures_of", lambda cuts: {"return": nothing})
    agreement = made_up_agreement.__wrapped__(paired=paired)
    assert not agreement.findings
    assert agreement.not_compared == {"return": "it is 0 in every cut, on both sides"}
