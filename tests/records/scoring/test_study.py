"""Statistics of studies: published tables, coverage of intervals, and what they refuse."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_study import study
from scipy import stats

from cutenv.display.report.study_page import table_lines
from cutenv.records.scoring import METRICS, ScoreCard, score
from cutenv.records.scoring.study import (
    Cusum,
    Estimate,
    Intraclass,
    LearningCurve,
    NotEstimable,
    OneWay,
    Separation,
    StudiedCut,
    Study,
    cusum,
    intraclass_correlation,
    learning_curve,
    one_way_reliability,
    separation,
)
from cutenv.sim.trace import Trace

FORMS = (
    "one_way", "agreement", "consistency", "one_way_of_means", "agreement_of_means", "consistency_of_means",
)  # fmt: skip
# Shrout & Fleiss 1979, Table 2: six subjects rated by four judges.
SHROUT_FLEISS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]])
PUBLISHED = dict(zip(FORMS, (0.17, 0.29, 0.71, 0.44, 0.62, 0.91), strict=True))
# 95 % intervals of the same as the R package psych prints them (help page of ICC).
PUBLISHED_ENDS = {
    "one_way": (-0.133, 0.723),
    "agreement": (0.019, 0.761),
    "consistency": (0.342, 0.946),
    "one_way_of_means": (-0.884, 0.912),
    "agreement_of_means": (0.071, 0.927),
    "consistency_of_means": (0.676, 0.986),
}
# Montgomery, Introduction to Statistical Quality Control, Table 9.1: the mean shifts from 10 to 11 after reading 20.
MONTGOMERY = [
    9.45, 7.99, 9.29, 11.66, 12.16, 10.18, 8.04, 11.46, 9.20, 10.34, 9.03, 11.47, 10.51, 9.40, 10.08,
    9.37, 10.62, 10.31, 8.52, 10.84, 10.90, 9.33, 12.29, 11.50, 10.60, 11.08, 10.38, 11.62, 11.31, 10.52,
]  # fmt: skip
tables = st.lists(st.lists(st.integers(-50, 50), min_size=4, max_size=4), min_size=3, max_size=8).map(np.array)


def rows_differ(table: np.ndarray) -> bool:
    return bool(np.ptp(table.mean(axis=1)) > 0)


def check_published_correlations(table: np.ndarray) -> None:
    found = intraclass_correlation(table)
    for form in FORMS:
        estimate = getattr(found, form)
        assert round(estimate.value, 2) == PUBLISHED[form]
        assert (round(estimate.low, 3), round(estimate.high, 3)) == PUBLISHED_ENDS[form]


def test_correlations_are_those_of_shrout_and_fleiss() -> None:
    check_published_correlations(SHROUT_FLEISS)


@given(tables.filter(rows_differ), st.floats(0.1, 100.0), st.floats(-100.0, 100.0))
def test_correlations_do_not_depend_on_unit_zero_or_order(table: np.ndarray, unit: float, zero: float) -> None:
    found = intraclass_correlation(table)
    other = intraclass_correlation(unit * table[::-1, ::-1] + zero)
    for form, end in itertools.product(FORMS, ("value", "low", "high")):
        assert getattr(getattr(other, form), end) == pytest.approx(getattr(getattr(found, form), end), abs=1e-6)


@given(tables.filter(rows_differ))
def test_every_interval_holds_its_estimate(table: np.ndarray) -> None:
    found = intraclass_correlation(table)
    for form in ("one_way", "consistency", "one_way_of_means", "consistency_of_means"):
        estimate = getattr(found, form)
        assert estimate.low <= estimate.value + 1e-9
        assert estimate.value <= estimate.high + 1e-9
        assert estimate.high <= 1.0


def test_a_shift_of_everybody_counts_against_agreement_only() -> None:
    shifted = SHROUT_FLEISS + np.array([0, 10, 20, 30])
    before, after = intraclass_correlation(SHROUT_FLEISS), intraclass_correlation(shifted)
    assert after.consistency.value == pytest.approx(before.consistency.value)
    assert after.agreement.value < 0.3 * before.agreement.value


def test_full_agreement_is_one_without_any_width() -> None:
    found = intraclass_correlation(np.array([[1.0, 1.0], [2.0, 2.0], [4.0, 4.0]]))
    for form in FORMS:
        assert getattr(found, form) == Estimate(value=1.0, low=1.0, high=1.0)


@given(tables.filter(rows_differ))
def test_equal_numbers_of_cuts_give_the_exact_one_way_correlation(table: np.ndarray) -> None:
    full, free = intraclass_correlation(table), one_way_reliability(list(table))
    for end in ("value", "low", "high"):
        assert getattr(free.single, end) == pytest.approx(getattr(full.one_way, end), abs=1e-9)
        assert getattr(free.mean, end) == pytest.approx(getattr(full.one_way_of_means, end), rel=1e-9, abs=1e-9)


def people(rng: np.random.Generator, sizes: tuple[int, ...], between: float, within: float) -> list[np.ndarray]:
    return [rng.normal(rng.normal(0.0, between), within, size) for size in sizes]


SIZES = (2, 3, 5, 12, 4, 9, 2, 7, 6, 10)


def test_reliability_of_unequal_numbers_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    found = [one_way_reliability(people(rng, SIZES, 1.0, 1.0)) for _ in range(1000)]
    assert np.mean([each.single.low <= 0.5 <= each.single.high for each in found]) == pytest.approx(0.95, abs=0.02)
    assert np.mean([each.between_sd**2 for each in found]) == pytest.approx(1.0, abs=0.08)
    assert np.mean([each.within_sd**2 for each in found]) == pytest.approx(1.0, abs=0.03)


def test_as_many_cuts_as_said_reach_the_reliability_wanted() -> None:
    found = one_way_reliability(people(np.random.default_rng(2), SIZES, 1.0, 1.0))
    rho, k = found.single.value, found.cuts_for(0.8)
    assert k * rho / (1 + (k - 1) * rho) == pytest.approx(0.8)
    alike = one_way_reliability([[1.0, 3.0], [3.0, 1.2], [1.1, 3.0]])
    assert alike.single.value < 0.0
    assert math.isinf(alike.cuts_for())


def check_montgomerys_column(found: Cusum) -> None:
    """C+ of Table 9.2 at periods 1 to 8, and 28 to 30; it signals at period 29."""
    assert found.leaving[:8].round(2).tolist() == [0.0, 0.0, 0.0, 1.16, 2.82, 2.5, 0.04, 1.0]
    assert found.leaving[27:].round(2).tolist() == [4.47, 5.28, 5.3]
    assert found.left_at == 29


def test_pages_cusum_is_that_of_montgomery() -> None:
    check_montgomerys_column(cusum(MONTGOMERY, 10.0, 1.0, slack=0.5, threshold=5.0))


def run_length(mean: float, rng: np.random.Generator) -> int:
    reached = cusum(rng.normal(mean, 1.0, 3000), 0.0, 1.0).reached_at
    assert reached is not None
    return reached


def test_run_lengths_are_those_promised() -> None:
    rng = np.random.default_rng(3)
    assert np.mean([run_length(0.0, rng) for _ in range(500)]) == pytest.approx(8.4, abs=0.5)
    assert np.mean([run_length(1.0, rng) for _ in range(300)]) == pytest.approx(335.0, rel=0.15)


@given(st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=30), st.floats(-5.0, 5.0), st.floats(0.1, 5.0))
def test_sums_turn_with_the_sign_and_scale_with_the_unit(values: list[float], target: float, scale: float) -> None:
    found = cusum(values, target, scale)
    turned = cusum(-np.array(values), -target, scale, sign=-1)
    larger = cusum(10.0 * np.array(values), 10.0 * target, 10.0 * scale)
    for name in ("total", "reaching", "leaving"):
        assert getattr(turned, name) == pytest.approx(getattr(found, name), abs=1e-9)
        assert getattr(larger, name) == pytest.approx(getattr(found, name), abs=1e-9)
        assert name == "total" or (getattr(found, name) >= 0.0).all()


def test_a_learner_is_told_when_the_target_is_reached_and_when_it_is_left() -> None:
    found = cusum([3.0] * 10 + [0.0] * 10 + [3.0] * 5, 0.0, 1.0)
    assert found.reached_at == 19
    assert found.left_at is not None
    assert found.left_at <= 3
    assert cusum([3.0] * 10, 0.0, 1.0).reached_at is None


def test_a_learning_curve_has_students_interval_and_pairs_everyone_with_himself() -> None:
    rng = np.random.default_rng(4)
    levels = rng.normal(0.0, 10.0, 6)
    series = [level - np.arange(n) for level, n in zip(levels, (5, 5, 5, 4, 4, 2), strict=True)]
    found = learning_curve(series)
    assert found.number.tolist() == [1, 2, 3, 4, 5]
    assert found.people.tolist() == [6, 6, 5, 5, 3]
    test = stats.ttest_1samp([each[3] for each in series if len(each) > 3], 0.0).confidence_interval()
    assert (found.low[3], found.high[3]) == pytest.approx((test.low, test.high))
    for name in ("change", "change_low", "change_high"):  # everybody changes alike: no spread is left
        assert getattr(found, name) == pytest.approx([0.0, -1.0, -2.0, -3.0, -4.0])


def test_a_learning_curve_ends_where_fewer_than_three_are_left() -> None:
    assert learning_curve([[1.0, 2.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [2.0, 3.0, 4.0, 5.0]]).number.tolist() == [
        1, 2, 3,
    ]  # fmt: skip


groups = st.lists(st.lists(st.integers(-9, 9), min_size=1, max_size=4), min_size=4, max_size=7)


@given(groups, groups)
def test_superiority_is_mann_whitneys_and_turns_with_the_groups(
    first: list[list[int]], second: list[list[int]]
) -> None:
    a, b = ([float(np.mean(each)) for each in group] for group in (first, second))
    if np.ptp(a) == 0.0 and np.ptp(b) == 0.0:
        with pytest.raises(ValueError, match="nobody differs within the groups"):
            separation(first, second)
        return
    found, turned = separation(first, second), separation(second, first)
    U = stats.mannwhitneyu(a, b).statistic
    assert found.superiority.value == pytest.approx(U / (len(a) * len(b)))
    assert found.superiority.low <= found.superiority.value <= found.superiority.high
    assert turned.superiority.low == pytest.approx(1.0 - found.superiority.high, abs=1e-6)
    assert turned.difference.value == pytest.approx(-found.difference.value)
    assert turned.difference.low == pytest.approx(-found.difference.high, rel=1e-4, abs=1e-4)


def covered(d: float, n: int, cuts: int, *, over_cuts: bool) -> tuple[float, float]:
    """How often the intervals of P and g hold the truth; ``over_cuts`` takes every cut for a person."""
    rng = np.random.default_rng(6)
    held = []
    for _ in range(400):
        levels = rng.normal([[d], [0.0]], 1.0, (2, n))
        first, second = np.repeat(levels[:, :, None], cuts, axis=2)
        if over_cuts:
            first, second = first.reshape(-1, 1), second.reshape(-1, 1)
        found = separation(list(first), list(second))
        p, g = found.superiority, found.difference
        held.append((p.low <= stats.norm.cdf(d / math.sqrt(2.0)) <= p.high, g.low <= d <= g.high))
    of_p, of_g = np.mean(held, axis=0)
    return float(of_p), float(of_g)


@pytest.mark.parametrize("d", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("n", [4, 6, 12])
def test_separation_holds_the_truth_as_often_as_it_says(d: float, n: int) -> None:
    assert covered(d, n, 5, over_cuts=False) == pytest.approx((0.95, 0.95), abs=0.035)


def test_cuts_taken_for_people_would_claim_too_much() -> None:
    assert max(covered(1.0, 6, 5, over_cuts=True)) < 0.75


def test_full_separation_of_few_people_still_has_a_width() -> None:
    found = separation([[4.0], [5.0], [6.0], [7.0]], [[0.0], [1.0], [2.0], [3.0]])
    assert found.superiority.value == found.superiority.high == 1.0
    assert 0.5 < found.superiority.low < 0.7


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: intraclass_correlation([[1, 2]]), r"ratings has shape \(1, 2\); give 2 rows"),
        (lambda: intraclass_correlation([[1], [2], [3]]), r"shape \(3, 1\)"),
        (lambda: intraclass_correlation([[1, 2], [2, math.nan], [3, 3]]), "ratings = nan .*Leave out rows with gaps"),
        (lambda: intraclass_correlation([[1, 2], [2, 1], [1.5, 1.5]]), "ratings: the people do not differ"),
        (lambda: intraclass_correlation([[5, 5]] * 3), "do not differ in"),
        (lambda: intraclass_correlation([[1, 2], [2, 3], [4, 4]], confidence=95), "confidence = 95 is outside"),
        (lambda: one_way_reliability([[1, 2]]), "series has 1 rows; give 2 or more"),
        (lambda: one_way_reliability([[1, 2], [2, 3], [1]]), r"series\[2\] has shape \(1,\); give 2 values or more"),
        (lambda: one_way_reliability([[1, 2], [2, 3], [1, math.inf]]), r"series\[2\] = inf"),
        (lambda: separation([[1]], [[1], [2], [3], [4]]), "first has 1 rows; give 2 or more"),
        (
            lambda: separation([[1], [2], [3], [4]], [[1], [2], [], [3]]),
            r"second\[2\] has shape \(0,\)|second\[2\] must be",
        ),
        (lambda: cusum([1.0], 0.0, 1.0), r"values has shape \(1,\); give 2 values or more"),
        (lambda: cusum([1.0, 2.0], 0.0, 0.0), "scale = 0 is outside .*standard deviation of one person's cuts"),
        (lambda: cusum([1.0, 2.0], math.nan, 1.0), "target = nan"),
        (lambda: cusum([1.0, 2.0], 0.0, 1.0, slack=0.0), "slack = 0 is outside"),
        (lambda: cusum([1.0, 2.0], 0.0, 1.0, sign=0), "sign must be 1"),
        (lambda: learning_curve([[1, 2]]), "series has 1 rows"),
    ],
)
def test_what_says_nothing_is_refused_with_field_value_and_cure(call: object, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        call()  # type: ignore[operator]


def cut(operator: str, values: dict[str, float | None], *, group: str = "", session: str = "") -> StudiedCut:
    """A cut with made-up metrics; the others are missing."""
    card = score(Trace(time=np.arange(60) / 100.0, force=1.0 + np.arange(60) / 60.0), name=f"cut of {operator}")
    missing = {
        name: dataclasses.replace(each, value=None, unavailable="made up") for name, each in card.metrics.items()
    }
    given_ = {
        name: dataclasses.replace(card.metrics[name], value=value, unavailable="" if value is not None else "made up")
        for name, value in values.items()
    }
    card = dataclasses.replace(card, metrics={**missing, **given_})
    return StudiedCut(card=card, operator=operator, group=group, session=session)


def test_a_study_tells_what_its_parts_tell() -> None:
    found = study(metrics=("force_rate",)).findings[0]
    of = study(metrics=("force_rate",))
    series = {
        operator: [each.card["force_rate"] for each in of.cuts if each.operator == operator]
        for operator in of.operators
    }
    assert {operator: values.tolist() for operator, values in found.series.items()} == series
    assert found.reliability == one_way_reliability(list(series.values()))
    novices, experts = ([v for name, v in series.items() if name[0] == letter] for letter in "NE")
    assert found.separation == separation(novices, experts)
    sessions = [[float(np.mean(v[:8])), float(np.mean(v[8:]))] for v in series.values()]
    assert isinstance(found.retest, Intraclass)
    assert found.retest.agreement.value == pytest.approx(intraclass_correlation(sessions).agreement.value)
    assert isinstance(found.curves["novice"], LearningCurve)
    assert found.curves["novice"].change == pytest.approx(learning_curve(novices).change)


def test_experts_are_told_from_novices_and_only_novices_learn() -> None:
    found = study(metrics=("force_rate",), target_group="expert").findings[0]
    assert isinstance(found.separation, Separation)
    assert found.separation.superiority.low > 0.5
    novice, expert = (found.curves[group] for group in ("novice", "expert"))
    assert isinstance(novice, LearningCurve)
    assert isinstance(expert, LearningCurve)
    assert novice.change_high[-1] < 0.0 < expert.change_high[-1]
    assert not isinstance(found.cusums, NotEstimable)
    assert sorted(name for name, sums in found.cusums.items() if sums.reached_at) == ["E01", "E02", "E03", "E04"]
    assert found.target_is == "mean of group expert"


def test_a_metric_without_a_better_way_has_no_target_to_reach() -> None:
    found = study(metrics=("crest_factor",)).findings[0]
    assert METRICS["crest_factor"].direction == "none"
    assert found.cusums == NotEstimable("neither way is better, so no target is reached")
    assert isinstance(found.reliability, OneWay)


def test_missing_values_are_left_out_and_told() -> None:
    cuts = [cut(code, {"force_rate": value}) for code in ("P01", "P02", "P03") for value in (1.0, 2.0, None)]
    cuts[0] = cut("P01", {"force_rate": 5.0})
    of = Study(name="few", cuts=cuts, metrics=("force_rate",))
    assert of.findings[0].missing == 3
    assert of.findings[0].series["P01"].tolist() == [5.0, 2.0]
    assert of.notes[0] == "force_rate is missing in 3 of 9 cuts: made up"


def test_one_person_in_a_group_gets_metrics_reasons_and_no_nan() -> None:
    cuts = [cut(code, {"force_rate": value}, group=code[0]) for code in ("N1", "E1") for value in (1.0, 1.0)]
    of = Study(name="two", cuts=cuts, metrics=("force_rate",))
    found = of.findings[0]
    assert isinstance(found.reliability, NotEstimable)
    assert found.separation == NotEstimable("fewer than 2 operators in a group (1 and 1)")
    assert found.cusums == NotEstimable("no operator's cuts differ")
    said = "\n".join(table_lines(of))
    assert "nan" not in said
    assert "no difference of N and E: fewer than 2 operators in a group (1 and 1)" in said


def test_sessions_without_a_reliability_are_said_with_the_reason() -> None:
    cuts = [cut("P1", {"force_rate": 1.0 + k}, session=str(k)) for k in (0, 1)]
    of = Study(name="two sessions", cuts=cuts, metrics=("force_rate",))
    (found,) = of.findings
    assert isinstance(found.retest, NotEstimable)
    assert f"note: no reliability of sessions: {found.retest.reason}" in table_lines(of)


def test_few_people_get_values_without_intervals_and_one_honest_word() -> None:
    cuts = [
        cut(f"{group}{i}", {"force_rate": 10.0 * (group == "N") + i + k}, group=group)
        for group, people in (("N", 3), ("E", 2))
        for i in range(people)
        for k in (0.0, 0.5)
    ]
    of = Study(name="few", cuts=cuts, metrics=("force_rate",))
    found = of.findings[0]
    assert isinstance(found.separation, Separation)
    assert found.separation.superiority == Estimate(value=1.0)
    assert found.separation.difference.low is None
    assert isinstance(found.reliability, OneWay)
    assert found.reliability.single.low is not None  # of five people
    assert isinstance(found.curves["E"], LearningCurve)
    assert found.curves["E"].change.tolist() == [0.0, 0.5]
    assert found.curves["N"].low is found.curves["E"].change_low is None  # type: ignore[union-attr]
    (note,) = of.notes
    assert note.startswith(
        "too few operators for an interval of the groups' difference (3 and 2, of at least 4 in each)"
    )
    four = Study(name="four", cuts=cuts[2:], metrics=("force_rate",)).findings[0]
    assert four.reliability == NotEstimable(
        "fewer than 5 operators with two cuts or more, and so few often differ by chance"
    )
    assert isinstance(four.separation, Separation)
    two = one_way_reliability([[1.0, 2.0], [5.0, 6.0]])
    full = one_way_reliability([[1.0, 2.0], [5.0, 6.0], [3.0, 3.5]])
    assert (two.single.low, two.single.value > 0.9, full.single.low is None) == (None, True, False)


def test_the_overall_score_is_studied_as_a_metric_is() -> None:
    def scored(operator: str, value: float) -> StudiedCut:
        of = cut(operator, {})
        return dataclasses.replace(of, card=dataclasses.replace(of.card, overall_score=value, no_score=""))

    of = Study(name="score", cuts=[scored(f"P{i}", 10.0 * i + k) for i in range(4) for k in (0.0, 3.0)])
    (found,) = of.findings
    assert (found.metric, found.unit) == ("overall_score", "1")
    assert found.series["P2"].tolist() == [20.0, 23.0]
    assert not isinstance(found.cusums, NotEstimable)
    assert found.cusums["P3"].reaching[-1] > found.cusums["P0"].reaching[-1]  # more is better


def test_of_three_groups_two_must_be_named() -> None:
    cuts = [cut(f"{g}{i}", {"force_rate": float(i)}, group=g) for g in "ABC" for i in (1, 2, 3, 5)]
    unnamed = Study(name="three", cuts=cuts, metrics=("force_rate",))
    assert unnamed.notes[0] == "of the groups A, B, C no two were named: their separation is not computed"
    assert unnamed.findings[0].separation == NotEstimable("the study has no two groups")
    named = Study(name="three", cuts=cuts, metrics=("force_rate",), groups=("C", "A"))
    assert isinstance(named.findings[0].separation, Separation)
    assert not any("no two were named" in note for note in named.notes)


def card_in_numbers() -> ScoreCard:
    return score(Trace(time=np.arange(60) / 100.0, force=np.ones(60), force_unit="1"))


@pytest.mark.parametrize(
    ("cuts", "options", "message"),
    [
        ([], {}, "a study needs cuts"),
        ([cut("P1", {}), StudiedCut(card=card_in_numbers(), operator="P1")], {}, "force is in 1 and in N"),
        ([cut("P1", {}, group="a"), cut("P1", {}, group="b")], {}, "operator P1 is in groups 'a' and 'b'"),
        ([cut("P1", {})], {"metrics": ("force_rates",)}, "Did you mean 'force_rate'"),
        ([cut("P1", {})], {"metrics": ("force_rate",)}, "force_rate is missing in 1 of 1 cuts: made up"),
        ([cut("P1", {})], {}, "no metric could be computed from these cuts: overall_score is missing"),
        ([cut("P1", {}, group="a")], {"groups": ("a", "c")}, "group must be one of 'a', got 'c'"),
        ([cut("P1", {}, group="a")], {"target_group": "c"}, "target group must be one of"),
        ([cut("P1", {})], {"target": 1.0}, "needs exactly one metric"),
        (
            [cut("P1", {}, group="a")],
            {"target": 1.0, "target_group": "a", "metrics": ("force_rate",)},
            "a target or a target group, not both",
        ),
    ],
)
def test_a_study_that_makes_no_sense_is_refused(
    cuts: list[StudiedCut], options: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Study(name="x", cuts=cuts, **options)  # type: ignore[arg-type]


def test_an_estimate_reads_as_a_value_with_its_interval() -> None:
    assert str(Estimate(value=0.5, low=0.25, high=0.75)) == "0.5 [0.25, 0.75]"
