"""Variance components of the modulus, and the mean depth of cut, against made-up data with known answers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from cutenv.tissue.tables import table
from cutenv.tissue.variance_components import ModulusSpread, mean_depth_of_cut, modulus_spread, variance_components

FORMULATIONS = ("plane_stress", "plane_strain")


def check_recovers(components: tuple[float, float], between: float, within: float) -> None:
    assert components[0] == pytest.approx(between, rel=0.05)
    assert components[1] == pytest.approx(within, rel=0.05)


def made_up(n_tables: int = 20_000) -> np.ndarray:
    """Three livers of four cuts, many times over: SD 0.3 between livers, 0.2 between cuts."""
    rng = np.random.default_rng(52)
    return 1 + rng.normal(0, 0.3, (n_tables, 3, 1)) + rng.normal(0, 0.2, (n_tables, 3, 4))


def test_components_are_recovered_without_bias():
    check_recovers(variance_components(made_up()), 0.3**2, 0.2**2)


def test_the_plain_variance_of_the_liver_means_fails_the_same_check():
    # It still contains a quarter of the variance between cuts.
    groups = made_up()
    with pytest.raises(AssertionError):
        check_recovers((groups.mean(axis=2).var(axis=1, ddof=1).mean(), 0.2**2), 0.3**2, 0.2**2)


def test_components_can_be_worked_out_by_hand():
    # Means 2 and 6, squares about them 2 + 8 over 2 degrees of freedom: within 5; between (16 - 5)/2.
    between, within = variance_components(np.array([[[1.0, 3.0], [4.0, 8.0]]]))
    assert (between, within) == (pytest.approx((16 - 5) / 2), pytest.approx(5))


def test_equal_groups_give_a_negative_component_between_them():
    between, _ = variance_components(np.array([[[1.0, 3.0], [1.0, 3.0]]]))
    assert between == pytest.approx(-1)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_measured_spread_is_the_analysis_of_variance_written_out(formulation):
    between, within, ratios = [], [], []
    for number in ("5.2", "5.3", "5.4"):
        mean, sd = table(number)[f"lem_{formulation}_Pa"], table(number)[f"sd_{formulation}_Pa"]
        livers = [mean[i : i + 4] / mean.mean() for i in (0, 4, 8)]
        within.append(sum(((cuts - cuts.mean()) ** 2).sum() for cuts in livers) / 9)
        between.append(4 * sum((cuts.mean() - 1) ** 2 for cuts in livers) / 2)
        ratios.extend(sd / mean)
    spread = modulus_spread(formulation)
    assert spread.between_cut_cv == pytest.approx(math.sqrt(np.mean(within)))
    assert spread.between_liver_cv == pytest.approx(math.sqrt((np.mean(between) - np.mean(within)) / 4))
    assert spread.within_cut_cv == pytest.approx(np.mean(ratios))
    assert not spread.between_liver_clipped


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_between_cut_spread_is_smaller_than_within(formulation):
    spread = modulus_spread(formulation)
    assert 0 < spread.between_liver_cv < spread.between_cut_cv < spread.within_cut_cv


def test_a_negative_component_is_clipped_to_zero_and_reported(monkeypatch):
    monkeypatch.setattr("cutenv.tissue.variance_components.variance_components", lambda groups: (-0.01, 0.04))
    spread = modulus_spread()
    assert (spread.between_liver_cv, spread.between_cut_cv) == (0.0, pytest.approx(0.2))
    assert spread.between_liver_clipped


def test_rows_of_tables_5_2_and_5_3_correlate_as_the_caution_says():
    slow, medium, fast = (table(number)["lem_plane_stress_Pa"] for number in ("5.2", "5.3", "5.4"))
    assert np.corrcoef(slow, medium)[0, 1] == pytest.approx(0.79, abs=0.005)
    assert abs(np.corrcoef(slow, fast)[0, 1]) < 0.3


@pytest.mark.parametrize("change", [{"between_liver_cv": -0.1}, {"within_cut_cv": math.nan}, {"between_cut_cv": 20}])
def test_a_spread_that_is_none_is_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        dataclasses.replace(ModulusSpread(between_liver_cv=0.1, between_cut_cv=0.2, within_cut_cv=0.4), **change)


def test_mean_depth_is_the_geometric_mean_ratio_of_tables_5_5_and_5_6():
    columns = [f"lem_plane_stress_{angle}_deg_Pa" for angle in (90, 45)]
    ratios = np.concatenate([table("5.5")[column] / table("5.6")[column] for column in columns])
    ratios = ratios[np.isfinite(ratios)]
    assert len(ratios) == 13
    assert mean_depth_of_cut() == pytest.approx(0.01 * np.prod(ratios) ** (1 / 13))
    assert mean_depth_of_cut() == pytest.approx(0.0143, abs=5e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_mean_depth_lies_within_the_measured_depths(formulation):
    assert 0.001 <= mean_depth_of_cut(formulation=formulation) <= 0.02


@pytest.mark.parametrize(("function", "argument"), [(modulus_spread, "solid"), (mean_depth_of_cut, "solid")])
def test_what_was_not_measured_is_refused(function, argument):
    with pytest.raises(ValueError, match="must be one of"):
        function(argument)
