"""Spread between specimens, cuts and along a cut, and settings compared within specimens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import ttest_rel
from virtual_session import EVEN, cuts

from cutenv.commands.calibrate import differences_in_handling, settings_table
from cutenv.records import Provenance, TissueHandling, load_one, save
from cutenv.records.measurement.pooled_cuts import (
    CENTRES,
    Variogram,
    correlation_length,
    cv_of,
    fit_variances,
    mean_field_variance,
    nested_variances,
)
from cutenv.records.measurement.within_specimens import compare_settings, mixed_model
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.description import variance_components
from cutenv.sim.trace import Trace

pytest.importorskip("statsmodels", reason="mixed models are an extra: pip install 'cutenv[stats]'")

DIFFERENT = EVEN | {"modulus_between_liver_cv": 0.4}


@pytest.mark.parametrize("between", [0.3, 0.0])
def test_two_settings_once_in_each_group_are_the_paired_t_test(between: float) -> None:
    rng = np.random.default_rng(3)
    level = rng.normal(0.0, between, 6)
    first, second = level + rng.normal(0.0, 0.1, 6), level + 0.2 + rng.normal(0.0, 0.1, 6)
    design = np.stack([np.ones(12), np.repeat([0.0, 1.0], 6)], axis=1)
    fixed, errors, _, _ = mixed_model(np.concatenate([first, second]), design, np.tile(np.arange(6), 2))
    expected = ttest_rel(second, first).confidence_interval()
    reach = float(student.ppf(0.975, 12 - 6 - 1)) * errors[1]
    assert (fixed[1] - reach, fixed[1] + reach) == pytest.approx((expected.low, expected.high), abs=1e-5)


def test_livers_that_differ_and_miss_settings_do_not_hide_the_law_of_speed() -> None:
    made = [cut for cut in cuts(**DIFFERENT) if cut.angle > 1.2]
    soft, *_, stiff = sorted(
        {cut.specimen for cut in made}, key=lambda name: _mean([c for c in made if c.specimen == name])
    )
    # The soft liver lacks the slow cut, and the stiff one the fast: without their levels, speed would stiffen.
    slow, fast = min(cut.speed for cut in made), max(cut.speed for cut in made)
    kept = [
        cut
        for cut in made
        if not (cut.specimen == soft and cut.speed < 1.1 * slow)
        and not (cut.specimen == stiff and cut.speed > 0.9 * fast)
    ]
    modulus, resistance = compare_settings(kept)
    true_moduli = measured_liver().local_effective_modulus
    assert modulus.specimens == 3
    assert modulus.between_sd > 5.0 * modulus.within_sd
    for effect in modulus.effects:
        truth, reference = (true_moduli(each.speed, each.angle) for each in (effect.setting, modulus.reference))
        assert effect.ratio == pytest.approx(truth / reference, rel=0.06)
        assert effect.low < effect.ratio < effect.high
    assert all(each.ratio == pytest.approx(1.0, abs=0.05) for each in resistance.effects)
    assert "within 3 specimens" in settings_table(kept)


def _mean(own: list) -> float:  # type: ignore[type-arg]
    return float(np.mean([cut.material_modulus for cut in own]))


def test_cuts_that_allow_no_comparison_are_refused() -> None:
    made = cuts(**DIFFERENT)
    with pytest.raises(ValueError, match="Cut two specimens or more, each at the reference setting"):
        compare_settings([cut for cut in made if cut.specimen == made[0].specimen])


def test_what_was_done_with_the_tissue_is_kept_and_differences_are_said(tmp_path) -> None:  # type: ignore[no-untyped-def]
    fresh = TissueHandling(hours_post_mortem=6, storage="saline", temperature_C=21.5, capsule="kept", fixation="nails")
    origin = Provenance(specimen="liver 1", handling=fresh)
    time = np.arange(100) / 100.0
    save(Trace(time=time, force=time, metadata=origin.metadata), tmp_path / "a.csv")
    read = load_one(tmp_path / "a.csv")
    assert Provenance.from_metadata(read.metadata) == origin
    bare = Trace(time=time, force=time)
    assert differences_in_handling([read, read]) == []
    assert "the tissue's handling differs in capsule: kept (1 cuts), not noted (1 cuts)" in differences_in_handling(
        [read, bare]
    )
    with pytest.raises(ValueError, match="capsule must be one of None, 'kept', 'removed', got 'half'"):
        TissueHandling(capsule="half")
    with pytest.raises(ValueError, match="Did you mean 'temperature_C'"):
        Provenance.from_metadata({"handling": {"temperature": 20}})


LENGTH, SD = 0.020, 0.2
"""Correlation length of the drawn fields [m], and standard deviation of their logarithm."""


def drawn_fields(cuts: int = 400, places: int = 20, seed: int = 1) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Positions [m] and values of lognormal fields, squared-exponentially correlated; each cut has its own mean."""
    rng = np.random.default_rng(seed)
    positions, values = [], []
    for _ in range(cuts):
        x = np.sort(rng.uniform(0.01, 0.1, places))
        covariance = SD**2 * np.exp(-0.5 * ((x[:, None] - x[None, :]) / LENGTH) ** 2)
        field = np.linalg.cholesky(covariance + 1e-10 * np.eye(places)) @ rng.normal(size=places)
        positions.append(x)
        values.append(np.exp(field + rng.normal(0.0, 0.5)))
    return positions, values


def check_finds_the_field(variogram: Variogram, cuts: int) -> None:
    counts = np.ones(cuts)
    assert correlation_length([variogram], counts) == pytest.approx(LENGTH, rel=0.1)
    (variance,), _ = fit_variances([variogram], counts, LENGTH)
    assert math.sqrt(variance) == pytest.approx(SD, rel=0.1)


