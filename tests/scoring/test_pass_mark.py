"""Pass marks: closed forms, the published examples, the reasons why there is none, and intervals over people."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from cutenv.scoring.study import PassMark, pass_mark, proficiency
from cutenv.scoring.study.bootstrap import BOOTSTRAP_SIZE, over_people
from cutenv.scoring.study.pass_mark import METHODS, Method, NormalCurve, crossing


def curve(mean: float, sd: float) -> NormalCurve:
    return NormalCurve(np.float64(mean), np.float64(sd))  # type: ignore[arg-type]


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def people(mean: float, sd: float, n: int) -> np.ndarray:
    """Values of n people whose mean and standard deviation are exactly these."""
    drawn = np.random.default_rng(n).normal(size=n)
    return mean + sd * (drawn - drawn.mean()) / drawn.std(ddof=1)


@pytest.mark.parametrize(
    ("failing", "passing"),
    [((40, 5), (50, 5)), ((20, 5), (50, 10)), ((50.7, 13.2), (74.7, 4.8)), ((9, 2), (3, 1)), ((0, 1e-3), (1, 10))],
)
def test_the_mark_is_where_the_densities_are_equal(failing: tuple[float, float], passing: tuple[float, float]) -> None:
    mark = float(crossing(curve(*failing), curve(*passing)))
    assert min(failing[0], passing[0]) < mark < max(failing[0], passing[0])
    assert norm.logpdf(mark, *failing) == pytest.approx(norm.logpdf(mark, *passing), rel=1e-9)


def test_equal_spreads_put_the_mark_half_way() -> None:
    found = pass_mark(people(40, 5, 20), people(50, 5, 20), rng=rng())
    assert found.mark.value == pytest.approx(45.0)
    for rate in (found.false_passes, found.false_fails):
        assert rate.theoretical is not None
        assert rate.theoretical.value == pytest.approx(float(norm.sf(1.0)))  # one SD from either mean


def standardised(values: list[float]) -> np.ndarray:
    array = np.array(values)
    return (array - array.mean()) / array.std(ddof=1)


def test_the_published_rates_of_jorgensen_konge_and_subhi() -> None:
    """Figure 3 of doi 10.1186/s41077-018-0064-7: 2.7 % and 6.4 % in theory, 9.1 % (one novice) and 0.0 % observed.

    Its means and standard deviations are not in the text that we have. Up to unit and zero of the scale the two rates
    fix the curves that cross at their mark: equal densities at z1 and z2 mean sd2/sd1 = exp((z1^2 - z2^2)/2).
    """
    z1, z2 = norm.isf(0.027), norm.isf(0.064)
    sd = math.exp(0.5 * (z1**2 - z2**2))
    novices = standardised([-0.9, -0.8, -0.6, -0.5, -0.4, -0.3, -0.2, -0.1, 0.2, 0.4, 2.6])
    experts = z1 + sd * z2 + sd * standardised([-1.4, -1.0, -0.4, 0.0, 0.4, 1.0, 1.4])
    found = pass_mark(novices, experts, rng=rng())
    assert found.mark.value == pytest.approx(z1)
    assert found.false_passes.theoretical is not None
    assert found.false_fails.theoretical is not None
    assert f"{100 * found.false_passes.theoretical.value:.1f}" == "2.7"
    assert f"{100 * found.false_fails.theoretical.value:.1f}" == "6.4"
    assert f"{100 * found.false_passes.observed / found.false_passes.people:.1f}" == "9.1"
    assert found.false_fails.observed == 0


@pytest.mark.parametrize("method", METHODS)
def test_lower_is_better_is_the_mirror_image(method: Method) -> None:
    given = 47.0 if method == "set by the teacher" else None
    a, b = people(40, 6, 12), people(50, 3, 8)
    up = pass_mark(a, b, method=method, given=given, rng=rng())
    down = pass_mark(-a, -b, method=method, better="lower", given=None if given is None else -given, rng=rng())
    assert down.mark.value == pytest.approx(-up.mark.value)
    for one, other in ((up.false_passes, down.false_passes), (up.false_fails, down.false_fails)):
        assert one.observed == other.observed
        assert one.theoretical is not None
        assert other.theoretical is not None
        assert other.theoretical.value == pytest.approx(one.theoretical.value)


def test_the_experts_mean_less_their_spread() -> None:
    found = pass_mark([], people(50, 4, 9), method="expert mean and SD", spread=2.0, rng=rng())
    assert found.mark.value == pytest.approx(42.0)
    assert found.false_passes.people == 0
    assert found.false_passes.theoretical is None
    assert found.false_fails.theoretical is not None
    assert found.false_fails.theoretical.value == pytest.approx(float(norm.sf(2.0)))


def test_a_value_at_the_mark_passes() -> None:
    found = pass_mark([1, 2, 3], [3, 4, 5], method="set by the teacher", given=3.0, rng=rng())
    assert (found.false_passes.observed, found.false_fails.observed) == (1, 0)
    assert found.mark.low is None


@pytest.mark.parametrize(
    ("failing", "passing", "message"),
    [
        ([1, 2], [5, 6, 7], r"fewer than 3 people in a group \(2 and 3\)"),
        ([1, 1, 1], [5, 6, 7], "nobody differs in the non-passing group"),
        ([5, 6, 7], [1, 2, 3], r"wrong order: the passing one is no better"),
        ([0, 10, 20], [10, 11, 12], "overlap wholly"),
    ],
)
def test_groups_that_give_no_evidence_are_told_why(failing: list[float], passing: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pass_mark(failing, passing, rng=rng())


def test_experts_who_are_all_alike_have_no_spread_to_go_by() -> None:
    with pytest.raises(ValueError, match="nobody differs in the passing group"):
        pass_mark([], [0.0, 0.0, 0.0], method="expert mean and SD", better="lower", rng=rng())


def test_a_mark_without_a_teacher_is_refused() -> None:
    with pytest.raises(ValueError, match="a teacher's mark needs it"):
        pass_mark([1, 2, 3], [4, 5, 6], method="set by the teacher", rng=rng())


def test_the_interval_is_over_people_and_only_of_enough_of_them() -> None:
    def width(n: int) -> float:
        mark = pass_mark(people(40, 5, n), people(50, 5, n), rng=rng()).mark
        assert mark.low is not None
        assert mark.high is not None
        assert mark.low < 45.0 < mark.high
        return mark.high - mark.low

    assert width(80) == pytest.approx(width(20) / 2.0, rel=0.35)
    few = pass_mark(people(40, 5, 4), people(50, 5, 4), rng=rng()).mark
    assert few.low is None
    assert "it takes 5 people, here 4" in few.note


def test_the_interval_of_a_mean_is_students() -> None:
    values = people(50, 5, 40)
    mark = pass_mark([], values, method="expert mean", rng=rng()).mark
    half = 2.0227 * 5.0 / math.sqrt(40)  # t of 39 degrees of freedom
    assert mark.low == pytest.approx(50 - half, abs=0.25)
    assert mark.high == pytest.approx(50 + half, abs=0.25)


def test_resamples_without_a_mark_are_told() -> None:
    replicates = np.where(np.arange(BOOTSTRAP_SIZE) % 5 == 0, np.nan, np.linspace(0.0, 1.0, BOOTSTRAP_SIZE))
    assert over_people(0.5, replicates, 10).note == "uncertain interval: 20 % of the resamples have no such value"
    assert over_people(0.5, np.where(replicates > 0.4, np.nan, replicates), 10).low is None


def test_proficiency_is_reached_by_passes_in_a_row() -> None:
    values = [3, 5, 2, 5, 6, 7, 1]
    found = proficiency(values, 5.0, better="higher", in_a_row=2)
    assert (found.cuts, found.passes, found.longest, found.reached_at) == (7, 4, 3, 5)
    assert proficiency(values, 5.0, better="higher", in_a_row=4).reached_at is None
    assert proficiency(values, 2.0, better="lower", in_a_row=1).reached_at == 3


def test_a_mark_is_the_same_with_the_same_seed() -> None:
    first, second = (pass_mark(people(40, 5, 9), people(50, 5, 9), rng=rng()) for _ in range(2))
    assert isinstance(first, PassMark)
    assert first == second