def test_a_variogram_finds_a_drawn_field_whatever_the_means_of_the_cuts() -> None:
    check_finds_the_field(Variogram.of(*drawn_fields()), 400)


def test_errors_of_the_values_are_taken_out_and_left_in_are_noticed() -> None:
    positions, values = drawn_fields()
    rng = np.random.default_rng(2)
    noisy = [value * np.exp(rng.normal(0.0, 0.15, len(value))) for value in values]
    errors = [np.full(len(value), 0.15) for value in values]
    check_finds_the_field(Variogram.of(positions, noisy, errors), 400)
    with pytest.raises(AssertionError):
        check_finds_the_field(Variogram.of(positions, noisy), 400)


def test_the_standard_deviation_within_the_cuts_is_not_the_fields() -> None:
    """It reads low: a cut is not long against the correlation length."""
    _, values = drawn_fields()
    within = math.sqrt(np.mean([np.log(value).var(ddof=1) for value in values]))
    assert within < 0.9 * SD


def test_a_variogram_can_be_worked_out_by_hand() -> None:
    """Three places of one cut: half the squared differences of the logarithms, in their bins of 5 mm."""
    variogram = Variogram.of([np.array([0.0, 0.012, 0.031])], [np.exp([0.0, 1.0, 3.0])])
    expected = np.zeros(len(CENTRES))
    expected[[2, 3, 6]] = 0.5, 2.0, 4.5  # at 12, 19 and 31 mm
    assert variogram.squares[0] == pytest.approx(expected)
    assert variogram.pairs[0].tolist() == (expected > 0.0).astype(float).tolist()


def test_a_cut_taken_twice_counts_twice() -> None:
    positions, values = drawn_fields(cuts=3)
    counted = Variogram.of(positions, values).mean(np.array([2.0, 0.0, 1.0]))
    repeated = Variogram.of([positions[i] for i in (0, 0, 2)], [values[i] for i in (0, 0, 2)]).mean(np.ones(3))
    for one, other in zip(counted, repeated, strict=True):
        assert one == pytest.approx(other)


def test_cuts_of_one_place_tell_nothing_and_break_nothing() -> None:
    variogram = Variogram.of([np.array([0.05])] * 3, [np.array([2.0])] * 3)
    (variance,), misfit = fit_variances([variogram], np.ones(3), LENGTH)
    assert (variance, misfit) == (0.0, 0.0)


def test_the_cv_of_a_lognormal_number_is_that_of_drawn_ones() -> None:
    drawn = np.exp(np.random.default_rng(3).normal(0.0, 0.5, 1_000_000))
    assert cv_of(0.25) == pytest.approx(drawn.std() / drawn.mean(), rel=0.01)
    assert cv_of(-0.1) == cv_of(0.0) == 0.0


@pytest.mark.parametrize(
    ("positions", "share"),
    [([0.05], 1.0), ([0.05] * 4, 1.0), ([0.0, 10.0, 20.0, 30.0], 0.25), ([0.0, LENGTH], 0.5 * (1 + math.exp(-0.5)))],
    ids=["one place", "one place often", "far apart", "one length apart"],
)
def test_the_variance_of_a_mean_along_a_field_in_closed_form(positions: list[float], share: float) -> None:
    assert mean_field_variance(np.array(positions), 0.09, LENGTH) == pytest.approx(0.09 * share)


def drawn_groups(sizes: list[int], n: int, seed: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """n times over values of groups of these sizes: SD 0.3 between groups, 0.2 within; and the groups."""
    rng = np.random.default_rng(seed)
    groups = np.repeat(np.arange(len(sizes)), sizes)
    return rng.normal(0.0, 0.3, (n, len(sizes)))[:, groups] + rng.normal(0.0, 0.2, (n, len(groups))), groups


def check_components(found: np.ndarray) -> None:
    """Means over many sets of [between, within]."""
    assert found.mean(axis=0) == pytest.approx([0.3**2, 0.2**2], rel=0.05)


@pytest.mark.parametrize("sizes", [[4, 4, 4], [2, 9, 1, 4]], ids=["balanced", "unbalanced"])
def test_components_of_variance_are_recovered_without_bias(sizes: list[int]) -> None:
    values, groups = drawn_groups(sizes, 8000)
    check_components(np.array([nested_variances(each, groups, np.ones(len(groups))) for each in values]))


def test_balanced_groups_give_what_the_thesis_tables_are_treated_with() -> None:
    values, groups = drawn_groups([4, 4, 4], 20)
    for each in values:
        expected = variance_components(each.reshape(1, 3, 4))
        assert nested_variances(each, groups, np.ones(12)) == pytest.approx(expected)


def test_a_resample_counts_as_if_its_members_were_repeated() -> None:
    values, groups = drawn_groups([3, 2, 4], 1)
    counts = np.array([2, 0, 1, 3, 0, 0, 1, 1, 1])
    repeated = np.repeat(values[0], counts), np.repeat(groups, counts)
    expected = nested_variances(*repeated, np.ones(counts.sum()))
    assert nested_variances(values[0], groups, counts.astype(float)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("groups", "between_known", "within_known"),
    [([0, 0, 0], False, True), ([0, 1, 2], False, False), ([0, 0, 1], True, True), ([0], False, False)],
    ids=["one group", "one member each", "enough", "one value"],
)
def test_what_groups_cannot_tell_is_no_number(groups: list[int], between_known: bool, within_known: bool) -> None:
    values = np.array([1.0, 1.2, 1.7])[: len(groups)]
    between, within = nested_variances(values, np.array(groups), np.ones(len(groups)))
    assert math.isfinite(between) is between_known
    assert math.isfinite(within) is within_known
